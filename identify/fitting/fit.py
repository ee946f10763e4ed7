"""Fit the parameters of a record's valve and actuator to all its tests, with error bars that allow for correlated noise."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from threading import local
from typing import Any

import numpy as np

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.noise.level import ChannelNoise, initial_noises
from thermohyd.identify.reduction.bad_rows import beside_the_fit
from thermohyd.identify.reduction.limits import without_limits
from thermohyd.identify.reduction.reduce import reduce_test
from thermohyd.kept_programs import begin_work
from thermohyd.numerics import require_float64
from thermohyd.side_by_side import each

from .boxes import Box
from .fit_effects import fit_with, known_effects
from .least_squares import LeastSquaresResult, Residual, as_converged, multi_start, solve
from .library import library_for
from .model_form import evidence_of_fits, fitted_with, other_law, plans_with_other_law, refit, with_model_form
from .outcome import Fitted, Key, fit_result, uncertainty_of
from .parameters import PARAMETERS, ParameterPlan, free_parameters, plan_parameters, readings_of
from .problem import Problem
from .profile_intervals import covariance_holds, profile_intervals
from .readings import white_noise
from .relative import with_relatives
from .result import FitResult, OtherLaw, StartOutcome
from .reversed_signs import reversed_channels, warning_of, with_signs_turned
from .row_blocks import plain_by_rows
from .sensed import sensed_channels, sensor_plans, with_starts
from .starts import basin_hopping, null_position
from .static_readings import base_valve, channel_slices, quantities_of, static_data
from .static_residuals import FitArgs, box_of, prior_rows, residual_of
from .trimmed import FAR, trimmed_points
from .uncertainty import largest_change, settled_noise
from .usual_values import HOPELESS, contradicted, starts_beside, usual_is_asked, with_usual


# Rounds of re-estimating unknown noise from the residuals; each starts from the last optimum and costs a few steps.
MOST_ROUNDS = 8
SETTLED = 0.01  # relative change of every channel's noise
STARTS = 4
# Two unscreened candidates: a screening is a second program to compile, and basin hopping finds what they do not.
CANDIDATES = 2
# A search stops a hundred-thousandth of a standard error from its optimum: one step earlier than the solver's default.
CLOSE_ENOUGH = 1e-5
PROFILE_CLOSE_ENOUGH = 1e-2  # chi-square is then right to 1e-4
# An end counts as an optimum up to here: a twentieth of a standard error is nothing to anybody.
BELIEVE_BELOW = 0.05
# Points at which most readings agree with a model that lacks something, from which its fit is tried again; and what counts as lower.
DEEPER, LOWER = 2, 0.999
SLOPES = 1e-3  # the same, from where on an end may lie on the slope of a kink: then the other side is looked at
MOST_BETTER = 4  # times that a profile may run into a deeper optimum
CLOSE = 25.0  # chi-square up to which the other law of an edge is no worse than this one, and its intervals looked at closely
TINY = 1e-12  # chi-square per reading of readings that the model meets to rounding: nothing is left to judge by

Progress = Callable[[str], None]


def fit(
    record: BenchRecord,
    *,
    effects: Iterable[str] = (),
    model_form: bool = False,
    starts: int = STARTS,
    progress: Progress | None = None,
) -> FitResult:
    """Fit the free parameters of a record's valve and actuator to all its tests at once, static and dynamic ones.

    effects: names of effects (docs/physics.md section 8.2) to free beside them, of a record of static tests; error bars are
    then those of the covariance. `diagnose` finds out which ones are missing.
    model_form: fit the static tests with the other law of an edge too, and say how far each parameter moves (`other_law`,
    `model_form` of each estimate). The command does so by default; here it is asked for, since it is a second fit to compile.

    Raises BenchInputError where the record cannot determine anything (no readings, everything held, fewer readings than
    parameters, an effect that it cannot speak of) and RuntimeError in single precision. A fit that does not converge is
    returned with `converged` False.
    """
    return fit_and_fitted(record, effects=effects, model_form=model_form, starts=starts, progress=progress)[0]


def fit_and_fitted(
    record: BenchRecord,
    *,
    effects: Iterable[str] = (),
    model_form: bool = False,
    starts: int = STARTS,
    progress: Progress | None = None,
) -> tuple[FitResult, Fitted]:
    """What `fit` returns, and the fit as whoever looks around its optimum needs it."""
    require_float64("fit")
    begin_work()
    began = time.perf_counter()
    moving = bool(record.dynamic_tests)
    freed_effects = known_effects(record, effects)
    if freed_effects and moving:
        raise BenchInputError("effects are freed by name in records of static tests only", file=record.folder)
    still = record.static_tests or not moving
    static = run_fit(record, starts=starts, progress=progress) if still else None
    asked = lambda fitted, own: _other_law(fitted, own, progress) if model_form else None
    if not moving:
        assert static is not None
        if freed_effects:
            static = fit_with(static, freed_effects, progress, rounds=MOST_ROUNDS, enough=SETTLED)
            result = fit_result(static)
        else:
            static, result = with_intervals(static, progress)
        fitted = static
        result = with_model_form(result, asked(static, result))
    else:
        # Here, not above: a static fit does not wait for the solvers of motion.
        from .fit_motion import fit_together, run_fit_motion

        known, freed = (None, ()) if static is None else (static_values(static), static.free)
        motion = run_fit_motion(record, progress, known, freed)
        fitted = motion if static is None else fit_together(record, static, motion, progress)
        result = fit_result(fitted)
        if static is not None:
            result = with_model_form(result, asked(static, fit_result(static)))
    return replace(result, seconds=time.perf_counter() - began), fitted


def static_values(fitted: Fitted) -> dict[str, float]:
    """{parameter: value} of every parameter of a fit of static tests, held ones at their starts."""
    plans = fitted.plans.items()
    return {name: fitted.values.get(name, plan.start) for name, plan in plans if plan.shown}


def run_fit(
    record: BenchRecord, *, starts: int = STARTS, progress: Progress | None = None, by_blocks: bool = False
) -> Fitted:
    """Fit a record's static tests: reduce raw logs, search from several starts, settle the noise. `fit_result` says it in words.

    by_blocks: see `StaticSearch`.
    """
    say = progress or (lambda _: None)
    tests: dict[str, TestRecord] = {}
    warnings = list(record.warnings)
    plans = plan_parameters(record.valve, record.start) | sensor_plans(record.static_tests, record)
    plans = with_relatives(plans, record.static_tests, record)
    free = free_parameters(record, plans, record.static_tests)
    for name, test in record.static_tests.items():
        if test.rows > 2000:
            say(f"reducing {name}: {test.rows:,} rows")
        turned = reversed_channels(test)
        warnings += [warning_of(test, channel) for channel in turned]
        tests[name] = reduce_test(without_limits(with_signs_turned(test, turned)))
    free_parameters(record, plans, tests)  # once more: a raw log has fewer points than rows
    noise = initial_noises(tests.values())
    if sensed_channels(tests):
        plans = _sensors_started(record, tests, plans, noise)
    problem = StaticSearch(record, tests, plans, free, by_blocks)
    say(f"fitting {len(free)} parameters to {readings_of(tests):,} readings")
    first = problem.first_starts()
    outcomes = multi_start(
        residual_of(free),
        problem.boxes,
        problem.args(noise),
        first,
        count=starts,
        candidates=CANDIDATES,
        tolerance=CLOSE_ENOUGH,
        believe=BELIEVE_BELOW,
        progress=say,
        solver=problem.search,
    )
    say("restarts beside the best of them")
    solution = problem.basin_hopping(outcomes[0], noise)
    if solution.cost > FAR * readings_of(tests):
        say("restarts where most readings agree")
        solution = problem.unbent(solution, noise)
    lower = solution.cost < outcomes[0].cost
    starts_tried = [
        problem.outcome(solution, restart=lower),
        *map(problem.outcome, outcomes if lower else outcomes[1:]),
    ]
    misfits = {key: solution.residual[rows] * noise[key].used for key, rows in channel_slices(tests).items()}
    if changed := beside_the_fit(tests, misfits):
        say("left out rows beyond what their neighbours allow; fitting again")
        tests = {**tests, **changed}
        noise = initial_noises(tests.values())
        problem = replace(problem, tests=tests)
        solution = problem.basin_hopping(problem.solve(problem.args(noise), solution.p), noise)
    warnings += [fault.sentence for test in tests.values() for fault in test.faults]
    solution, noise = problem.settled(solution, noise)
    fitted = Fitted(record, tests, plans, free, noise, solution, tuple(starts_tried), tuple(warnings))
    return _beside_what_is_usual(fitted, problem, say) if usual_is_asked(fitted) else fitted


def _beside_what_is_usual(fitted: Fitted, problem: "StaticSearch", say: Progress, *, last: bool = False) -> Fitted:
    """The fit with its flow coefficients held near what is usual, unless the readings contradict that (`usual_values`).

    last: its end is as deep as any; else the readings alone are asked again from a deeper one.
    """
    say("flow coefficients held near what is usual")
    noise, alone = fitted.noise, fitted.solution.p
    usual = replace(problem, plans=with_usual(fitted.plans))
    args = usual.args(noise)
    cost = problem.solve(problem.args(noise), alone).cost
    starts = [*starts_beside(alone, fitted.free, usual.plans), *usual.first_starts()]
    ends = each(lambda start: usual.solve(args, start), starts)
    best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
    if best.cost < cost and not last:
        solution, noise = problem.settled(problem.solve(problem.args(noise), best.p), noise)
        deeper = replace(fitted, noise=noise, solution=solution)
        return _beside_what_is_usual(deeper, problem, say, last=True) if usual_is_asked(deeper) else deeper
    if not contradicted(fitted, best.cost - cost, HOPELESS):
        best = usual.basin_hopping(best, noise)
    if contradicted(fitted, best.cost - cost):
        return fitted
    solution, noise = usual.settled(best, noise)
    return replace(fitted, plans=usual.plans, noise=noise, solution=solution)


def _sensors_started(
    record: BenchRecord, tests: dict[str, TestRecord], plans: dict[str, ParameterPlan], noise: dict[Key, ChannelNoise]
) -> dict[str, ParameterPlan]:
    """The plans with free gains and zeros started where the nominal valve's readings put them."""
    values = {name: plan.start for name, plan in plans.items() if name in PARAMETERS}
    null, plan = null_position(tests), plans["null_bias"]
    if null is not None and not plan.fixed and not plan.given:
        values["null_bias"] = float(np.clip(null, plan.lower, plan.upper))
    data = static_data(tests, {key: n.used for key, n in noise.items()})
    found = quantities_of(base_valve(record, values), data)
    of = {(c.test, c.name): np.asarray(q)[: tests[c.test].rows] for c, q in zip(data.channels, found, strict=True)}
    return with_starts(plans, tests, of)


