"""How noisy are the readings, measured on the record itself and free of any valve model? Plain NumPy.

Three sources, best first: repeated sweeps, scatter within the bins of a raw log (`BinNoise`), third differences of
neighbours.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from .legs import piece_bounds, sweep_ids
from .record import Channel, TestRecord


THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # blind to any parabola; variance 20 for white noise of 1
MEDIAN_OF_CHI2 = 0.4549  # one degree of freedom


@dataclass(frozen=True)
class RepeatNoise:
    """Noise from repeated sweeps. `std` of one row (SI); `correlation` of neighbouring rows; `rows` compared; `source` in words."""

    std: float
    correlation: float
    rows: int
    source: str


@dataclass(frozen=True)
class NeighbourNoise:
    """Noise from third differences along the sweeps. `std` of one row (SI); not `valid` where the curve's bends outweigh it."""

    std: float
    valid: bool


@dataclass(frozen=True)
class LogCorrelation:
    """How the mean of n neighbouring rows of a log scatters, in units of `log_scatter` (the variance of third differences).

    Noise = white share + a share that forgets over `memory` rows, of this `variance`; `sizes` and `excess` say by how
    much the means of so many rows scatter more or less than that (ripple does). `row_variance`: what one row scatters
    by about a smooth curve.
    """

    variance: float = 1.0
    white: float = 1.0
    memory: float = 0.0
    row_variance: float = 1.0
    sizes: np.ndarray = field(default_factory=lambda: np.ones(1))
    excess: np.ndarray = field(default_factory=lambda: np.ones(1))

    def of_mean(self, rows: np.ndarray) -> np.ndarray:
        """Variance of the mean of `rows` neighbouring rows."""
        n = np.asarray(rows, float)
        excess = np.exp(np.interp(np.log(n), np.log(self.sizes), np.log(self.excess)))
        return self.variance * excess * _sum_variance(n, self.white, self.memory) / n**2

    def effective_rows(self, rows: np.ndarray) -> np.ndarray:
        """Independent rows that the mean of `rows` neighbouring ones is worth."""
        return np.clip(self.row_variance / self.of_mean(rows), 1.0, rows)

    def rows_per_reading(self, rows: float | None = None) -> float:
        """Rows that one independent reading takes, for means of `rows` rows (default: of many more than seen)."""
        n = 4.0 * float(self.sizes[-1]) if rows is None else rows
        return float(np.maximum(n * self.of_mean(np.array(n)) / self.row_variance, 1e-9))

    def of_neighbours(self, rows: float) -> float:
        """Correlation between the means of two neighbouring bins of `rows` rows."""
        one, two = (_sum_variance(np.asarray(k * rows, float), self.white, self.memory) for k in (1.0, 2.0))
        return float(two / (2.0 * one) - 1.0)


def effective_size(residual: np.ndarray) -> float:
    """n / (1 + 2 sum rho) of a series in its order: how many independent readings it is worth, between 1 and n.

    The sum stops where a pair of neighbouring correlations turns negative (Geyer, Statistical Science 7, 1992, sec.
    3.3).
    """
    e = np.asarray(residual, float) - np.mean(residual)
    n = len(e)
    power = float(e @ e)
    if n < 4 or power == 0:
        return float(n)
    total = -1.0
    for lag in range(0, n - 1, 2):
        pair = float(e[: n - lag] @ e[lag:] + e[: n - lag - 1] @ e[lag + 1 :]) / power
        if pair <= 0:
            break
        total += 2.0 * pair
    return float(np.clip(n / max(total, 1e-9), 1.0, n))


def noise_from_repeats(test: TestRecord, channel: Channel) -> RepeatNoise | None:
    """Noise from the differences between runs that repeat a sweep; None where no run does.

    A repeat has the same direction and conditions (1 % of supply, 1 K), rates within 20 % and overlapping positions;
    the later run is interpolated to the earlier one's positions, which the variance allows for. Curve and model fall
    out of the difference.
    """
    sweeps = sweep_ids(test)
    pieces = [slice(*bounds) for bounds in piece_bounds(sweeps) if bounds[1] - bounds[0] >= 3]
    differences: list[np.ndarray] = []
    used: set[int] = set()
    for i, first in enumerate(pieces):
        for j in range(i + 1, len(pieces)):
            second = pieces[j]
            if j in used or test.run[first.start] == test.run[second.start] or not _repeats(test, first, second):
                continue
            d = _difference(test.spool_position, channel.value, first, second)
            if len(d) >= 3:
                differences.append(d)
                used.add(j)
                break
    rows = sum(len(d) for d in differences)
    if rows < 8:
        return None
    variance = sum(float(d @ d) for d in differences) / rows
    lagged = sum(float(d[1:] @ d[:-1]) for d in differences) / max(rows - len(differences), 1)
    correlation = float(np.clip(lagged / variance, -1.0, 1.0)) if variance > 0 else 0.0
    source = f"differences between repeated sweeps ({rows} pairs of rows)"
    return RepeatNoise(float(np.sqrt(variance)), correlation, rows, source)


