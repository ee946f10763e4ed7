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
from thermohyd.identify.bench.shown_units import CELSIUS
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.diagnosis.next_test import APART, COLDEST, HOTTEST
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit

from .finished_fit import FinishedFit, effects_of
from .result import Nested, PredictedFigure


NEAR_NULL = 0.5e-6  # m on either side, over which a pressure gain is taken
ROUNDS, HALVINGS = 20, 6
CLOSE, REACHED = 0.01, 0.02  # of the error bar that a step moves the figure by; of `rise` that chi-square is off
LEVEL = 0.95
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
    problem, values = around.problem, around.fitted.values
    tests, wanted = figures_among(problem.tests, values.get("null_bias", problem.plans["null_bias"].start))
    valve = _Valve.of(around, tests, effects)
    found, notes = [], []
    for k, figure in enumerate(wanted, start=1):
        say(f"interval of a figure ({k} of {len(wanted)})")
        own = _predicted(around, valve, figure)
        if own is None:
            notes.append(f"{figure.name} at {figure.temperature - CELSIUS:.0f} degC: no end of its interval was found")
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
class _Valve:
    """The fit seen as a function of its free parameters, in natural steps (`scale`, SI) between their limits.

    read, unread: the record's tests, and those that nobody has run; best, there: both at the optimum. still: amounts of effects that act
    along a sweep, which a figure of the valve at rest does not have.
    """

    names: tuple[str, ...]
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    still: np.ndarray
    values: Mapping[str, float]
    effects: tuple[str, ...]
    read: Problem
    unread: Problem
    best: Fit
    there: Fit

    @classmethod
    def of(cls, around: FinishedFit, tests: dict[str, TestRecord], effects: tuple[str, ...]) -> "_Valve":
        read, free, values = around.problem, around.fitted.free, around.fitted.values
        unread = replace(read, tests=tests, used=None)
        scale = np.array([read.scale_of(name) for name in free])
        boxes = [read.box_of(name, values[name]) for name in free]
        lower, upper = (np.array([getattr(box, end) for box in boxes]) / scale for end in ("lower", "upper"))
        still = np.array([name in effects and effect_info(name).of_sweeps for name in free])
        best = read.evaluate(values, effects)
        there = unread.evaluate(_at_rest(values, free, still), effects)
        return cls(free, scale, lower, upper, still, values, effects, read, unread, best, there)

    @property
    def start(self) -> np.ndarray:
        return np.array([self.values[name] for name in self.names]) / self.scale

    def moved_to(self, p: np.ndarray) -> dict[str, float]:
        """All values, SI, with the free ones at p."""
        return {**self.values, **dict(zip(self.names, (p * self.scale).tolist(), strict=True))}

    def fit_at(self, p: np.ndarray) -> Fit:
        return self.read.evaluate(self.moved_to(p), self.effects)

    def columns(self, at: Fit) -> np.ndarray:
        """(rows, parameters), with the ridge's rows below."""
        own = at.columns[:, [at.order.index(name) for name in self.names]] * self.scale
        return np.concatenate([own, RIDGE * np.eye(len(self.names))])

    def figure(self, wanted: Wanted, p: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """A figure, and its slopes to the parameters; p: None at the optimum."""
        at = self.there
        if p is not None:
            at = self.unread.evaluate(_at_rest(self.moved_to(p), self.names, self.still), self.effects)
        own = at.columns[:, [at.order.index(name) for name in self.names]] * np.where(self.still, 0.0, self.scale)
        value, slope, rows = 0.0, np.zeros(len(self.names)), self.unread.rows()
        for (channel, row), weight in wanted.weights.items():
            key = (wanted.test, channel)
            place, count = rows[key].start + row, rows[key].stop - rows[key].start
            std = float(np.broadcast_to(self.unread.noise.std[key], count)[row])
            read = float(self.unread.tests[wanted.test].channel(channel).value[row])
            value += weight * (at.residual[place] * std + read)
            slope += weight * std * own[place]
        return float(value), slope


def _at_rest(values: Mapping[str, float], names: tuple[str, ...], still: np.ndarray) -> dict[str, float]:
    return {**values, **{name: 0.0 for name, rests in zip(names, still, strict=True) if rests}}


def _predicted(around: FinishedFit, valve: _Valve, wanted: Wanted) -> PredictedFigure | None:
    value, slope = valve.figure(wanted)
    covariance = around.known.covariance.matrix / np.outer(valve.scale, valve.scale)
    variance = float(slope @ covariance @ slope)
    moving = [i for i in range(len(valve.names)) if not around.fitted.solution.active[i]]
    white = _variance(valve.columns(valve.best)[:, moving], slope[moving])
    inflation = variance / white if variance > 0.0 and white > 0.0 else float(np.median(around.known.inflation))
    reach = around.known.reach(len(valve.names), LEVEL)
    std = float(np.sqrt(variance)) if variance > 0.0 else None
    idea = std if std is not None else float(np.sqrt(white * inflation))
    ends = []
    for side in (-1.0, 1.0):
        end = _end(valve, wanted, side, reach**2 * inflation, idea)
        if end is None:
            return None
        ends.append(end)
    (low, open_low), (high, open_high) = ends
    return PredictedFigure(
        wanted.name, wanted.test, wanted.temperature, wanted.supply_pressure, value, wanted.unit, std,
        None if std is None else (value - reach * std, value + reach * std), Nested(LEVEL, low, high, open_low, open_high),
    )  # fmt: skip


def _variance(columns: np.ndarray, slope: np.ndarray) -> float:
    """Of a figure of this slope, beside white noise of size 1."""
    if not slope.size:
        return 0.0
    triangle = np.linalg.qr(columns, mode="r")
    return float(np.sum(np.linalg.solve(triangle.T, slope) ** 2))


def _end(valve: _Valve, wanted: Wanted, side: float, rise: float, idea: float) -> tuple[float, bool] | None:
    """Where the figure ends on one side, and whether limits of the parameters ended it; None where no step led there."""
    p, at = valve.start, valve.best
    allowed = at.chi2 + rise
    figure, slope = valve.figure(wanted)
    for _ in range(ROUNDS):
        moved, ended = _largest(valve, at, p, side * slope, allowed)
        for _ in range(HALVINGS):
            trial = valve.fit_at(moved)
            # Where chi-square rises by more than twice as much, the ellipsoid was none: an edge closed, or the model bends.
            if np.isfinite(trial.chi2) and trial.chi2 <= max(allowed + rise, at.chi2):
                break
            moved = 0.5 * (moved + p)
        else:
            return None
        before, p, at = figure, moved, trial
        figure, slope = valve.figure(wanted, p)
        settled = abs(figure - before) <= CLOSE * idea
        if settled and (ended or abs(at.chi2 - allowed) <= REACHED * rise):
            return figure, ended and at.chi2 < allowed - REACHED * rise
    return None


def _largest(valve: _Valve, at: Fit, p: np.ndarray, slope: np.ndarray, allowed: float) -> tuple[np.ndarray, bool]:
    """The parameters with the largest slope @ p on the linear model's chi-square of `allowed`, within their limits; whether limits end
    all of the way.

    A parameter that the way leads beyond its limit stays there, and the others take what is left.
    """
    columns = valve.columns(at)
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
        beyond = open_ & ((p + step < valve.lower) | (p + step > valve.upper))
        if not beyond.any():
            return p + step, False
        step[beyond] = np.clip(p + step, valve.lower, valve.upper)[beyond] - p[beyond]
        open_ &= ~beyond
    return p + step, True
