"""Where the information on each parameter sits, and which test to run next: Fisher information and D-optimal design.

A point's information counts what the other parameters take of it. Beside it: what a fit left uncertain, as samples of the
parameters' posterior in independent directions, and how well each test can be read (a record's noise, the user's, or the usual
instruments'). The next test is the sweep, or the points, that shrink the parameters' joint uncertainty most.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from thermohyd.identify.bench.columns import unit_of_test
from thermohyd.identify.model.model import Model

from .factors import FACTORS, Factor


@dataclass(frozen=True)
class Measurements:
    """Points that were or could be measured, with what each says of the free parameters.

    test, temperature [K], supply_pressure [Pa], position [m]: (points,). columns: (points, parameters), derivative of the
    reading in units of its own noise, per SI unit of the parameter: g with Fisher information g g^T.
    """

    parameters: tuple[str, ...]
    test: np.ndarray
    temperature: np.ndarray
    supply_pressure: np.ndarray
    position: np.ndarray
    columns: np.ndarray

    def at(self, rows: np.ndarray) -> "Measurements":
        """Some of the points."""
        parts = (self.test, self.temperature, self.supply_pressure, self.position, self.columns)
        return Measurements(self.parameters, *(part[rows] for part in parts))


def fisher_information(columns: np.ndarray) -> np.ndarray:
    """(parameters, parameters): sum of g g^T over the points."""
    return columns.T @ columns


def covariance_of(information: np.ndarray) -> np.ndarray:
    """The inverse of an information matrix, scaled so that parameters of any size come out; infinite where it is singular."""
    size = np.sqrt(np.diag(information))
    if not np.all(size > 0.0):
        return np.full_like(information, np.inf)
    scaled = information / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] < 1e-13:
        return np.full_like(information, np.inf)
    return np.linalg.inv(scaled) / np.outer(size, size)


def marginal_stds(information: np.ndarray) -> np.ndarray:
    """Standard deviation of each parameter with all the others unknown too."""
    return np.sqrt(np.diag(covariance_of(information)))


def shares(columns: np.ndarray, information: np.ndarray | None = None) -> np.ndarray:
    """(points, parameters): which share of the information on each parameter a point carries, the loss to the others included.

    With C the inverse of the whole information, a point's share is (C g)_i^2/C_ii: its part in the marginal variance of
    parameter i. Without a prior in `information` (default: the points' own) the shares of all points add up to 1.

    >>> slope = np.linspace(-1.0, 1.0, 5)
    >>> line = np.stack([np.ones(5), slope], axis=1)  # offset and slope of a straight line
    >>> found = shares(line)
    >>> [[round(float(share), 2) for share in row] for row in found]  # the ends tell the slope, all points the offset
    [[0.2, 0.4], [0.2, 0.1], [0.2, 0.0], [0.2, 0.1], [0.2, 0.4]]
    """
    covariance = covariance_of(fisher_information(columns) if information is None else information)
    if not np.all(np.isfinite(covariance)):
        return np.full(columns.shape, np.nan)
    return (columns @ covariance) ** 2 / np.diag(covariance)


@dataclass(frozen=True)
class Posterior:
    """A Gaussian posterior of some factors (SI): mean, standard deviations, and its principal directions.

    directions: (directions, factors), unit vectors in units of each factor's standard deviation, the most uncertain one
    first; spread: (directions,), standard deviation along each. Independent of each other, as the factors are not.
    """

    factors: tuple[Factor, ...]
    mean: np.ndarray
    std: np.ndarray
    directions: np.ndarray
    spread: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Each direction by its largest parts: "0.72 underlap - 0.69 edge_radius"."""
        return tuple(_words(row, self.factors) for row in self.directions)

    def samples(self, unit: np.ndarray) -> np.ndarray:
        """(samples, factors) from points (samples, directions) of the unit cube, cut where a factor cannot go."""
        normal = ndtri(np.clip(unit, 1e-12, 1.0 - 1e-12))
        values = self.mean + self.std * ((normal * self.spread) @ self.directions)
        return np.clip(values, [f.lower for f in self.factors], [f.upper for f in self.factors])

    def slopes(self, slopes: np.ndarray) -> np.ndarray:
        """Derivatives (..., factors, outputs) as derivatives to the directions' standard normals (..., directions, outputs)."""
        return np.einsum("df,...fo->...do", self.spread[:, None] * self.directions * self.std, slopes)


def posterior_of(model: Model, factors: tuple[Factor, ...]) -> Posterior | None:
    """The posterior in a model's covariance, of the factors that it names with an error; None where there is none."""
    if model.covariance is None:
        return None
    std = np.sqrt(np.diag(model.covariance))
    rows = [i for i, name in enumerate(model.free) if name in FACTORS and std[i] > 0.0]
    if not rows:
        return None
    by_name = {factor.name: factor for factor in factors}
    own = tuple(by_name[model.free[i]] for i in rows)
    correlation = model.covariance[np.ix_(rows, rows)] / np.outer(std[rows], std[rows])
    values, vectors = np.linalg.eigh(correlation)
    order = np.argsort(-values)
    vectors = vectors[:, order] * np.sign(vectors[np.argmax(np.abs(vectors), axis=0)[order], order])
    mean = np.array([factor.value for factor in own])
    return Posterior(own, mean, std[rows], vectors.T, np.sqrt(np.maximum(values[order], 0.0)))


def _words(direction: np.ndarray, factors: tuple[Factor, ...]) -> str:
    order = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) >= 0.3][:3]
    words = ""
    for i in order:
        sign = ("-" if direction[i] < 0 else "") if not words else (" - " if direction[i] < 0 else " + ")
        words += f"{sign}{abs(direction[i]):.2f} {factors[i].name}"
    return words


