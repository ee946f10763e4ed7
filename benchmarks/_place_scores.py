"""How right the places are that a diagnosis points at: rates of the leave-one-out tables, static and in motion."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from _hidden_bench_tables import rate


# {what is hidden: (its places, its variables)}.
Right = dict[str, tuple[tuple[str, ...], tuple[str, ...]]]


@dataclass(frozen=True)
class Hidden:
    """What is hidden in a record, "" where nothing is; groups: with which others it is counted apart; size: in words."""

    name: str
    groups: tuple[str, ...]
    size: str


def score(right: tuple[tuple[str, ...], tuple[str, ...]], answer: dict[str, Any]) -> dict[str, bool]:
    """How right the first term that holds, or its rivals, are; {} where names stand in and leave nothing to place."""
    from thermohyd.identify.diagnosis.term_table import family

    places, variables = right
    first = _first(answer)
    if first is None and answer["named"]:
        return {}
    pairs = [] if first is None else [(first["place"], first["variable"]), *map(tuple, first["alternatives"])]
    return {
        "told": first is not None,
        "place": bool(pairs) and pairs[0][0] in places,
        "quantity": bool(pairs) and family(pairs[0][0]) in {family(p) for p in places},
        "both": bool(pairs) and pairs[0][0] in places and pairs[0][1] in variables,
        "allowed": any(p in places for p, _ in pairs),
        "both_allowed": any(p in places and v in variables for p, v in pairs),
    }


def _first(answer: dict[str, Any]) -> dict[str, Any] | None:
    return next((t for t in answer["terms"] if t["holds"]), None)


COLUMNS = {
    "place": "place first",
    "allowed": "or a rival",
    "both": "place and variable first",
    "both_allowed": "or a rival, both",
}


def table(hidden: dict[str, Hidden], answers: dict[str, dict[str, Any]], right: Right) -> str:
    """The rates, what the terms leave, then a line per record."""
    rows, false, named, stand_ins, left, ratios = [], [], [], [], [], []
    scores: dict[str, list[dict[str, bool]]] = {"all": []}
    verdicts: Counter[tuple[bool, str]] = Counter()  # (whether something is hidden, verdict)
    for name, answer in answers.items():
        what = hidden[name]
        label = f"{what.name} {what.size}" if what.name else "nothing"
        if "error" in answer:
            rows.append(f"| {name} | {label} | failed: {answer['error'][:80]} | | |")
            continue
        first = _first(answer)
        words = "nothing" if first is None else f"{first['place']} {first['variable']} {first['law']}"
        closes = "" if first is None else f"{first['gap_closed']:.2f}"
        if not what.name:
            false.append(first is not None)
            verdicts[False, answer["verdict"]] += 1
            named.append(bool(answer["named"]))
            rows.append(f"| {name} | {label} | {words} | {closes} | {'false' if false[-1] else 'right'} |")
            continue
        own = score(right[what.name], answer)
        verdicts[True, answer["verdict"]] += 1
        if own:
            for group in ("all", *what.groups):
                scores.setdefault(group, []).append(own)
            names = (("both", "both"), ("place", "place"), ("allowed", "rival"))
            mark = next((said for key, said in names if own[key]), "" if first is None else "wrong")
        else:
            # Whether the name stands beside the right place, among those where the same would be read.
            stand_ins.append(any(place in right[what.name][0] for place, _ in answer.get("acting", ())))
            words, mark = " + ".join(answer["named"]), "stand-in, place beside it" if stand_ins[-1] else "stand-in"
        if first is not None:
            left.append(1.0 - first["gap_closed"])
            if answer.get("own") is not None:
                ratios.append(first["held_out"][1] / answer["own"])
        rows.append(f"| {name} | {label} | {words} | {closes} | {mark} |")
    lines = [
        "| | records | told | " + " | ".join(COLUMNS.values()) + " |",
        "|---|---|---|" + "---|" * len(COLUMNS),
    ]
    for group, of in sorted(scores.items(), key=lambda item: (item[0] != "all", item[0])):
        told = [s for s in of if s["told"]]
        rates = " | ".join(rate([s[key] for s in told]) for key in COLUMNS)
        lines.append(f"| {group} | {len(of)} | {len(told)} | {rates} |")
    everything = scores["all"]
    lines += [
        "",
        "Rates are of the records in which a term is told.",
        "",
        f"- of all with something hidden, told or not: place first {rate([s['place'] for s in everything])}",
        f"- of those told: place right but for the edges {rate([s['quantity'] for s in everything if s['told']])}",
        f"- a false place in records with nothing wrong: {rate(false)}",
        f"- names stand in and leave nothing to place: {len(stand_ins)}; the right place stands beside them in {rate(stand_ins)}",
    ]
    if any(verdict for _, verdict in verdicts):  # of whole diagnoses
        lines.append(f"- a false name in records with nothing wrong: {rate(named)}")
        for hiding, words in ((True, "something hidden"), (False, "nothing wrong")):
            of = [f"{n} {verdict}" for (there, verdict), n in verdicts.most_common() if there == hiding]
            lines.append(f"- verdicts with {words}: {', '.join(of) or 'none'}")
    if left:
        lines.append(
            f"- gap on rows held out, after/before: median {np.median(left):.3f}, upper quartile {np.quantile(left, 0.75):.3f}"
        )
    if ratios:
        lines.append(
            f"- mean square misfit on rows held out, over what the effect itself leaves there: median {np.median(ratios):.3f}, "
            f"largest {max(ratios):.3f}; at most 1.3 in {rate([bool(r <= 1.3) for r in ratios])}"
        )
    if seconds := [a["seconds"] for a in answers.values() if a.get("cpu") is not None]:
        cpu = [a["cpu"] for a in answers.values() if a.get("cpu") is not None]
        lines.append(
            f"- the second tier took {np.median(seconds):.1f} s (median), {max(seconds):.1f} at most; "
            f"{np.median(cpu):.1f} s of processor"
        )
    head = ["", "## The records", "", "| record | hidden | first term | closes | |", "|---|---|---|---|---|"]
    return "\n".join([*lines, *head, *rows]) + "\n"