def with_intervals(fitted: Fitted, progress: Progress | None, *, settle: bool = True) -> tuple[Fitted, FitResult]:
    """The fit, and the same in figures; intervals by profiles of chi-square where the covariance at the optimum does not hold.

    Another fit than the one given where a profile ran into a deeper optimum. settle: the noise that is not known is then
    estimated once more.
    """
    say = progress or (lambda _: None)
    problem = StaticSearch(fitted.record, fitted.tests, fitted.plans, fitted.free)
    for _ in range(MOST_BETTER):
        known, best, noise = uncertainty_of(fitted), as_converged(fitted.solution), fitted.noise
        if not best.converged or best.cost <= TINY * len(best.residual):
            break
        reach, args = known.reach(len(fitted.free)), problem.args(noise)
        hold = lambda start, held, args=args: problem.solve(args, start, held)
        matrix = known.covariance.matrix / np.sqrt(np.outer(known.inflation, known.inflation))
        if covariance_holds(best, problem.boxes, matrix, reach * float(np.sqrt(np.median(known.inflation))), hold):
            break
        say("intervals by profiles of chi-square")
        std = np.sqrt(np.diag(matrix))
        profiles = profile_intervals(best, problem.boxes, std, reach**2 * known.inflation, hold, say)
        if profiles.better is None:
            return fitted, fit_result(fitted, uncertainty=known, intervals=profiles.intervals)
        say("a profile found a better optimum")
        better = problem.basin_hopping(problem.solve(args, profiles.better.p), noise)
        noise = problem.settle(noise, better) if settle else noise
        better = problem.solve(problem.args(noise), better.p)
        fitted = replace(
            fitted, noise=noise, solution=better if better.converged else problem.basin_hopping(better, noise)
        )
    return fitted, fit_result(fitted)


