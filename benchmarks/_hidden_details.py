"""Simpler rules beside the diagnosis, and every answer that is not what was hidden, in Markdown."""

from _hidden_scores import Case, mean_of, of_kind, share


def rows_of(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


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