def noise_from_neighbours(test: TestRecord, channel: Channel) -> NeighbourNoise:
    """Rough noise from third differences along each sweep, at the rows' own positions; median based.

    Differences of noise alternate in sign (77 % of neighbours), those of a bending curve do not: `valid` asks for 60 %.
    """
    found, alternating = [], []
    sweeps = sweep_ids(test)
    for start, stop in piece_bounds(sweeps):
        x, y = test.spool_position[start:stop], channel.value[start:stop]
        if stop - start < 4:
            continue
        e = _divided_third(x, y)
        found.append(e)
        alternating.append(e[1:] * e[:-1] < 0)
    if not found:
        return NeighbourNoise(0.0, False)
    e, signs = np.concatenate(found), np.concatenate(alternating)
    std = float(np.sqrt(np.median(e**2) / MEDIAN_OF_CHI2))
    return NeighbourNoise(std, bool(len(signs) >= 8 and np.mean(signs) > 0.6 and std > 0))


def log_scatter(value: np.ndarray, legs: np.ndarray, lag: int) -> np.ndarray:
    """Squared third difference per row at a lag of some rows, over 20: local variance about a local parabola; same shape.

    Rows near a leg's ends repeat the nearest difference inside it.
    """
    scatter = np.zeros(len(value))
    for start, stop in piece_bounds(legs):
        n = stop - start
        k = min(lag, (n - 1) // 3)
        if k == 0:
            continue
        y = value[start:stop]
        d = (y[: n - 3 * k] - 3 * y[k : n - 2 * k] + 3 * y[2 * k : n - k] - y[3 * k :]) ** 2 / 20.0
        centre = np.clip(np.arange(n) - (3 * k) // 2, 0, len(d) - 1)
        scatter[start:stop] = d[centre]
    return scatter


def log_correlation(value: np.ndarray, local: np.ndarray, legs: np.ndarray, bin_rows: int) -> LogCorrelation:
    """How fast means of neighbouring rows settle: third differences of means over half a bin to four bins, against `local`.

    value, legs (n,); local (n,): smoothed `log_scatter`, 0 where it says nothing (constant or coarsely rounded
    readings). Medians over the log keep bends and jumps of the curve out. A white and a forgetful share are fitted to
    the scales.
    """
    sizes = sorted({max(1, bin_rows // 4), max(1, bin_rows // 2), bin_rows, 2 * bin_rows, 4 * bin_rows})
    rows, ratios, weights = [], [], []
    for size in sizes:
        samples, alternating = [], []
        for start, stop in piece_bounds(legs):
            count = (stop - start) // size
            if count < 6:
                continue
            y = value[start : start + count * size].reshape(count, size).mean(axis=1)
            s = local[start : start + count * size].reshape(count, size)
            s = np.where((s > 0).all(axis=1), s.mean(axis=1), 0.0)
            third = y[:-3] - 3 * y[1:-2] + 3 * y[2:-1] - y[3:]
            scale = (s[:-3] + s[1:-2] + s[2:-1] + s[3:]) / 4.0
            usable = np.minimum(np.minimum(s[:-3], s[1:-2]), np.minimum(s[2:-1], s[3:])) > 0
            samples.append(third[usable] ** 2 / 20.0 / scale[usable])
            alternating.append((third[1:] * third[:-1] < 0)[usable[1:] & usable[:-1]])
        sample = np.concatenate(samples) if samples else np.zeros(0)
        # Third differences of noise alternate, however long its memory; those of the curve do not.
        noise = len(sample) >= 20 and float(np.mean(np.concatenate(alternating))) > 0.62
        if noise and np.median(sample) > 0:
            rows.append(size)
            ratios.append(np.median(sample) / MEDIAN_OF_CHI2)
            weights.append(len(sample) / 4.0)
    if not rows:
        return LogCorrelation()
    fitted = _fit_shares(np.array(rows, float), np.array(ratios), np.array(weights))
    return replace(fitted, row_variance=max(_row_variance(value, local, legs, 2 * bin_rows), 1e-12))


def _row_variance(value: np.ndarray, local: np.ndarray, legs: np.ndarray, size: int) -> float:
    """Variance of a row about parabolas over blocks of `size` rows, against `local`; median over the blocks."""
    size = max(size, 12)
    t = np.linspace(-1.0, 1.0, size)
    basis, _ = np.linalg.qr(np.stack([np.ones(size), t, t**2], axis=1))
    ratios = []
    for start, stop in piece_bounds(legs):
        count = (stop - start) // size
        y = value[start : start + count * size].reshape(count, size)
        s = local[start : start + count * size].reshape(count, size)
        usable = (s > 0).all(axis=1)
        y = y[usable] - y[usable].mean(axis=1, keepdims=True)
        rest = y - (y @ basis) @ basis.T
        ratios.append(np.sum(rest**2, axis=1) / (size - 3) / s[usable].mean(axis=1))
    pooled = np.concatenate(ratios) if ratios else np.zeros(0)
    return float(np.median(pooled)) if len(pooled) else 1.0


def _fit_shares(rows: np.ndarray, ratios: np.ndarray, weights: np.ndarray) -> LogCorrelation:
    best, least = LogCorrelation(), np.inf
    memories = np.geomspace(1.0, 2.0 * rows.max(), 24)
    for white in (1.0, 0.95, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1, 0.0):
        for memory in memories if white < 1 else (0.0,):
            predicted = np.log(_third_difference_of_means(rows, white, memory))
            misfit = np.log(ratios) - predicted
            level = float(np.sum(weights * misfit) / np.sum(weights))
            # Scales share their rows, and ripple is neither white nor forgetful: no scale is trusted beyond 10 %.
            trust = 1.0 / (0.1**2 + 2.0 / weights)
            cost = float(np.sum(trust * (misfit - level) ** 2)) + (0.0 if white == 1 else 6.0)
            if cost < least:
                least = cost
                excess = np.exp((misfit - level) * weights / (weights + 20.0))
                best = LogCorrelation(float(np.exp(level)), white, float(memory), sizes=rows, excess=excess)
    return best


def _third_difference_of_means(rows: np.ndarray, white: float, memory: float) -> np.ndarray:
    """Variance (over 20) of third differences between means of `rows` neighbouring rows, for noise of variance 1."""
    total = [_sum_variance(k * rows, white, memory) for k in range(5)]
    covariance = [total[1], *((total[k + 1] - 2 * total[k] + total[k - 1]) / 2.0 for k in (1, 2, 3))]
    seen = 20 * covariance[0] - 30 * covariance[1] + 12 * covariance[2] - 2 * covariance[3]
    return np.maximum(seen, 1e-300) / (20.0 * rows**2)


def _sum_variance(n: np.ndarray, white: float, memory: float) -> np.ndarray:
    """Variance of the sum of n neighbouring rows of unit variance: white share, and the rest AR(1) with the given memory."""
    if memory == 0.0 or white == 1.0:
        return np.asarray(n, float)
    a = np.exp(-1.0 / memory)
    forgetful = n * (1 + a) / (1 - a) - 2 * a * (1 - a**n) / (1 - a) ** 2
    return white * n + (1 - white) * forgetful


def _divided_third(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Combination of four neighbours that is blind to a parabola through uneven positions, scaled to the noise of one row."""
    points = np.stack([x[k : len(x) - 3 + k] for k in range(4)])
    distance = points[:, None, :] - points[None, :, :]
    distance[np.arange(4), np.arange(4)] = 1.0
    product = np.prod(distance, axis=1)
    flat = (product == 0).any(axis=0)  # equal positions: fall back on even spacing
    weight = np.where(flat, THIRD_DIFFERENCE[:, None], 1.0 / np.where(product == 0, 1.0, product))
    weight = weight / np.sqrt(np.sum(weight**2, axis=0))
    return np.sum(weight * np.stack([y[k : len(y) - 3 + k] for k in range(4)]), axis=0) * np.sign(weight[1])


def _repeats(test: TestRecord, first: slice, second: slice) -> bool:
    if test.direction[first.start] != test.direction[second.start]:
        return False
    supply = 0.01 * max(float(np.max(np.abs(test.supply_pressure))), 1e-300)
    for column, step in ((test.supply_pressure, supply), (test.return_pressure, supply), (test.temperature, 1.0),
                         (test.load_pressure, supply)):  # fmt: skip
        if column is not None and abs(float(np.mean(column[first]) - np.mean(column[second]))) > step:
            return False
    if test.rate is not None:
        rates = [abs(float(np.median(test.rate[part]))) for part in (first, second)]
        if abs(rates[0] - rates[1]) > 0.2 * max(rates):
            return False
    return True


def _difference(position: np.ndarray, value: np.ndarray, first: slice, second: slice) -> np.ndarray:
    """Noise of one row from two repeats: their difference over sqrt(1 + w^2 + (1-w)^2), w the interpolation's weight."""
    order = np.argsort(position[second], kind="stable")
    x, y = position[second][order], value[second][order]
    inside = (position[first] >= x[0]) & (position[first] <= x[-1])
    at = position[first][inside]
    right = np.clip(np.searchsorted(x, at), 1, len(x) - 1)
    width = x[right] - x[right - 1]
    w = np.where(width > 0, (at - x[right - 1]) / np.where(width > 0, width, 1.0), 0.5)
    other = (1 - w) * y[right - 1] + w * y[right]
    return (value[first][inside] - other) / np.sqrt(1.0 + w**2 + (1 - w) ** 2)
