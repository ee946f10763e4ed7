"""The tables of the real-bench records, in Markdown: every rate with its 95 % binomial interval (Clopper and Pearson)."""

from collections.abc import Callable

import numpy as np
from _hidden_bench_scores import BenchCase
from _hidden_details import rows_of
from scipy.stats import binomtest


STRATA = ((3.0, 5.0), (5.0, 8.0), (8.0, np.inf))
SEEN = STRATA[-1][0]  # noise units from which an effect should be found


def rate(values: list[bool]) -> str:
    """ "12/14 = 86 % (57 to 98)"."""
    if not values:
        return "none"
    interval = binomtest(sum(values), len(values)).proportion_ci(method="exact")
    share = 100.0 * np.mean(values)
    return f"{sum(values)}/{len(values)} = {share:.0f} % ({100.0 * interval.low:.0f} to {100.0 * interval.high:.0f})"


def table(cases: list[BenchCase], failed: dict[str, str]) -> str:
    parts = [headline_table(cases), by_size(cases), by_fault(cases), misses(cases)]
    if failed:
        parts.append("## No answer\n\n" + "\n".join(f"- {name}: {why}" for name, why in failed.items()) + "\n")
    seconds = [case.answer["seconds"] for case in cases]
    if seconds:
        parts.append(f"Seconds per record: median {np.median(seconds):.1f}, largest {max(seconds):.1f}.\n")
    return "\n".join(parts)


def headline_table(cases: list[BenchCase]) -> str:
    """What is asked of a diagnosis; the third column counts what `unexplained` lists as suspects among the names."""

    def of(kind: str) -> Callable[[list[BenchCase]], list[BenchCase]]:
        return lambda given: [c for c in given if c.kind == kind]

    clear = lambda kind: lambda given: [c for c in of(kind)(given) if min(c.truth["delta_of"].values()) >= SEEN]
    lines: list[tuple[str, Callable[[list[BenchCase]], str], str]] = []

    def line(words: str, which: Callable, judged: Callable[[BenchCase], bool], wanted: str = "") -> None:
        lines.append((words, lambda given: rate([judged(c) for c in which(given)]), wanted))

    line(
        "nothing wrong: an effect named, or unexplained",
        of("none"),
        lambda c: bool(c.effects) or c.unexplained,
        "at most 5 %",
    )
    line("nothing wrong: a fault named", of("none"), lambda c: bool(c.faults))
    line("pure fault: an effect named", of("fault"), lambda c: bool(c.effects), "at most 7 %")
    line("pure fault: the right fault named", of("fault"), lambda c: c.fault_right, "at least 80 %")
    line("pure fault: named, or an alternative", of("fault"), lambda c: c.fault_inside)
    line("pure fault: unexplained", of("fault"), lambda c: c.unexplained)
    line(f"singles of delta above {SEEN:g}: named first", clear("single"), lambda c: c.first_right, "at least 90 %")
    line(f"singles of delta above {SEEN:g}: truth inside", clear("single"), lambda c: c.inside, "at least 97 %")
    lines.append(
        ("... names where something is named", lambda given: _mean_names(clear("single")(given)), "at most 1.6")
    )
    line("all singles: named first", of("single"), lambda c: c.first_right)
    line("all singles: truth inside", of("single"), lambda c: c.inside)
    line("storage: found", of("storage"), lambda c: c.inside, "at least 85 %")
    line("three or four effects: all inside", of("several"), lambda c: c.inside, "at least 60 %")
    lines.append(
        ("three or four effects: false names", lambda given: _false_names(of("several")(given)), "at most 10 %")
    )
    line(
        "fault with effect: both right",
        of("fault_with_effect"),
        lambda c: c.fault_right and c.effect_hit,
        "at least 75 %",
    )
    line("fault with effect: the fault right", of("fault_with_effect"), lambda c: c.fault_right)
    line("fault with effect: the effect right", of("fault_with_effect"), lambda c: c.effect_hit)
    line("outsiders: unexplained, or closed on held-out rows", of("outside"), lambda c: c.right, "at least 90 %")
    line("outsiders: closed on held-out rows", of("outside"), lambda c: c.really_closed)
    line(
        "no fault there: a fault named",
        lambda given: [c for c in given if not c.truth["faults"]],
        lambda c: bool(c.faults),
    )
    line("all that is wrong, and nothing else", lambda given: given, lambda c: c.right)
    lines.append(("held-out after/before of hidden effects, median", _held_out, "at most 0.1"))
    known = lambda given: [c for c in given if c.kind != "outside" and not c.unexplained]
    lines.append(
        ("95 % intervals that hold the truth, no misfit left", lambda given: rate(_covered(known(given))), "92 to 98 %")
    )
    lines.append(("... over all records", lambda given: rate(_covered([c for c in given if c.kind != "outside"])), ""))
    suspects = [case.with_suspects for case in cases]
    rows = [[words, found(cases), found(suspects), wanted] for words, found, wanted in lines]
    return rows_of(["measured", "result", "with suspects", "wanted"], rows) + (
        "\nIntervals of parameters of one record are not independent: their own interval should be wider.\n"
    )


