"""The whole diagnosis of one record: fit, find where, name, confirm on rows held out, say what remains."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.effects.registry import EFFECTS
from thermohyd.precision import require_float64

from ..fit import run_fit
from ..fit_result import FitResult
from ..fitted import Fitted, Key
from ..record import BenchRecord
from .candidates import candidates
from .confirmation import exchange_fits, held_out_result
from .fit_results import result_of
from .headline import further_sentences, headline
from .held_out import Split, split_rows
from .library import library_for
from .library_fit import LibraryFit, LibraryProblem
from .next_test import next_test
from .record_noise import NoiseFound, Repeats, first_noise, found_noise, noise_of, repeats_of
from .result import (
    Alternative,
    ChannelNoiseFound,
    DiagnosisResult,
    Evidence,
    NamedEffect,
    ParameterShift,
    Verdict,
)
from .rivals import Rivals, settle_rivals
from .screening import finite_steps, screen
from .search import LEVEL, Found, search
from .smooth_basis import lack_of_fit, smooth_block
from .variations import variations_of
from .where import regions


# The choice is made on the rows that are not held out; where those show nothing, all rows are asked, at what is left.
LEVEL_OF_CHOICE, LEVEL_OF_ALL_ROWS = 0.6 * LEVEL, 0.4 * LEVEL
LEVEL_OF_LEFT_OVER = 1e-3
# A reduced chi-square beyond this, and beyond chance, is a misfit even where it is not smooth.
MISFIT = 1.08

Progress = Callable[[str], None]


def diagnose(record: BenchRecord, *, learn: bool = False, progress: Progress | None = None) -> DiagnosisResult:
    """Find where a record disagrees with the ideal valve, name the missing effects, add them and show the gap close.

    learn: add the leading smooth variation to the model where no effect explains the rest (marked as empirical).
    Raises what `fit` raises: BenchInputError where the record determines nothing, RuntimeError in single precision.
    """
    require_float64("diagnose")
    began = time.perf_counter()
    say = progress or (lambda _: None)
    case = open_case(record, say)
    case, found, split = choose(case, say)
    result = conclude(case, found, split, learn=learn, say=say)
    return replace(result, seconds=time.perf_counter() - began)


@dataclass(frozen=True)
class Case:
    """A record with its plain fit, its noise, and the ideal valve fitted to all its rows."""

    fitted: Fitted
    problem: LibraryProblem
    repeats: dict[Key, Repeats | None]
    noise: dict[Key, NoiseFound]
    base: LibraryFit
    steps: dict[str, np.ndarray]  # finite-step signatures of every effect beside `base`


def open_case(record: BenchRecord, say: Progress = lambda _: None) -> Case:
    """Fit the ideal valve as `fit` does, measure the noise, and fit it again by generalised least squares."""
    fitted = run_fit(record, progress=say)
    say("measuring the noise")
    problem = LibraryProblem(
        record, fitted.tests, fitted.plans, library_for(fitted.tests.values()), first_noise(fitted.noise)
    )
    repeats = {
        (test.name, c.name): repeats_of(test, c, fitted.noise[test.name, c.name].std)
        for test in fitted.tests.values()
        for c in test.channels
    }
    start = dict(zip(fitted.free, (float(v) for v in fitted.solution.p), strict=True))
    base = problem.fit(start=start)
    return with_noise_around(Case(fitted, problem, repeats, {}, base, {}), base)


def with_noise_around(case: Case, fit: LibraryFit) -> Case:
    """The case with its noise measured beside `fit`, and the ideal valve fitted with it."""
    noise = found_noise(case.problem, fit, case.fitted.noise, case.repeats)
    problem = case.problem.with_noise(noise_of(noise))
    base = problem.fit(start=case.base.values)
    steps = finite_steps(problem, problem.with_all_columns(base), problem.library.names)
    return replace(case, problem=problem, noise=noise, base=base, steps=steps)


def choose(case: Case, say: Progress = lambda _: None) -> tuple[Case, Found, Split]:
    """Search on the rows that are not held out.

    Twice: noise that no repeats measured is measured again beside the model that the first search found.
    """
    split = split_rows(case.fitted.tests)
    for last in (False, True):
        say("searching for missing effects")
        chosen = case.problem.with_rows(~split.held)
        base = chosen.fit(start=case.base.values)
        found = search(chosen, base, case.steps, level=LEVEL_OF_CHOICE, say=say)
        if last or not found.effects or all(r is not None for r in case.repeats.values()):
            return case, found, split
        case = with_noise_around(case, case.problem.fit(found.effects, found.final.values))
    raise AssertionError


def conclude(case: Case, found: Found, split: Split, *, learn: bool, say: Progress = lambda _: None) -> DiagnosisResult:
    """Refit with all rows, look for rivals and left-overs, confirm, and put it into words."""
    problem, base = case.problem, case.base
    say("refitting with all rows")
    begin = problem.fit(found.effects, found.final.values) if found.effects else None
    whole = search(problem, base, case.steps, begin=begin, level=LEVEL_OF_ALL_ROWS, say=say)
    seen = tuple(name for name in whole.effects if name in found.effects)
    p_values = {**whole.p_values, **found.p_values}
    rows = len(base.residual) - len(case.problem.plans)
    freedom = max(rows - len(base.free), 1)
    steps = case.steps
    scale = max(whole.final.chi2 / max(rows - len(whole.final.free), 1), 1.0)
    final, rivals = settle_rivals(problem, whole.final, steps, scale=scale)
    p_values = {name: p_values.get(name, min(p_values.values(), default=1.0)) for name in final.effects}

    say("looking at what is left")
    block = smooth_block(problem, len(base.residual))
    left = lack_of_fit(problem, final, block)
    known = all(n.known for n in case.noise.values())
    rough = known and scale > MISFIT and (scale - 1.0) * np.sqrt(freedom / 2.0) > 5.0
    disagrees = left.p_value < LEVEL_OF_LEFT_OVER or rough
    excess = base.chi2 - freedom
    gap = lambda fit: float(np.clip((fit.chi2 - final.chi2) / max(excess, fit.chi2 - final.chi2, 1e-300), 0.0, 1.0))

    chosen = problem.with_rows(~split.held)
    base_chosen = chosen.fit(start=base.values)
    final_chosen = chosen.fit(final.effects, final.values) if final.effects else base_chosen
    spared = set(final.effects) | {r.name for rival in rivals.values() for r in rival.alike}
    first = screen(problem.with_all_columns(base), problem.library.names, steps, level=LEVEL)
    exchanged = exchange_fits(chosen, final_chosen, [s.name for s in first.ranked], spared, say)
    what = (
        split.what
        if len(seen) == len(final.effects)
        else f"{split.what} (the choice needed all rows, the values did not)"
    )
    held = held_out_result(problem, split, base_chosen, final_chosen, exchanged, what)

    singles = whole.steps[0].singles if not found.effects else found.steps[0].singles
    table = candidates(problem.library, first, base, singles if not found.effects else {}, excess)
    before = result_of(problem, base, case.fitted, case.noise, scale=max(base.chi2 / freedom, 1.0))
    after = result_of(problem, final, case.fitted, case.noise, scale=scale)
    effects = tuple(
        _named(
            name, after, rivals[name], p_values[name], gap(rivals[name].without), rivals[name].without.chi2 - final.chi2
        )
        for name in final.effects
    )
    verdict: Verdict = "consistent"
    if disagrees:
        verdict = "unexplained"
    elif effects:
        verdict = "ambiguous" if any(e.alternatives for e in effects) else "named"
    where = regions(before.channels, case.fitted.tests) if verdict != "consistent" else ()
    shifts = _shifts(before, after) if effects else ()
    smooth = variations_of(problem, final, case.noise) if disagrees else ()
    separate = next_test(problem, final, rivals, scale, say) if verdict == "ambiguous" else None
    gaps = (before.reduced_chi2, after.reduced_chi2)
    return DiagnosisResult(
        record=case.fitted.record,
        verdict=verdict,
        headline=headline(verdict, effects, where, held, gaps, shifts),
        sentences=further_sentences(effects, before, smooth),
        where=where,
        where_after=regions(after.channels, case.fitted.tests) if disagrees else (),
        effects=effects,
        candidates=table,
        absorbed=tuple(c.name for c in table if c.state == "absorbed"),
        gap_before=gaps[0],
        gap_after=gaps[1],
        held_out=held,
        next_test=separate,
        before=before,
        after=after,
        shifts=shifts,
        variations=smooth,
        evidence=_evidence(case, rivals),
        noise=_noise(case),
        left_over_p=left.p_value,
        seconds=0.0,
        notes=after.notes,
        warnings=(*after.warnings, *(f"{k[0]}, {k[1]}: {n.warning}" for k, n in case.noise.items() if n.warning)),
    )


def _named(name: str, after: FitResult, rivals: Rivals, p_value: float, closed: float, gain: float) -> NamedEffect:
    estimate = after.parameters[name]
    info = EFFECTS[name]
    alike = tuple(Alternative(r.name, r.fit.values[r.name], EFFECTS[r.name].unit, r.chi2_more) for r in rivals.alike)
    return NamedEffect(
        name=name,
        value=estimate.value,
        unit=info.unit,
        std=estimate.std,
        ci95=estimate.ci95,
        p_value=p_value,
        strength=float(np.sqrt(max(gain, 0.0))),
        gap_closed=closed,
        sentence=info.sentence,
        alternatives=alike,
        at_bound=estimate.at_bound,
    )


def _shifts(before: FitResult, after: FitResult) -> tuple[ParameterShift, ...]:
    return tuple(
        ParameterShift(name, p.unit, p.value, after.parameters[name].value, after.parameters[name].std)
        for name, p in before.parameters.items()
        if not p.fixed
    )


def _evidence(case: Case, rivals: dict[str, Rivals]) -> tuple[Evidence, ...]:
    """z of each named effect as a sum over rows, beside the model without it."""
    found = []
    for name, rival in rivals.items():
        at = case.problem.with_all_columns(rival.without)
        own = screen(at, [name], case.steps, level=LEVEL).best(name)
        if own is None:
            continue
        share = -own.direction * at.residual[at.used]
        for key, rows in case.problem.rows().items():
            test = case.fitted.tests[key[0]]
            found.append(Evidence(name, *key, test.spool_position, test.direction, test.temperature, share[rows]))
    return tuple(found)


def _noise(case: Case) -> tuple[ChannelNoiseFound, ...]:
    found = []
    for key, n in case.noise.items():
        rows = case.fitted.tests[key[0]].rows
        found.append(
            ChannelNoiseFound(
                *key, float(np.sqrt(np.mean(n.std**2))), n.source, n.correlation.share * n.correlation.phi,
                n.correlation_source, rows / n.correlation.inflation, rows,
            )
        )  # fmt: skip
    return tuple(found)
