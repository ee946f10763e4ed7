"""The tables of the hidden-effect records, in Markdown."""

import numpy as np
from _hidden_scores import (
    STRATA,
    Case,
    in_stratum,
    mean_of,
    median_of,
    of_kind,
    share,
    stratum_name,
)


def table(cases: list[Case], failed: dict[str, str]) -> str:
    parts = [headline_table(cases), by_group(cases), by_claimed_strength(cases), baseline_table(cases), misses(cases)]
    if failed:
        parts.append("## Failed\n\n" + "\n".join(f"- {name}: {why}" for name, why in failed.items()) + "\n")
    seconds = [case.answer["seconds"] for case in cases]
    if seconds:
        parts.append(f"Seconds per record: median {np.median(seconds):.1f}, largest {max(seconds):.1f}.\n")
    return "\n".join(parts)


def rows_of(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def headline_table(cases: list[Case]) -> str:
    none, singles, pairs, outside = (of_kind(cases, kind) for kind in ("none", "single", "pair", "outside"))
    clear = [c for c in singles if c.detectable]
    ratios = [c.left_over for c in [*clear, *pairs]]
    known = [*none, *singles, *pairs]
    right = [c for c in known if c.model_right]
    covered = [hit for c in right for hit in c.covered()]
    answered = [c.answer["verdict"] == "unexplained" or c.really_closed for c in outside]
    rows = [
        ["no effect, named all the same", share([bool(c.effects) for c in none]), "at most 5 %"],
        ["no effect, called unexplained", share([c.answer["verdict"] == "unexplained" for c in none]), ""],
        ["detectable singles named first", share([c.first_right for c in clear]), "at least 85 %"],
        ["truth inside names and alternatives", share([c.inside for c in clear]), "at least 97 %"],
        ["names on average", mean_of([float(c.names) for c in clear]), "at most 1.6"],
        ["effects named on average", mean_of([float(len(c.effects)) for c in clear]), ""],
        ["both of two found", share([c.both_found for c in pairs]), "at least 75 %"],
        ["both of two inside names and alternatives", share([c.inside for c in pairs]), ""],
        ["outside: unexplained, or closed on held-out data", share(answered), "at least 85 %"],
        ["outside: closed on held-out data", share([c.really_closed for c in outside]), ""],
        ["held-out excess after/before, median", median_of([r for r in ratios if r is not None]), "at most 0.2"],
        ["95 % intervals that hold the truth (right model)", share(covered), "90 to 98 %"],
        ["... effects' amounts alone", share([hit for c in right for hit in c.amounts_covered()]), ""],
        *(
            [f"... {noise} noise", share([hit for c in right if c.truth["noise"] == noise for hit in c.covered()]), ""]
            for noise in ("white", "AR(1)")
        ),
        ["... whatever was named", share([hit for c in known for hit in c.covered()]), ""],
        ["undetectable singles", share([not c.detectable for c in singles]), ""],
        ["undetectable singles: truth inside, or nothing named",
         share([c.inside or not c.effects for c in singles if not c.detectable]), ""],
    ]  # fmt: skip
    return rows_of(["measured", "result", "wanted"], rows)


def by_group(cases: list[Case]) -> str:
    """Single effects by their true size after projection, by noise and by strength; all of them, detectable or not."""
    singles = of_kind(cases, "single")
    groups = [(f"delta {stratum_name(s)}", [c for c in singles if in_stratum(c.truth["delta"], s)]) for s in STRATA]
    for noise in ("white", "AR(1)"):
        groups.append((f"{noise} noise", [c for c in singles if c.truth["noise"] == noise]))
    for declared, words in ((True, "noise declared"), (False, "noise not declared")):
        groups.append((words, [c for c in singles if c.truth["noise_declared"] == declared]))
    for strength in ("weak", "strong"):
        groups.append((strength, [c for c in singles if c.truth["strength"] == strength]))
    rows = []
    for words, group in groups:
        rows.append(
            [
                words,
                str(len(group)),
                share([c.detectable for c in group]),
                share([c.first_right for c in group]),
                share([c.inside for c in group]),
                share([not c.effects for c in group]),
                mean_of([float(c.names) for c in group if c.effects]),
            ]
        )
    head = ["single effects", "records", "detectable", "named first", "inside", "nothing named", "names"]
    return "## Single effects by true size, noise and strength\n\n" + rows_of(head, rows)


def by_claimed_strength(cases: list[Case]) -> str:
    """How far a name can be trusted, by the strength that the diagnosis states with it; all records."""
    rows = []
    for stratum in STRATA:
        named = [(c, e) for c in cases for e in c.effects if in_stratum(e["strength"], stratum)]
        inner = [(c, e) for c, e in named if c.truth["kind"] != "outside"]
        rows.append(
            [
                stratum_name(stratum),
                str(len(named)),
                share([any(c.hit(e, name) for name in c.hidden) for c, e in inner]),
                share([any(c.is_one_of(e, name) for name in c.hidden) for c, e in inner]),
                str(len(named) - len(inner)),
            ]
        )
    head = ["stated strength", "named effects", "right", "truth inside", "of records from outside"]
    return "## Named effects by the strength stated with them\n\n" + rows_of(head, rows)


def baseline_table(cases: list[Case]) -> str:
    """The same records and library; a baseline's exact rival of the truth counts as right, since it lists none."""
    cases = [c for c in cases if c.answer.get("baselines")]
    if not cases:
        return ""
    none, singles, pairs, outside = (of_kind(cases, kind) for kind in ("none", "single", "pair", "outside"))
    clear = [c for c in singles if c.detectable]

    def right(case: Case, name: str, truth: str) -> bool:
        return name == truth or case.rivals(name, truth)

    def row(words: str, names: list[tuple[Case, list[str]]]) -> list[str]:
        by_case = {id(c): n for c, n in names}
        both = [
            len(by_case[id(c)]) >= 2 and all(any(right(c, n, t) for n in by_case[id(c)]) for t in c.hidden)
            for c in pairs
        ]
        wrong = [sum(not any(right(c, n, t) for t in c.hidden) for n in by_case[id(c)]) for c in [*clear, *pairs]]
        return [
            words,
            share([bool(by_case[id(c)]) for c in none]),
            share([right(c, (by_case[id(c)] or [""])[0], c.hidden[0]) for c in clear]),
            share(both),
            mean_of([float(w) for w in wrong]),
            share([bool(by_case[id(c)]) for c in outside]),
        ]

    rows = [row("thermohyd diagnose", [(c, [e["name"] for e in c.effects]) for c in cases])]
    for method in cases[0].answer["baselines"]:
        rows.append(row(method, [(c, c.answer["baselines"][method]) for c in cases]))
    head = [
        "rule",
        "no effect: named",
        "singles: right first",
        "pairs: both",
        "false names",
        "outside: named something",
    ]
    return "## Beside simpler rules, same records, noise model and library\n\n" + rows_of(head, rows)


def misses(cases: list[Case]) -> str:
    """Every record whose answer is not what was hidden, for whoever wants to know why."""
    rows = []
    for case in cases:
        kind, verdict = case.truth["kind"], case.answer["verdict"]
        good = {
            "none": not case.effects and verdict == "consistent",
            "single": bool(case.effects) and case.first_right and case.inside and len(case.effects) == 1,
            "pair": len(case.hidden) == 2 and case.both_found and len(case.effects) == 2,
            "outside": verdict == "unexplained" or case.really_closed,
        }[kind]
        if good:
            continue
        outside = case.truth["outside"]
        hidden = f"{outside['name']}" if outside else " + ".join(case.hidden) or "nothing"
        named = "; ".join(
            " / ".join([e["name"], *(a["name"] for a in e["alternatives"])]) + f" ({e['strength']:.1f})"
            for e in case.effects
        )
        rows.append(
            [
                case.answer["record"],
                f"{hidden} ({case.truth['delta']:.1f})",
                case.truth["noise"],
                f"{case.answer['gap_before']:.3f}",
                verdict,
                named or "nothing",
                f"{case.answer['gap_after']:.3f}",
            ]
        )
    head = ["record", "hidden (delta)", "noise", "gap before", "verdict", "named (strength)", "gap after"]
    return "## Answers that are not exactly what was hidden\n\n" + rows_of(head, rows)