def _covered(cases: list[BenchCase]) -> list[bool]:
    return [hit for case in cases for hit in case.covered()]


def _mean_names(cases: list[BenchCase]) -> str:
    named = [case.names for case in cases if case.effects]
    return f"{np.mean(named):.2f} of {len(named)}" if named else "none"


def _false_names(cases: list[BenchCase]) -> str:
    return rate([i < case.false_names for case in cases for i in range(len(case.effects))])


def _held_out(cases: list[BenchCase]) -> str:
    ratios = [c.left_over for c in cases if c.hidden and min(c.truth["delta_of"].values()) >= SEEN]
    known = [ratio for ratio in ratios if ratio is not None]
    return f"{np.median(known):.2f} of {len(known)}" if known else "none"


def by_size(cases: list[BenchCase]) -> str:
    """Each hidden effect by its own size, by the truth: alone, and beside other effects or a fault."""
    rows = []
    for words, kinds in (("alone", ("single",)), ("beside others", ("several", "fault_with_effect", "storage"))):
        for low, high in STRATA:
            group = [(c, name) for c in cases if c.kind in kinds for name in c.hidden if low <= c.size(name) < high]
            rows.append(
                [
                    words,
                    f"above {low:g}" if np.isinf(high) else f"{low:g} to {high:g}",
                    rate([bool(c.effects) or c.unexplained for c, _ in group]),
                    rate([any(c.hit(effect, name) for effect in c.effects) for c, name in group]),
                    rate([any(c.is_one_of(effect, name) for effect in c.effects) for c, name in group]),
                ]
            )
    head = ["effects", "delta", "something said", "named", "inside"]
    return "## Effects by their own size\n\n" + rows_of(head, rows)


def by_fault(cases: list[BenchCase]) -> str:
    """Each kind of fault, alone and beside an effect."""
    names = sorted({fault["name"] for case in cases for fault in case.truth["faults"]})
    rows = []
    for name in names:
        group = [c for c in cases if any(f["name"] == name for f in c.truth["faults"])]
        rows.append([name, rate([c.fault_right for c in group]), rate([bool(c.false_names) for c in group])])
    return "## Faults\n\n" + rows_of(["fault", "right", "a false effect named"], rows)


def misses(cases: list[BenchCase]) -> str:
    """Every record whose answer is not what is wrong there, and nothing else."""
    rows = []
    for case in cases:
        if case.right:
            continue
        truth, answer = case.truth, case.answer
        outside = truth["outside"]
        hidden = [f"{name} ({size:.1f})" for name, size in truth["delta_of"].items()]
        places = [
            f"{f['name']}: {f['test'] or 'several tests'} {f['channel']} {_runs(f['runs'])}" for f in truth["faults"]
        ]
        named = [
            " / ".join([e["name"], *(a["name"] for a in e["alternatives"])]) + f" ({e['strength']:.1f})"
            for e in answer["effects"]
        ]
        said = [f"{f['name']}: {f['test']} {f.get('run') or ''} {f.get('channel') or ''}" for f in case.faults]
        noise = [truth["noise"], "stated" if truth["noise_declared"] else "", "raw" if truth["raw_log"] else ""]
        rows.append(
            [
                answer["record"],
                "outside: " + outside["name"] if outside else truth["kind"],
                "; ".join([*hidden, *places]) or "nothing",
                " ".join(word for word in noise if word) + f", {truth['rows']} rows",
                answer["verdict"],
                "; ".join([*named, *said]) or "nothing",
                f"{answer['gap_before']:.3g} to {answer['gap_after']:.3g}",
            ]
        )
    head = ["record", "kind", "hidden (delta)", "noise", "verdict", "said (strength)", "gap"]
    return "## Answers that are not exactly what is wrong\n\n" + rows_of(head, rows)


def _runs(runs: list[str]) -> str:
    return " ".join(runs) if len(runs) <= 4 else f"{len(runs)} runs"
