"""Fit the parameters of motion to a record's dynamic tests; the valve's own stay what they are known to be.

One result of a record with static and dynamic tests: the static fit first, then motion with what it gave held.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord, DynamicData, DynamicTest
from thermohyd.identify.noise.level import ChannelNoise, first_noise_of, reweighted

from .least_squares import LeastSquaresResult, solve
from .misfit import verdict_of_motion
from .motion_readings import DynamicSimulator, Weighing, actuator_of, both_of, valve_of
from .outcome import Fitted, Key, fit_result
from .parameters import IN_MOTION, ParameterPlan, plan_motion
from .result import FitResult, Identifiability, StartOutcome
from .static_readings import box_of, channel_slices, padded_size


MOST_ROUNDS = 4
SETTLED = 0.02  # relative change of every channel's noise
# Shares of each run that are fitted one after the other: a long record that swings traps a search that begins far away.
HORIZONS = (0.3, 0.6, 1.0)
GLANCE, MOST_STEPS = 6, 40
# Of a standard error: a run is known to its solver's tolerance, and its steps change a little from one point to the next.
CLOSE_ENOUGH, BELIEVE = 1e-2, 5e-2
FAR = 3.0  # reduced chi-square from which other starts are tried
# Other starts: factors on the parameters of motion.
OTHERS = ({"spool_frequency": 0.6, "bulk_modulus_factor": 0.6}, {"spool_frequency": 1.8, "bulk_modulus_factor": 0.6})

Progress = Callable[[str], None]


def fit_motion(
    record: BenchRecord, progress: Progress | None = None, known: Mapping[str, float] | None = None
) -> tuple[FitResult, Fitted]:
    """The fit in figures and words, and before it was put into them. known: static values to hold (see `plan_motion`).

    Raises BenchInputError where the record determines nothing. A fit that does not converge says so.
    """
    fitted = run_fit_motion(record, progress, known)
    result = fit_result(fitted)
    rows = sum(test.rows for test in fitted.tests.values())
    words = verdict_of_motion(result.channels, result.converged, result.message)
    return replace(result, rows=rows, verdict=words), fitted


def simulator_of(record: BenchRecord, plans: Mapping[str, ParameterPlan], effects=None) -> DynamicSimulator:
    """The record's dynamic tests on its machine, held parameters at their starts."""
    data = dynamic_of(record)
    values = {name: plan.start for name, plan in plans.items() if name != "heat_retention" or plan.start > 0.0}
    valve = valve_of(record, values, effects)
    actuator = actuator_of(data.actuator, record.valve.rated_current, values)
    return DynamicSimulator(data.tests, valve, actuator, data.actuator.heat, record.valve.polarity)


def dynamic_of(record: BenchRecord) -> DynamicData:
    """The record's dynamic part. Raises BenchInputError where it has none."""
    if record.dynamic is None:
        raise BenchInputError("holds no dynamic test; add [tests.step] or [tests.frequency]", file=record.folder)
    return record.dynamic


def run_fit_motion(
    record: BenchRecord, progress: Progress | None = None, known: Mapping[str, float] | None = None
) -> Fitted:
    """Start, lengthen the horizon, solve, and settle the noise."""
    say = progress or (lambda _: None)
    data = dynamic_of(record)
    for test in data.tests.values():
        if not test.channels:
            raise BenchInputError("has no reading to fit", file=test.path)
    plans = plan_motion(record.valve, data.actuator, record.start, known)
    free = tuple(name for name, plan in plans.items() if not plan.fixed)
    noise = {(n, c.name): first_noise_of(t, c) for n, t in data.tests.items() for c in t.channels}
    readings = sum(len(n.std) for n in noise.values())
    if not free:
        raise BenchInputError("[start] holds every parameter fixed; free at least one", file=record.folder)
    if readings < len(free):
        raise BenchInputError(
            f"{readings} readings cannot determine {len(free)} parameters; hold some in [start] or add rows",
            file=record.folder,
        )
    say(f"fitting {len(free)} parameters of motion to {readings:,} readings")
    search = _Search(simulator_of(record, plans), plans, free)
    nominal = np.array([plans[name].start for name in free])
    outcomes = [search.grown(nominal, noise, say)]
    if outcomes[0].cost > FAR * readings or not np.isfinite(outcomes[0].cost):
        for factors in OTHERS:
            say("another start")
            begin = np.array(
                [np.clip(plans[n].start * factors.get(n, 1.0), plans[n].lower, plans[n].upper) for n in free]
            )
            outcomes.append(search.grown(begin, noise, lambda _: None))
    outcomes.sort(key=lambda o: (not np.isfinite(o.cost), o.cost))
    solution = outcomes[0]
    told = tuple(search.outcome(o) for o in outcomes)
    for _ in range(MOST_ROUNDS):
        settled = search.settle(noise, solution)
        change = max(float(np.max(np.abs(settled[k].used / noise[k].used - 1.0))) for k in noise)
        noise = settled
        if change < SETTLED:
            break
        solution = search.solve(solution.p, noise)
    return Fitted(record, dict(data.tests), plans, free, noise, solution, told, record.warnings)


