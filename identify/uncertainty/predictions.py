"""What the data say of figures of the valve, read or not: null leakage, pressure gain, flow gain at several temperatures, with the
interval of each by its own profile.

The end of an interval is the largest (or least) figure of all parameters whose chi-square lies at most `rise` above the optimum's: the
profile of a prediction (Kreutz, Raue and Timmer, BMC Systems Biology 6, 2012), found without moving along it: each step takes the largest
figure on the ellipsoid that the model's present derivatives give (after Chen and Jennrich, Journal of the American Statistical
Association 91, 1996).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit

from .finished_fit import FinishedFit, effects_of
from .result import PredictedFigure


APART = 25.0  # K beyond the temperatures that were read, as in the menu of `diagnosis/next_test.py`
COLDEST, HOTTEST = 233.0, 403.0  # K
NEAR_NULL = 0.5e-6  # m on either side, over which a pressure gain is taken
ROUNDS, HALVINGS = 20, 6
CLOSE, REACHED = 0.01, 0.02  # of the error bar that a step moves the figure by; of `rise` that chi-square is off
RIDGE = 1e-6  # per natural step of a parameter: what no reading sees goes as far as its limits


@dataclass(frozen=True)
class Wanted:
    """A figure: readings of rows of a test that nobody has run, each times a weight; in `unit`."""

    name: str
    unit: str
    test: str
    temperature: float
    supply_pressure: float
    weights: Mapping[tuple[str, int], float]  # {(channel, row): weight}


def predictions_of(
    around: FinishedFit, say: Callable[[str], None]
) -> tuple[tuple[PredictedFigure, ...], tuple[str, ...]]:
    """The figures that the record's static tests could show, with their intervals, and what is to be said of those without one.

    None where ports store oil: a reading then depends on how it was swept to.
    """
    effects = effects_of(around.fitted)
    if any(stores(name) for name in effects) or any(test.in_motion for test in around.fitted.tests.values()):
        return (), ()
    problem = around.problem
    values = {name: plan.start for name, plan in problem.plans.items()} | around.fitted.values
    tests, wanted = figures_among(problem.tests, values["null_bias"])
    there = replace(problem, tests=tests, used=None)
    found, notes = [], []
    for k, figure in enumerate(wanted, start=1):
        say(f"interval of a figure ({k} of {len(wanted)})")
        own = _predicted(around, problem, there, figure, values, effects)
        if own is None:
            notes.append(f"{figure.name} at {figure.temperature - 273.15:.0f} degC: no end of its interval was found")
        else:
            found.append(own)
    return tuple(found), tuple(notes)


def figures_among(tests: Mapping[str, TestRecord], null: float) -> tuple[dict[str, TestRecord], list[Wanted]]:
    """Tests of as many rows as these that begin with the rows that the figures need, and the figures.

    At the highest supply pressure of each test.
    """
    made: dict[str, TestRecord] = {}
    wanted: list[Wanted] = []
    for name, test in tests.items():
        weights, unit, title = _figure(test)
        if not weights:
            continue
        cold, hot = float(test.temperature.min()), float(test.temperature.max())
        levels = dict.fromkeys(round(t, 2) for t in (cold - APART, cold, hot, hot + APART) if COLDEST < t < HOTTEST)
        supply = float(test.supply_pressure.max())
        offsets = sorted({offset for _, offset in weights})
        position, temperature = np.full(test.rows, null), np.full(test.rows, hot)
        row = 0
        for level in levels:
            if row + len(offsets) > test.rows:
                break
            at = {offset: row + i for i, offset in enumerate(offsets)}
            for offset, place in at.items():
                position[place], temperature[place] = null + offset, level
            own = {(channel, at[offset]): weight for (channel, offset), weight in weights.items()}
            wanted.append(Wanted(title, unit, name, level, supply, own))
            row += len(offsets)
        made[name] = replace(
            test,
            spool_position=position,
            temperature=temperature,
            supply_pressure=np.full(test.rows, supply),
            return_pressure=np.full(test.rows, float(np.median(test.return_pressure))),
            nodes=None if test.nodes is None else replace(test.nodes, offset=np.zeros_like(test.nodes.offset)),
        )
    return made, wanted


def _figure(test: TestRecord) -> tuple[dict[tuple[str, float], float], str, str]:
    """({(channel, offset from null): weight}, unit, name) of a test's own figure; no weights where it has none."""
    read = {channel.name for channel in test.channels if channel.sensor is None}
    if test.name == "leakage" and "leakage_flow" in read:
        return {("leakage_flow", 0.0): 1.0}, "m3/s", "null leakage"
    if test.name == "pressure_gain":
        slope = {NEAR_NULL: 0.5 / NEAR_NULL, -NEAR_NULL: -0.5 / NEAR_NULL}
        signs = {"load_pressure": 1.0} if "load_pressure" in read else {"pressure_a": 1.0, "pressure_b": -1.0}
        if set(signs) <= read:
            weights = {(channel, x): sign * w for channel, sign in signs.items() for x, w in slope.items()}
            return weights, "Pa/m", "pressure gain at null"
    if test.name == "flow_gain" and "flow" in read:
        far = float(np.max(np.abs(test.spool_position)))
        if far > 0.0:
            return {("flow", far): 0.5 / far, ("flow", -far): -0.5 / far}, "m2/s", "flow gain over the sweep"
    return {}, "", ""


