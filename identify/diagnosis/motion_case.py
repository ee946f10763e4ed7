"""The dynamic part of a record opened for diagnosis: its plain fit, its noise as stated, and the library beside it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..dynamic.fit_motion import run_fit_motion
from ..dynamic.noise import run_differences
from ..fit_result import FitResult
from ..parameters import IN_MOTION, ParameterPlan, Prior
from ..record import BenchRecord
from .case import Case, Progress
from .library_fit import Noise
from .motion_problem import MotionProblem, motion_library
from .record_noise import NoiseFound, first_noise, repeats_in
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