class _Search:
    """One record's least-squares problem; noise and horizon change between its solves."""

    def __init__(self, simulator: DynamicSimulator, plans: dict[str, ParameterPlan], free: tuple[str, ...]) -> None:
        self.simulator, self.plans, self.free = simulator, plans, free

    @property
    def tests(self) -> dict[str, DynamicTest]:
        return self.simulator.tests

    def solve(
        self, start: np.ndarray, noise: Mapping[Key, ChannelNoise], horizon: float = 1.0, steps: int = MOST_STEPS
    ) -> LeastSquaresResult:
        weight = {key: within(self.tests[key[0]], horizon) / n.used for key, n in noise.items()}
        plans = [self.plans[name] for name in self.free]
        both = both_of(self.simulator, self.free, (), Weighing(weight, padded_size), plans)
        boxes = [box_of(plan) for plan in plans]
        return solve(None, boxes, None, start, tolerance=CLOSE_ENOUGH, max_steps=steps, both=both, believe=BELIEVE)

    def grown(self, start: np.ndarray, noise: Mapping[Key, ChannelNoise], say: Progress) -> LeastSquaresResult:
        """The first part of every run, then more of it, then all."""
        steps = any(test.time is not None for test in self.tests.values())
        found = None
        for horizon in HORIZONS if steps else (1.0,):
            say(f"fitting the first {100 * horizon:.0f} % of every run" if horizon < 1.0 else "fitting all rows")
            found = self.solve(start, noise, horizon, MOST_STEPS if horizon == 1.0 else GLANCE)
            if np.isfinite(found.cost):
                start = found.p
        assert found is not None
        return found

    def settle(self, noise: Mapping[Key, ChannelNoise], solution: LeastSquaresResult) -> dict[Key, ChannelNoise]:
        """Noise re-estimated from the residuals, where it is not known."""
        new = {}
        share = len(self.free) / max(len(solution.residual), 1)
        for key, rows in channel_slices(dict(self.tests)).items():
            misfit = solution.residual[rows] * noise[key].used
            new[key] = reweighted(noise[key], misfit, max(1.0 - share, 0.05))
        return new

    def outcome(self, result: LeastSquaresResult) -> StartOutcome:
        start = dict(zip(self.free, (float(v) for v in result.start), strict=True))
        return StartOutcome(start, result.cost, result.converged, result.message, result.steps)


def within(test: DynamicTest, horizon: float) -> np.ndarray:
    """1 in the first share of every run's span, else 0 (rows,); a frequency test counts from the start."""
    if test.time is None or horizon >= 1.0:
        return np.ones(test.rows)
    found = np.zeros(test.rows)
    for code in np.unique(test.run):
        rows = test.run == code
        time = test.time[rows]
        found[rows] = time <= time[0] + horizon * (time[-1] - time[0])
    return found


HELD = (
    "The static tests were fitted first; the dynamic fit holds the valve's parameters that they gave, so the error bars of "
    "the parameters of motion do not include theirs."
)


def joined(static: FitResult, motion: FitResult) -> FitResult:
    """Parameters, channels and words of both; the two covariances stand beside each other.

    What both freed, as a diagnosis frees the null bias, is the static tests': a parameter has one value and one error bar.
    """
    own = [i for i, name in enumerate(motion.free) if name not in static.free]
    free = (*static.free, *(motion.free[i] for i in own))
    alone = np.ix_(own, own)
    chi2, freedom = static.chi2 + motion.chi2, static.degrees_of_freedom + motion.degrees_of_freedom
    words = Identifiability(
        max(static.identifiability.condition_number, motion.identifiability.condition_number),
        (*static.identifiability.singular_values, *motion.identifiability.singular_values),
        (*static.identifiability.weak_directions, *motion.identifiability.weak_directions),
        (*static.identifiability.sentences, *motion.identifiability.sentences),
    )
    unconverged = next((part for part in (static, motion) if not part.converged), None)
    return replace(
        static,
        parameters={**static.parameters, **{n: motion.parameters[n] for n in IN_MOTION}},
        free=free,
        covariance=_beside(static.covariance, motion.covariance[alone]),
        correlation=_beside(static.correlation, motion.correlation[alone]),
        reduced_chi2=chi2 / freedom,
        chi2=chi2,
        degrees_of_freedom=freedom,
        noise_freedom=_together(static, motion),
        channels=(*static.channels, *motion.channels),
        identifiability=words,
        rows=static.rows + motion.rows,
        points=static.points + motion.points,
        converged=unconverged is None,
        message=static.message if unconverged is None else unconverged.message,
        notes=(*static.notes, *motion.notes, HELD),
        warnings=tuple(dict.fromkeys((*static.warnings, *motion.warnings))),
        verdict=(*static.verdict, *motion.verdict),
    )


def _together(static: FitResult, motion: FitResult) -> float:
    """Degrees of freedom behind the noise of both, each weighing with its readings."""
    points = static.points + motion.points
    spread = sum((part.points / points) ** 2 / part.noise_freedom for part in (static, motion))
    return 1.0 / spread if spread > 0.0 else float("inf")


def _beside(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    found = np.zeros((len(a) + len(b),) * 2)
    found[: len(a), : len(a)] = a
    found[len(a) :, len(a) :] = b
    return found