# Of good bench instruments: share of the reading, and share of the full scale, added as variances.
FLOWMETER = (0.01, 0.002)
GAUGE = (0.0, 0.005)
POSITION = 0.001  # of the stroke: standard deviation of a position, which steep curves turn into one of the reading
DEFAULTS = {"leakage": FLOWMETER, "pressure_gain": GAUGE, "flow_gain": FLOWMETER}


@dataclass(frozen=True)
class ReadingNoise:
    """Standard deviation of one reading of each test. absolute: {test: std in SI}; other tests take `DEFAULTS`."""

    absolute: dict[str, float]
    source: str = ""  # where the absolute ones come from

    def std(self, test: str, value: np.ndarray, supply_pressure: np.ndarray, per_stroke: np.ndarray) -> np.ndarray:
        """Row by row (SI). Full scale: the largest flow among `value`, or the largest supply pressure.

        per_stroke: how much the reading changes with the position, times the stroke.
        """
        if test in self.absolute:
            return np.full(len(value), self.absolute[test])
        full = np.max(supply_pressure) if test == "pressure_gain" else np.max(np.abs(value))
        of_reading, of_scale = DEFAULTS[test]
        return np.sqrt((of_reading * value) ** 2 + (of_scale * full) ** 2 + (POSITION * per_stroke) ** 2)

    def words(self) -> dict[str, str]:
        """{test: in words}."""
        found = {}
        for test, (of_reading, of_scale) in DEFAULTS.items():
            if test in self.absolute:
                found[test] = f"{unit_of_test(test).words(self.absolute[test], 3)} ({self.source})"
                continue
            full = "the supply pressure" if test == "pressure_gain" else "full scale"
            parts = [f"{100 * of_reading:g} % of the reading"] if of_reading else []
            parts += [f"{100 * of_scale:g} % of {full}", f"{100 * POSITION:g} % of the stroke in position (assumed)"]
            found[test] = " and ".join(parts)
        return found


MOST_EXCHANGES = 200


