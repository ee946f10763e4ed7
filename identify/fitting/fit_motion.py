"""Fit a record with dynamic tests: first the parameters of motion alone, then everything together with the static tests."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.noise.level import ChannelNoise, initial_noises
from thermohyd.identify.reduction.bad_rows import beside_the_fit
from thermohyd.identify.reduction.limits import without_limits
from thermohyd.identify.reduction.reduce import reduce_test
from thermohyd.side_by_side import each

from .fit_effects import settled
from .least_squares import LeastSquaresResult
from .library import NOTHING, Library
from .motion_readings import require_actuator
from .outcome import Fitted, Key
from .parameters import IN_MOTION, PARAMETERS, free_parameters, plan_motion, readings_of
from .problem import MOST_STEPS, Problem
from .problem_fit import Fit
from .problem_solution import solution_of
from .readings import MotionReadings, Noise, white_noise
from .relative import with_relatives
from .result import StartOutcome
from .sensed import sensed_channels, sensor_plans, traced, with_starts
from .trimmed import FAR


# Of noise and fit in turn: each about squares what the last one was off, so the second or third ends it.
MOST_ROUNDS = 4
SETTLED = 0.02  # relative change of every channel's noise
# Shares of each run that are fitted one after the other: a long record that swings traps a search that begins far away.
HORIZONS = (0.3, 0.6, 1.0)
GLANCE = 6  # steps of a search on part of the runs
# Other starts: factors on the parameters of motion.
OTHERS = ({"spool_frequency": 0.6, "bulk_modulus_factor": 0.6}, {"spool_frequency": 1.8, "bulk_modulus_factor": 0.6})

Progress = Callable[[str], None]


def run_fit_motion(
    record: BenchRecord,
    progress: Progress | None = None,
    known: Mapping[str, float] | None = None,
    also: tuple[str, ...] = (),
) -> Fitted:
    """Fit the parameters of motion to the dynamic tests alone: start, lengthen the horizon, solve, and settle the noise.

    known: static values to hold (see `plan_motion`). also: of these, what a fit of all tests will free.
    Raises BenchInputError where the record determines nothing.
    """
    say = progress or (lambda _: None)
    plans = plan_motion(record.valve, require_actuator(record), record.start, known)
    tests: dict[str, TestRecord] = {
        name: reduce_test(without_limits(test)) for name, test in record.dynamic_tests.items()
    }
    plans = with_relatives(plans | sensor_plans(tests, record), tests, record)
    free, readings = free_parameters(record, plans, tests), readings_of(tests)
    noise = initial_noises(tests.values())
    say(f"fitting {len(free)} parameters of motion to {readings:,} readings")
    problem = Problem(record, tests, plans, NOTHING, white_noise(noise), also=also)
    if sensed_channels(tests):
        problem = _sensors_started(problem)
        plans = problem.plans
    ends = [_grown(problem, {}, say)]
    if ends[0].chi2 > FAR * readings or not np.isfinite(ends[0].chi2):
        scales = traced(tests, record)
        others = OTHERS if not scales else ({scales[0]: 0.3}, {scales[0]: 3.0})
        say(f"{len(others)} other starts")

        def begun(factors: Mapping[str, float]) -> Fit:
            at = {n: float(np.clip(plans[n].start * f, plans[n].lower, plans[n].upper)) for n, f in factors.items()}
            return _grown(problem, {n: value for n, value in at.items() if n in free}, lambda _: None)

        ends += each(begun, others)
    ends.sort(key=lambda end: (not np.isfinite(end.chi2), end.chi2))
    starts = tuple(_outcome(problem, end) for end in ends)
    best = ends[0]
    misfits = {key: best.residual[rows] * problem.noise.std[key] for key, rows in problem.rows().items()}
    if np.isfinite(best.chi2) and (changed := beside_the_fit(tests, misfits)):
        say("left out rows beyond what their neighbours allow; fitting again")
        tests = {**tests, **changed}
        noise = initial_noises(tests.values())
        problem = replace(problem, tests=tests, noise=white_noise(noise))
        best = problem.fit(start=best.values)
    faults = (fault.sentence for test in tests.values() for fault in test.faults)
    fitted = Fitted(record, tests, plans, free, noise, best.solution, starts, (*record.warnings, *faults))
    return settled(problem, best, fitted, rounds=MOST_ROUNDS, enough=SETTLED)


def fit_together(record: BenchRecord, static: Fitted, motion: Fitted, progress: Progress | None = None) -> Fitted:
    """Fit all tests of a record at once, from where the static ones and the dynamic ones ended: every error bar is a joint one.

    A parameter that both kinds of tests see is one parameter; what `[start]` holds or knows beforehand holds for both.
    """
    say = progress or (lambda _: None)
    say("fitting static and dynamic tests together")
    noise = {**static.noise, **motion.noise}
    problem = joint_problem(record, static, motion, white_noise(noise))
    fit = problem.fit(start={**motion.values, **static.values}, patient=True)
    fitted = jointly_fitted(problem, fit, noise, static, motion)
    return settled(problem, fit, fitted, rounds=MOST_ROUNDS, enough=SETTLED)


def joint_problem(
    record: BenchRecord, static: Fitted, motion: Fitted, noise: Noise, library: Library = NOTHING
) -> Problem:
    """All tests of a record in one problem; a parameter is planned as the tests plan it that show it best."""
    own = [name for name in motion.plans if name in IN_MOTION or name not in {*PARAMETERS, *static.plans}]
    plans = {**static.plans, **{name: motion.plans[name] for name in own}}
    return Problem(record, {**static.tests, **motion.tests}, plans, library, noise)


def jointly_fitted(
    problem: Problem, fit: Fit, noise: dict[Key, ChannelNoise], static: Fitted, motion: Fitted
) -> Fitted:
    """A fit of a joint problem, with the starts and warnings of the two that it began from."""
    starts = (*static.starts, *motion.starts)
    warnings = tuple(dict.fromkeys((*static.warnings, *motion.warnings)))
    return Fitted(problem.record, problem.tests, problem.plans, fit.free, noise, fit.solution, starts, warnings)


def _sensors_started(problem: Problem) -> Problem:
    """The problem with free gains and zeros started where the runs of the machine as described put them."""
    (part,) = problem.readings
    assert isinstance(part, MotionReadings)
    start = np.array([problem.plans[name].start for name in part.parameters])
    read = part.simulator.read(part.parameters, (), start)
    if read.failure:
        return problem
    settled = traced(problem.tests, problem.record)
    return replace(problem, plans=with_starts(problem.plans, problem.tests, read.values, settled))


def _grown(problem: Problem, start: Mapping[str, float], say: Progress) -> Fit:
    """The first part of every run, then more of it, then all."""
    moving = problem.tests.values()
    values, fit = dict(start), None
    for horizon in HORIZONS if any(test.axis == "time" for test in moving) else (1.0,):
        say(f"fitting the first {100 * horizon:.0f} % of every run" if horizon < 1.0 else "fitting all rows")
        masks = [within(test, horizon) for test in moving for _ in test.channels]
        part = problem.with_rows(None if horizon == 1.0 else np.concatenate(masks))
        fit = part.fit(start=values, most_steps=MOST_STEPS if horizon == 1.0 else GLANCE)
        if np.isfinite(fit.chi2):
            values = fit.values
    assert fit is not None
    return fit


def _outcome(problem: Problem, fit: Fit) -> StartOutcome:
    result: LeastSquaresResult = solution_of(problem, fit)
    start = dict(zip(fit.free, (float(v) for v in result.start), strict=True))
    return StartOutcome(start, fit.chi2, fit.converged, fit.message, result.steps)


def within(test: TestRecord, horizon: float) -> np.ndarray:
    """True in the first share of every run's span (rows,); a frequency test counts from the start."""
    if test.axis == "frequency" or test.time is None or horizon >= 1.0:
        return np.ones(test.rows, dtype=bool)
    inside = np.zeros(test.rows, dtype=bool)
    for code in np.unique(test.run):
        rows = test.run == code
        time = test.time[rows]
        inside[rows] = time <= time[0] + horizon * (time[-1] - time[0])
    return inside
