"""Fit the parameters of motion to a record's dynamic tests; the valve's own stay what they are known to be."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ..channel_noise import ChannelNoise, reweighted
from ..errors import BenchInputError
from ..fit_result import FitResult, StartOutcome
from ..fitted import Fitted, Key
from ..least_squares import LeastSquaresResult, solve
from ..outcome import fit_result
from ..parameters import ParameterPlan
from ..problem import box_of
from ..record import BenchRecord, DynamicData, DynamicTest
from ..static_model import channel_slices, padded_size
from .machine import actuator_of, valve_of
from .noise import first_noise_of
from .plans import plan_motion
from .residuals import Weighing, both_of
from .simulator import DynamicSimulator
from .words import verdict_of_motion


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
