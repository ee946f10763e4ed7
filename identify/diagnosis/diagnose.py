"""The whole diagnosis of one record: fit, find where, name, confirm on rows held out, say what remains.

The dynamic part of a record opened for diagnosis: its plain fit, its noise as stated, and the library beside it.

One diagnosis of a record with dynamic tests: the static part first, then motion with what it gave.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fitting.fit_motion import joined, run_fit_motion
from thermohyd.identify.fitting.parameters import IN_MOTION, ParameterPlan, Prior
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.noise.level import run_differences
from thermohyd.numerics import require_float64

from .case import Case, Progress, choose, open_case
from .conclusion import conclude
from .final_model import final_model
from .library_fit import Noise
from .motion_problem import MotionProblem, motion_library
from .record_noise import NoiseFound, first_noise, repeats_in
from .result import DiagnosisResult, Verdict
from .screening import finite_steps


def open_motion(
    record: BenchRecord,
    say: Progress = lambda _: None,
    static: FitResult | None = None,
    effects: Mapping[str, float] | None = None,
) -> Case:
    """Fit the parameters of motion as `fit` does, then the same with the null bias free: a null may move.

    static: what the record's static tests gave, held here but for the null bias, which keeps to its error bar. effects: found
    there. The noise is taken as stated and white until a first search has found what is missing: a misfit of motion looks
    like noise with a memory.
    """
    data = record.dynamic
    assert data is not None
    known = None if static is None else {name: found.value for name, found in static.parameters.items()}
    known = None if known is None else {name: v for name, v in known.items() if name not in (effects or {})}
    fitted = run_fit_motion(record, say, known)
    own = {name: fitted.plans[name] for name in (*IN_MOTION, *(n for n in fitted.free if n not in IN_MOTION))}
    if any(test.time is not None for test in data.tests.values()) and "null_bias" not in own:
        own |= _null(record, fitted.plans["null_bias"], static)
    fitted = replace(fitted, plans={**fitted.plans, **own})
    tests = fitted.tests
    problem = MotionProblem(
        record, tests, own, motion_library(data.tests, data.actuator.heat), first_noise(fitted.noise), held=fitted.plans,
        known_effects=dict(effects or {}),
    )  # fmt: skip
    repeats = {}
    for name, test in data.tests.items():
        for channel in test.channels:
            pieces = run_differences(test, channel)
            size = float(np.sqrt(np.mean(fitted.noise[name, channel.name].std ** 2)))
            repeats[name, channel.name] = repeats_in([piece / size for piece in pieces])
    noise = {
        key: NoiseFound(n.std, problem.noise.correlation[key], n.source, "taken for white", n.known)
        for key, n in fitted.noise.items()
    }
    correlation = {key: r.correlation for key, r in repeats.items() if r is not None}
    problem = problem.with_noise(Noise(problem.noise.std, {**problem.noise.correlation, **correlation}))
    say("the plain model with its null free")
    start = dict(zip(fitted.free, (float(v) for v in fitted.solution.p), strict=True))
    base = problem.fit(start=start, hops=True)
    say("what each effect would do")
    steps = finite_steps(problem, problem.with_all_columns(base), problem.library.names)  # pyright: ignore
    return Case(fitted, problem, repeats, noise, base, steps)


def _null(record: BenchRecord, plan: ParameterPlan, static: FitResult | None) -> dict[str, ParameterPlan]:
    """The null bias as one more free parameter, unless the user holds it."""
    chosen = record.start.get("null_bias")
    if chosen is not None and chosen.fixed:
        return {}
    found = None if static is None else static.parameters.get("null_bias")
    prior = Prior(plan.start, found.std) if found is not None and found.std else plan.prior
    return {"null_bias": replace(plan, fixed=False, prior=prior)}


ORDER: tuple[Verdict, ...] = ("consistent", "named", "ambiguous", "unexplained")
Conclude = Callable[[Case], DiagnosisResult]


def diagnose_motion(
    record: BenchRecord, static: DiagnosisResult | None, conclude: Conclude, say: Progress = lambda _: None
) -> DiagnosisResult:
    """conclude: what follows an opened case (`diagnose.diagnose_case`). static: the diagnosis of the static tests, if any."""
    if static is None:
        return in_words_of_motion(conclude(open_motion(record, say)))
    found = {effect.name: effect.value for effect in static.effects}
    motion = in_words_of_motion(conclude(open_motion(record, say, static.after, found)))
    return _both(record, static, motion)


def in_words_of_motion(result: DiagnosisResult) -> DiagnosisResult:
    """The headline speaks of the actuator."""
    return replace(
        result, headline=result.headline.replace("The ideal valve explains", "The actuator's model explains")
    )


def _both(record: BenchRecord, static: DiagnosisResult, motion: DiagnosisResult) -> DiagnosisResult:
    verdict = max(static.verdict, motion.verdict, key=ORDER.index)
    lead = static.headline if static.verdict == motion.verdict == "consistent" else f"Static tests: {static.headline}"
    end = motion.headline if static.verdict == motion.verdict == "consistent" else f"Dynamic tests: {motion.headline}"
    seen = {c.name for c in motion.candidates}
    # Of the whole record: the model that is written knows its actuator by it.
    after, before = (
        replace(joined(a, b), record=record) for a, b in ((static.after, motion.after), (static.before, motion.before))
    )
    extra = {e.name: motion.after.parameters[e.name] for e in motion.effects}
    return replace(
        static,
        record=record,
        verdict=verdict,
        headline=f"{lead} {end}",
        sentences=(*static.sentences, *motion.sentences),
        where=(*static.where, *motion.where),
        where_after=(*static.where_after, *motion.where_after),
        effects=(*static.effects, *motion.effects),
        candidates=(*(c for c in static.candidates if c.name not in seen), *motion.candidates),
        absorbed=tuple(dict.fromkeys((*static.absorbed, *motion.absorbed))),
        gap_before=before.reduced_chi2,
        gap_after=after.reduced_chi2,
        held_out=motion.held_out if motion.effects or not static.effects else static.held_out,
        next_test=static.next_test or motion.next_test,
        before=before,
        after=replace(after, parameters={**after.parameters, **extra}),
        shifts=(*static.shifts, *motion.shifts),
        variations=(*static.variations, *motion.variations),
        evidence=(*static.evidence, *motion.evidence),
        noise=(*static.noise, *motion.noise),
        left_over_p=min(static.left_over_p, motion.left_over_p),
        notes=tuple(dict.fromkeys((*static.notes, *motion.notes))),
        warnings=tuple(dict.fromkeys((*static.warnings, *motion.warnings))),
    )


def diagnose(record: BenchRecord, *, learn: bool = False, progress: Progress | None = None) -> DiagnosisResult:
    """Find where a record disagrees with the ideal valve, name the missing effects, add them and show the gap close.

    learn: add the leading smooth variation to the model where no effect explains the rest (marked as empirical).
    Raises what `fit` raises: BenchInputError where the record determines nothing, RuntimeError in single precision.
    Each step can be called alone: `open_case`, `choose`, `final_model`, `conclude`.
    """
    require_float64("diagnose")
    began = time.perf_counter()
    say = progress or (lambda _: None)
    conclusion = lambda case: diagnose_case(case, learn=learn, say=say)
    if record.dynamic is None:
        result = conclusion(open_case(record, say))
    else:
        static = conclusion(open_case(replace(record, dynamic=None), say)) if record.tests else None
        result = diagnose_motion(record, static, conclusion, say)
    return replace(result, seconds=time.perf_counter() - began)


def diagnose_case(case: Case, *, learn: bool = False, say: Progress = lambda _: None) -> DiagnosisResult:
    """What follows `open_case`; `seconds` of the result is left at 0."""
    case, found, split = choose(case, say)
    model = final_model(case, found, split, say)
    return conclude(case, found, split, model, learn=learn, say=say)