def _other_law(fitted: Fitted, own: FitResult, progress: Progress | None) -> OtherLaw | None:
    """The same static tests with the other law of an edge, at the noise that this fit left; None where nothing is free there."""
    say = progress or (lambda _: None)
    record, plans, free = plans_with_other_law(fitted)
    if not free or not own.converged:
        return None
    say(f"the same with the {record.valve.edge_law} law of the edge")
    effects = tuple(name for name in fitted.free if name not in plans)
    if effects:
        library = library_for(fitted.tests.values())
        problem = Problem(fitted.record, fitted.tests, dict(fitted.plans), library, white_noise(fitted.noise))
        other = fit_result(fitted_with(*refit(problem, effects, fitted.values), fitted))
    else:
        search = StaticSearch(record, fitted.tests, plans, free)
        beside = np.array([fitted.values.get(name, plans[name].start) for name in free])
        starts = [
            np.clip(beside, [plans[n].lower for n in free], [plans[n].upper for n in free]),
            *search.first_starts(),
        ]
        args = search.args(fitted.noise)
        ends = each(lambda start: search.solve(args, start), starts)
        best = min(ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)
        solution = search.basin_hopping(best, fitted.noise)
        there = Fitted(record, fitted.tests, plans, free, fitted.noise, solution, (), ())
        # The interval of a law that the data refute need not be right to a tenth: profiles beside a misfit take long.
        close = solution.cost <= fitted.solution.cost + CLOSE
        other = with_intervals(there, progress, settle=False)[1] if close else fit_result(there)
    return other_law(own, other, evidence_of_fits(own, other))