@dataclass(frozen=True)
class _Room:
    """The free parameters and the room between their limits, all in natural steps (`scale`, SI). still: amounts of effects that act along
    a sweep, which a figure of the valve at rest does not have."""

    names: tuple[str, ...]
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    still: np.ndarray

    def columns(self, at: Fit) -> np.ndarray:
        """(rows, parameters), with the ridge's rows below."""
        own = at.columns[:, [at.order.index(name) for name in self.names]] * self.scale
        return np.concatenate([own, RIDGE * np.eye(len(self.names))])


def _predicted(
    around: FinishedFit,
    problem: Problem,
    there: Problem,
    wanted: Wanted,
    values: dict[str, float],
    effects: tuple[str, ...],
) -> PredictedFigure | None:
    free = around.fitted.free
    boxes = [problem.box_of(name, values[name]) for name in free]
    scale = np.array([problem.scale_of(name) for name in free])
    lower, upper = (np.array([getattr(box, end) for box in boxes]) / scale for end in ("lower", "upper"))
    still = np.array([name in effects and effect_info(name).of_sweeps for name in free])
    room = _Room(free, scale, lower, upper, still)
    here = problem.evaluate(values, effects)
    value, slope = _figure_at(there, wanted, values, effects, room)
    covariance = around.known.covariance.matrix / np.outer(scale, scale)
    variance = float(slope @ covariance @ slope)
    columns = room.columns(here)
    moving = [i for i, name in enumerate(free) if not around.fitted.solution.active[i]]
    white = _variance(columns[:, moving], slope[moving])
    inflation = variance / white if variance > 0.0 and white > 0.0 else float(np.median(around.known.inflation))
    reach = around.known.reach(len(free), 0.95)
    std = float(np.sqrt(variance)) if variance > 0.0 else None
    idea = std if std is not None else float(np.sqrt(white * inflation))
    ends = []
    for side in (-1.0, 1.0):
        end = _end(problem, there, wanted, values, effects, room, side, reach**2 * inflation, idea)
        if end is None:
            return None
        ends.append(end)
    (low, open_low), (high, open_high) = ends
    return PredictedFigure(
        wanted.name, wanted.test, wanted.temperature, wanted.supply_pressure, value, wanted.unit, std,
        None if std is None else (value - reach * std, value + reach * std), low, high, open_low, open_high,
    )  # fmt: skip


def _variance(columns: np.ndarray, slope: np.ndarray) -> float:
    """Of a figure of this slope, beside white noise of size 1."""
    if not slope.size:
        return 0.0
    triangle = np.linalg.qr(columns, mode="r")
    return float(np.sum(np.linalg.solve(triangle.T, slope) ** 2))