@dataclass(frozen=True)
class TestChoice:
    """A test at one temperature [K] and supply pressure [Pa] that could be run next.

    gain: of ln det of the information, D-optimality's measure; std: of each parameter after it.
    """

    __test__ = False  # not a pytest class

    test: str
    temperature: float
    supply_pressure: float
    gain: float
    std: dict[str, float]


def next_tests(candidates: Measurements, information: np.ndarray) -> list[TestChoice]:
    """Every sweep among the candidates, the best one first, given what is known (information in SI units).

    >>> line = np.array([[1.0, 0.0], [1.0, 0.1], [1.0, 2.0], [1.0, -2.0]])  # offset and slope
    >>> two = Measurements(
    ...     ("offset", "slope"), np.array(["near", "near", "far", "far"]), *np.full((2, 4), 300.0), np.zeros(4), line
    ... )
    >>> [choice.test for choice in next_tests(two, np.eye(2))]
    ['far', 'near']
    """
    found = []
    before = _log_det(information)
    for (test, temperature, pressure), rows in sweeps(candidates).items():
        after = information + fisher_information(candidates.columns[rows])
        std = dict(zip(candidates.parameters, marginal_stds(after).tolist(), strict=True))
        found.append(TestChoice(test, temperature, pressure, _log_det(after) - before, std))
    return sorted(found, key=lambda choice: -choice.gain)


def sweeps(points: Measurements) -> dict[tuple[str, float, float], np.ndarray]:
    """Indices of the points by (test, temperature, supply pressure)."""
    keys = list(zip(points.test.tolist(), points.temperature.tolist(), points.supply_pressure.tolist(), strict=True))
    groups: dict[tuple[str, float, float], list[int]] = {}
    for row, key in enumerate(keys):
        groups.setdefault(key, []).append(row)
    return {key: np.array(rows) for key, rows in groups.items()}


def d_optimal_points(columns: np.ndarray, count: int, information: np.ndarray) -> np.ndarray:
    """Indices of `count` points (repeats allowed) that raise det(information + sum g g^T) most: greedy, then exchanges.

    Greedy picks add the point of largest g^T M^-1 g; then single points are exchanged while any exchange raises the
    determinant (Fedorov's algorithm), which ends at a design that no single exchange improves.

    >>> line = np.stack([np.ones(5), np.linspace(-1.0, 1.0, 5)], axis=1)
    >>> sorted(d_optimal_points(line, 4, 1e-6 * np.eye(2)).tolist())  # a straight line: half at each end
    [0, 0, 4, 4]
    """
    scale = np.sqrt(np.diag(information))
    g = columns / scale
    m = information / np.outer(scale, scale)
    chosen: list[int] = []
    for _ in range(count):
        best = int(np.argmax(_leverage(g, np.linalg.inv(m))))
        chosen.append(best)
        m = m + np.outer(g[best], g[best])
    for _ in range(MOST_EXCHANGES):
        inverse = np.linalg.inv(m)
        lever = _leverage(g, inverse)
        out = g[chosen]
        cross = out @ inverse @ g.T
        # det(M - a a^T + b b^T)/det(M) = (1 + d_b)(1 - d_a) + d_ab^2
        ratio = (1.0 + lever) * (1.0 - lever[chosen])[:, None] + cross**2
        place, new = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
        if ratio[place, new] <= 1.0 + 1e-9:
            break
        m = m + np.outer(g[new], g[new]) - np.outer(out[place], out[place])
        chosen[int(place)] = int(new)
    return np.array(chosen)


def _leverage(g: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    return np.einsum("ri,ij,rj->r", g, inverse, g)


def _log_det(information: np.ndarray) -> float:
    size = np.sqrt(np.diag(information))
    if not np.all(size > 0.0):
        return -np.inf
    return float(np.linalg.slogdet(information / np.outer(size, size))[1] + 2.0 * np.sum(np.log(size)))