@dataclass(frozen=True)
class StaticSearch:
    """The plain fit of static tests: only the noise changes between its solves.

    A search is compiled as a whole for tests of these lengths: four seconds once, and then half of the time of each fit. by_blocks: the
    model is evaluated by blocks of rows, whose programs serve every record: for a diagnosis, which needs such programs anyhow.
    """

    record: BenchRecord
    tests: dict[str, TestRecord]
    plans: dict[str, ParameterPlan]
    free: tuple[str, ...]
    by_blocks: bool = False

    @property
    def boxes(self) -> list:
        return [box_of(self.plans[name]) for name in self.free]

    def args(self, noise: dict[Key, ChannelNoise]) -> FitArgs:
        values = {name: plan.start for name, plan in self.plans.items() if name in PARAMETERS}
        valve = base_valve(self.record, values, heat="heat_retention" in self.free)
        data = static_data(self.tests, {key: n.used for key, n in noise.items()})
        return FitArgs(valve, data, *prior_rows([self.plans[name] for name in self.free]))

    def first_starts(self) -> list[np.ndarray]:
        """The nominal valve; and the same with its null where the curves show it, unless the user placed it."""
        nominal = np.array([self.plans[name].start for name in self.free])
        null = null_position(self.tests)
        plan = self.plans["null_bias"]
        if null is None or plan.fixed or plan.given:
            return [nominal]
        shifted = nominal.copy()
        shifted[self.free.index("null_bias")] = np.clip(null, plan.lower, plan.upper)
        return [shifted, nominal]

    def settle(self, noise: dict[Key, ChannelNoise], solution: LeastSquaresResult) -> dict[Key, ChannelNoise]:
        """The noise of each channel as the residuals show it (`settled_noise`)."""
        jacobian = solution.jacobian * np.array([self.plans[name].info.scale for name in self.free])
        null = self.free.index("null_bias") if "null_bias" in self.free else None
        position = None if null is None else solution.jacobian[:, null]
        return settled_noise(noise, channel_slices(self.tests), solution.residual, jacobian, position)

    def settled(
        self, solution: LeastSquaresResult, noise: dict[Key, ChannelNoise]
    ) -> tuple[LeastSquaresResult, dict[Key, ChannelNoise]]:
        """The optimum and the noise once neither moves the other; over the kinks where it is none yet."""
        for _ in range(MOST_ROUNDS):
            before, noise = noise, self.settle(noise, solution)
            if largest_change(before, noise) < SETTLED:
                break
            solution = self.solve(self.args(noise), solution.p)
        return (self.basin_hopping(solution, noise) if solution.relative_offset > SLOPES else solution), noise

    def solve(
        self, args: FitArgs, start: np.ndarray, held: Mapping[int, float] | None = None, enough: float = np.inf
    ) -> LeastSquaresResult:
        """From `start`, with the parameters of these indices held at these values; given up where it promises no end below `enough`."""
        boxes = self.boxes
        for i, value in (held or {}).items():
            boxes[i] = boxes[i].held_at(value)
        tolerance = PROFILE_CLOSE_ENOUGH if held else CLOSE_ENOUGH
        residual = residual_of(self.free)
        return self.search(residual, boxes, args, start, tolerance=tolerance, believe=BELIEVE_BELOW, enough=enough)

    def search(
        self, residual: Residual, boxes: Sequence[Box], args: FitArgs, start: Any = None, **limits: Any
    ) -> LeastSquaresResult:
        """`solve` of this search; limits: its `tolerance`, `believe`, `enough`."""
        if not self.by_blocks:
            return solve(residual, boxes, args, start, **limits)
        if getattr(self._laid_out, "args", None) is not args:
            self._laid_out.args, self._laid_out.both = args, plain_by_rows(self.free, args)
        return solve(None, boxes, None, start, both=self._laid_out.both, **limits)

    @cached_property
    def _laid_out(self) -> local:
        """The blocks of the last data that a thread searched."""
        return local()

    def basin_hopping(self, best: LeastSquaresResult, noise: dict[Key, ChannelNoise]) -> LeastSquaresResult:
        args = self.args(noise)
        solve_from = lambda start, enough: self.solve(args, start, enough=enough)
        return basin_hopping(best, self.free, solve_from, usual={name: self.plans[name].start for name in self.free})

    def unbent(self, best: LeastSquaresResult, noise: dict[Key, ChannelNoise]) -> LeastSquaresResult:
        """The fit started again where most rows agree with the model (`trimmed_points`), where it then ends lower than `best`."""
        slices, args = channel_slices(self.tests), self.args(noise)
        rows = channel_slices(self.tests, size=lambda count: count)
        asked = np.concatenate([np.isfinite(noise[key].used) for key in rows])

        def fit_to(kept: np.ndarray, at: np.ndarray) -> np.ndarray:
            only = {k: replace(noise[k], used=np.where(kept[own], noise[k].used, np.inf)) for k, own in rows.items()}
            return self.solve(self.args(only), at).p

        def residual_at(at: np.ndarray) -> np.ndarray:
            held = self.solve(args, at, dict(enumerate(at.tolist())))
            return np.concatenate([held.residual[slices[key]] for key in rows])

        for start in trimmed_points(best.p, rows, asked, fit_to, residual_at)[:DEEPER]:
            found = self.solve(args, start)
            if found.cost < LOWER * best.cost:
                best = self.basin_hopping(found, noise)
        return best

    def outcome(self, result: LeastSquaresResult, restart: bool = False) -> StartOutcome:
        start = dict(zip(self.free, (float(v) for v in result.start), strict=True))
        return StartOutcome(start, result.cost, result.converged, result.message, result.steps, restart)
