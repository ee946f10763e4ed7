"""The tables of the hidden-effect records, in Markdown."""

import numpy as np
from _hidden_details import baseline_table, misses, rows_of
from _hidden_scores import STRATA, Case, in_stratum, mean_of, median_of, of_kind, share, stratum_name


def table(cases: list[Case], failed: dict[str, str]) -> str:
    parts = [headline_table(cases), by_group(cases), by_claimed_strength(cases), baseline_table(cases), misses(cases)]
    if failed:
        parts.append("## Failed\n\n" + "\n".join(f"- {name}: {why}" for name, why in failed.items()) + "\n")
    seconds = [case.answer["seconds"] for case in cases]
    if seconds:
        parts.append(f"Seconds per record: median {np.median(seconds):.1f}, largest {max(seconds):.1f}.\n")
    return "\n".join(parts)


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
