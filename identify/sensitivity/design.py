"""The D-optimal next test: which sweep, or which points, shrink the parameters' joint uncertainty most."""

from dataclasses import dataclass

import numpy as np

from .information import Measurements, fisher_information, marginal_stds


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
