"""petab_select's choices beside the diagnosis's answers, in Markdown."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from _hidden_bench_scores import BenchCase
from _hidden_bench_tables import rate
from _hidden_details import rows_of
from _hidden_scores import RIVALS, mean_of
from scipy.stats import binomtest


DIAGNOSIS = "thermohyd diagnose"
Cases = Mapping[str, BenchCase]


def as_case(truth: dict[str, Any], effects: Iterable[str]) -> BenchCase:
    """A choice of effects as an answer: each one named, with its exact rivals for alternatives, as none are listed."""
    bare = BenchCase(truth, {})
    rivals = lambda name: sorted({o for group in RIVALS for o in group if o != name and bare.rivals(name, o)})
    named = [{"name": n, "alternatives": [{"name": other} for other in rivals(n)]} for n in effects]
    return BenchCase(truth, {"verdict": "named" if named else "consistent", "effects": named, "faults": []})


def inside(case: BenchCase) -> bool | None:
    """Whether all that is hidden is among the names; None where no effect is hidden."""
    return case.inside if case.hidden else None


def nothing_false(case: BenchCase) -> bool | None:
    """Whether every name is right; None where what is hidden lies outside of the library."""
    return None if case.kind == "outside" else case.false_names == 0


def exact(case: BenchCase) -> bool | None:
    """Whether the hidden effects are named and no others."""
    return None if case.kind == "outside" else case.false_names == 0 and (case.effect_hit if case.hidden else True)


JUDGED: dict[str, Callable[[BenchCase], bool | None]] = {
    "all hidden effects inside": inside,
    "no false name": nothing_false,
    "the hidden effects and no others": exact,
}


def table(choices: Mapping[str, Cases], diagnosed: Cases, found: Mapping[str, Any], failed: Mapping[str, str]) -> str:
    """choices: {search: {record: case}}; found: what was kept of every record."""
    if not choices:
        return "Nothing answered yet.\n"
    rules = {**({DIAGNOSIS: diagnosed} if diagnosed else {}), **choices}
    parts = [by_kind(rules), paired(choices, diagnosed), cost(found), by_record(rules)]
    if failed:
        parts.append("## No answer\n\n" + "\n".join(f"- {name}: {why}" for name, why in failed.items()) + "\n")
    return "\n".join(part for part in parts if part)


def by_kind(rules: Mapping[str, Cases]) -> str:
    """Each rule's rates, with 95 % binomial intervals."""
    kinds = sorted({case.kind for cases in rules.values() for case in cases.values()})
    hides = {case.kind: bool(case.hidden) for cases in rules.values() for case in cases.values()}
    rows = []
    for rule, by_name in rules.items():
        cases = list(by_name.values())
        of = {kind: [case for case in cases if case.kind == kind] for kind in kinds}
        rows.append(
            [
                rule,
                *(rate([c.inside if hides[kind] else bool(c.effects) for c in of[kind]]) for kind in kinds),
                *(rate([hit for c in cases if (hit := judge(c)) is not None]) for judge in JUDGED.values()),
                mean_of([float(c.false_names) for c in cases if c.kind != "outside"]),
                mean_of([float(len(c.effects)) for c in cases]),
            ]
        )
    asked = [f"{kind}: {'inside' if hides[kind] else 'an effect named'}" for kind in kinds]
    text = rows_of(["rule", *asked, *JUDGED, "false names a record", "names a record"], rows)
    ours = list(rules.get(DIAGNOSIS, {}).values())
    if ours:
        beside = mean_of([float(case.names - len(case.effects)) for case in ours])
        text += (
            f"\nBeside its names the diagnosis lists {beside} alternatives a record; a truth among them is inside.\n"
        )
    return text


def paired(choices: Mapping[str, Cases], diagnosed: Cases) -> str:
    """On the same records: where only one of both is right, and how likely chance makes so uneven a split (sign test)."""
    rows = []
    for search, cases in choices.items():
        row = [search]
        for judge in JUDGED.values():
            both = [(judge(diagnosed[name]), judge(case)) for name, case in cases.items() if name in diagnosed]
            ours = sum(a is True and b is False for a, b in both)
            theirs = sum(a is False and b is True for a, b in both)
            p = binomtest(ours, ours + theirs).pvalue if ours + theirs else 1.0
            row.append(f"{ours} : {theirs} of {sum(a is not None for a, _ in both)} (p {p:.2g})")
        rows.append(row)
    if not diagnosed:
        return ""
    head = "## Record by record: right by the diagnosis alone, by petab_select alone\n\n"
    return head + rows_of(["search", *JUDGED], rows)


def cost(found: Mapping[str, Any]) -> str:
    """Models asked for, and searches that ended at their budget: they answer with the best model so far."""
    rows = []
    for search in next(iter(found.values()))["searches"]:
        own = [answer["searches"][search] for answer in found.values()]
        models = [choice["models"] for choice in own]
        short = rate([not choice["complete"] for choice in own])
        rows.append([search, f"{np.median(models):.0f}", str(max(models)), short])
    fits, seconds = ([answer[key] for answer in found.values()] for key in ("fits", "seconds"))
    return (
        "## Models asked for\n\n"
        + rows_of(["search", "median", "most", "ended at its budget"], rows)
        + f"\nThe four searches share their fits: median {np.median(fits):.0f} a record, most {max(fits)}; "
        + f"seconds a record: median {np.median(seconds):.0f}, most {max(seconds):.0f}.\n"
    )


def by_record(rules: Mapping[str, Cases]) -> str:
    """Every record: what is hidden there, and what each rule names."""
    truths = {name: case.truth for cases in rules.values() for name, case in cases.items()}
    rows = []
    for name in sorted(truths):
        truth = truths[name]
        sizes = [f"{effect} ({size:.1f})" for effect, size in truth["delta_of"].items()]
        outside = [f"outside: {truth['outside']['name']}"] if truth["outside"] else []
        named = (_names(cases[name]) if name in cases else "not asked" for cases in rules.values())
        rows.append([name, truth["kind"], "; ".join([*sizes, *outside]) or "nothing", *named])
    return "## Every record\n\n" + rows_of(["record", "kind", "hidden (delta)", *rules], rows)


def _names(case: BenchCase) -> str:
    return "; ".join(effect["name"] for effect in case.effects) or "nothing"