def _figure_at(
    there: Problem, wanted: Wanted, values: Mapping[str, float], effects: tuple[str, ...], room: _Room
) -> tuple[float, np.ndarray]:
    """The figure, and its slopes to the parameters in natural steps."""
    at_rest = {name: 0.0 for name, still in zip(room.names, room.still, strict=True) if still}
    at = there.evaluate({**values, **at_rest}, effects)
    own = at.columns[:, [at.order.index(name) for name in room.names]] * np.where(room.still, 0.0, room.scale)
    value, slope, rows = 0.0, np.zeros(len(room.names)), there.rows()
    for (channel, row), weight in wanted.weights.items():
        key = (wanted.test, channel)
        place, std = (
            rows[key].start + row,
            float(np.broadcast_to(there.noise.std[key], rows[key].stop - rows[key].start)[row]),
        )
        value += weight * (at.residual[place] * std + float(there.tests[wanted.test].channel(channel).value[row]))
        slope += weight * std * own[place]
    return float(value), slope


def _end(
    problem: Problem,
    there: Problem,
    wanted: Wanted,
    values: dict[str, float],
    effects: tuple[str, ...],
    room: _Room,
    side: float,
    rise: float,
    idea: float,
) -> tuple[float, bool] | None:
    """Where the figure ends on one side, and whether limits of the parameters ended it; None where no step led there."""
    p = np.array([values[name] for name in room.names]) / room.scale
    of = lambda q: {**values, **dict(zip(room.names, (q * room.scale).tolist(), strict=True))}
    at = problem.evaluate(values, effects)
    allowed = at.chi2 + rise
    figure, slope = _figure_at(there, wanted, values, effects, room)
    for _ in range(ROUNDS):
        moved, ended = _largest(room, at, p, side * slope, allowed)
        for _ in range(HALVINGS):
            trial = problem.evaluate(of(moved), effects)
            # Where chi-square rises by more than twice as much, the ellipsoid was none: an edge closed, or the model bends.
            if np.isfinite(trial.chi2) and trial.chi2 <= max(allowed + rise, at.chi2):
                break
            moved = 0.5 * (moved + p)
        else:
            return None
        before, p, at = figure, moved, trial
        figure, slope = _figure_at(there, wanted, of(p), effects, room)
        settled = abs(figure - before) <= CLOSE * idea
        if settled and (ended or abs(at.chi2 - allowed) <= REACHED * rise):
            return figure, ended and at.chi2 < allowed - REACHED * rise
    return None


def _largest(room: _Room, at: Fit, p: np.ndarray, slope: np.ndarray, allowed: float) -> tuple[np.ndarray, bool]:
    """The parameters with the largest slope @ p on the linear model's chi-square of `allowed`, within their limits; whether limits end
    all of the way.

    A parameter that the way leads beyond its limit stays there, and the others take what is left.
    """
    columns = room.columns(at)
    residual = np.concatenate([at.residual, np.zeros(len(p))])
    step, open_ = np.zeros(len(p)), np.ones(len(p), dtype=bool)
    while open_.any():
        q, triangle = np.linalg.qr(columns[:, open_])
        now = residual + columns[:, ~open_] @ step[~open_]
        seen = q.T @ now
        left = allowed - float(now @ now - seen @ seen)
        way = np.linalg.solve(triangle.T, slope[open_])
        length = float(np.linalg.norm(way))
        on = way / length * np.sqrt(max(left, 0.0)) if length > 0.0 else np.zeros(len(way))
        step[open_] = np.linalg.solve(triangle, on - seen)
        beyond = open_ & ((p + step < room.lower) | (p + step > room.upper))
        if not beyond.any():
            return p + step, False
        step[beyond] = np.clip(p + step, room.lower, room.upper)[beyond] - p[beyond]
        open_ &= ~beyond
    return p + step, True
