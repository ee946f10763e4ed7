"""Estimate the scatter of a raw log's rows about a smooth curve, and how long that noise lasts. NumPy only.

Third differences along the log are blind to any parabola, so that neither slope nor bend of the curve counts as noise.
Rows are independent unless the log says clearly otherwise: then the mean of n of them is known to 1/sqrt(n) of one,
whatever the bin, and nothing is estimated bin by bin.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc, polygamma

from .monotone_pieces import piece_bounds


Values = float | np.ndarray

PENALTY = 6.0  # in chi-square: white noise, unless the scales say clearly otherwise
MEDIAN_OF_CHI2 = 0.4549  # one degree of freedom
REDUNDANT = 2.31  # neighbouring third differences that are worth one independent one: 1 + 2 sum of squared correlations
STRETCH, FEW = 48, 12  # third differences that are judged together
AROUND = 5  # stretches whose median is local
UNEQUAL = 1e-4  # probability of stretches as unequal as this by chance, below which the noise varies along the log
ALTERNATES = 0.62  # share of neighbouring third differences of opposite sign: 0.77 in noise, however long its memory
ROWS_ALTERNATE = 0.7  # the same of single rows, where no bend of a curve shows
CLEARLY = 4.0  # standard errors
RESOLVED = 150  # means per sweep between which a valve's curve hardly bends


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

    def of_mean(self, rows: Values) -> Values:
        """Variance of the mean of `rows` neighbouring rows."""
        n = np.asarray(rows, float)[()]
        excess = np.exp(np.interp(np.log(n), np.log(self.sizes), np.log(self.excess)))
        return self.variance * excess * _sum_variance(n, self.white, self.memory) / n**2

    def effective_rows(self, rows: Values) -> Values:
        """Independent rows that the mean of `rows` neighbouring ones is worth."""
        return np.clip(self.row_variance / self.of_mean(rows), 1.0, rows)

    def rows_per_reading(self, rows: float | None = None) -> float:
        """Rows that one independent reading takes, for means of `rows` rows (default: of many more than seen)."""
        n = 4.0 * float(self.sizes[-1]) if rows is None else rows
        return float(np.maximum(n * self.of_mean(n) / self.row_variance, 1e-9))

    def of_neighbours(self, rows: float) -> float:
        """Correlation between the means of two neighbouring bins of `rows` rows."""
        one, two = (_sum_variance(k * rows, self.white, self.memory) for k in (1.0, 2.0))
        return float(two / (2.0 * one) - 1.0)


@dataclass(frozen=True)
class RowScatter:
    """Scatter of a log's rows about a smooth curve, as if rows were independent: variance (rows,), and what it was estimated from."""

    variance: np.ndarray
    degrees_of_freedom: float


def row_scatter(value: np.ndarray, pieces: np.ndarray) -> RowScatter:
    """Variance of the rows from third differences of neighbours: one figure for the whole log, unless it clearly varies.

    By stretches of some dozens of rows, whose median no bend and no spike moves. Where the stretches differ by more than
    chance, each row takes the median of the stretches around it.
    """
    variance, middle, piece = _stretches(value, pieces)
    if not len(variance) or not np.median(variance) > 0.0:
        return RowScatter(np.zeros(len(value)), 1.0)
    share = STRETCH / REDUNDANT
    level = float(np.median(variance)) / _median_of_mean(share)
    positive = np.maximum(variance, 1e-12 * level)
    spread = np.log(positive) - np.log(np.median(positive))
    unequal = float(np.sum(spread**2) / polygamma(1, share / 2.0))
    # One figure's error: that of a median, whose efficiency is 2/pi.
    degrees_of_freedom = 2.0 / np.pi * share * len(variance)
    if len(variance) < 2 * AROUND or chdtrc(len(variance), unequal) > UNEQUAL:
        return RowScatter(np.full(len(value), level), degrees_of_freedom)
    local = np.empty(len(variance))
    for one in np.unique(piece):
        inside = np.flatnonzero(piece == one)
        reach = min(AROUND // 2, (len(inside) - 1) // 2)
        padded = np.pad(variance[inside], reach, mode="reflect") if reach else variance[inside]
        local[inside] = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
    local /= _median_of_mean(share)
    by_row = np.zeros(len(value))
    for start, stop in piece_bounds(pieces):
        inside = piece == pieces[start]
        if inside.any():
            by_row[start:stop] = np.interp(np.arange(start, stop), middle[inside], local[inside])
    return RowScatter(np.where(by_row > 0.0, by_row, level), degrees_of_freedom)


def _stretches(value: np.ndarray, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(variance of a row, middle row, piece) of stretches of rows, from third differences."""
    variance, middle, piece = [], [], []
    for start, stop in piece_bounds(pieces):
        square = np.diff(value[start:stop], n=3) ** 2 / 20.0
        count = len(square) // STRETCH
        if count:
            variance.append(square[: count * STRETCH].reshape(count, STRETCH).mean(axis=1))
            middle.append(start + STRETCH * (np.arange(count) + 0.5) + 1.5)
            piece.append(np.full(count, pieces[start]))
    if not variance:
        return np.zeros(0), np.zeros(0), np.zeros(0, dtype=int)
    return np.concatenate(variance), np.concatenate(middle), np.concatenate(piece)


def _median_of_mean(degrees_of_freedom: float) -> float:
    """Median of chi-square over its degrees of freedom (Wilson and Hilferty, PNAS 17, 1931)."""
    return (1.0 - 2.0 / (9.0 * degrees_of_freedom)) ** 3


def independent_rows(value: np.ndarray, pieces: np.ndarray, scatter: RowScatter, most: int) -> bool:
    """Whether means of 2, 4, ... up to `most` neighbouring rows scatter as those of independent rows do.

    Third differences of such means against what `scatter` says of one row, stretch by stretch, median over stretches. A
    scale at which the curve's own bends show (their third differences do not alternate in sign, or the sweep is but a
    few such means long) says nothing. What remembers longer shows between the points of a fit. Rows that do not alternate
    among themselves, such as those of a meter that is read faster than it measures, are not independent.
    """
    single = [np.diff(value[start:stop], n=3) for start, stop in piece_bounds(pieces)]
    if np.mean(np.concatenate([third[1:] * third[:-1] < 0 for third in single])) < ROWS_ALTERNATE:
        return False
    size = 2
    most = min(most, max(2, int(np.median(np.bincount(pieces - pieces.min()))) // RESOLVED))
    while size <= most:
        ratios, alternating = [], []
        for start, stop in piece_bounds(pieces):
            count = (stop - start) // size
            if count < 8:
                continue
            rows = slice(start, start + count * size)
            stated = scatter.variance[rows].reshape(count, size).mean(axis=1) / size
            third = np.diff(value[rows].reshape(count, size).mean(axis=1), n=3)
            expected = (stated[:-3] + stated[1:-2] + stated[2:-1] + stated[3:]) / 4.0
            usable = expected > 0.0
            ratio = (third**2 / 20.0)[usable] / expected[usable]
            whole = len(ratio) // FEW * FEW
            ratios.append(ratio[:whole].reshape(-1, FEW).mean(axis=1))
            alternating.append((third[1:] * third[:-1] < 0)[usable[1:] & usable[:-1]])
        found = np.concatenate(ratios) if ratios else np.zeros(0)
        if len(found) < 6:
            break
        if np.mean(np.concatenate(alternating)) > ALTERNATES:
            share = FEW / REDUNDANT
            ratio = float(np.median(found)) / _median_of_mean(share)
            error = np.sqrt(np.pi / (share * len(found)) + 2.0 / scatter.degrees_of_freedom)
            if abs(ratio - 1.0) > CLEARLY * error:
                return False
        size *= 2
    return True


def log_scatter(value: np.ndarray, pieces: np.ndarray, lag: int) -> np.ndarray:
    """Squared third difference per row at a lag of some rows, over 20: local variance about a local parabola; same shape.

    Rows near a piece's ends repeat the nearest difference inside it.
    """
    scatter = np.zeros(len(value))
    for start, stop in piece_bounds(pieces):
        n = stop - start
        k = min(lag, (n - 1) // 3)
        if k == 0:
            continue
        y = value[start:stop]
        d = (y[: n - 3 * k] - 3 * y[k : n - 2 * k] + 3 * y[2 * k : n - k] - y[3 * k :]) ** 2 / 20.0
        centre = np.clip(np.arange(n) - (3 * k) // 2, 0, len(d) - 1)
        scatter[start:stop] = d[centre]
    return scatter


def log_correlation(value: np.ndarray, local: np.ndarray, pieces: np.ndarray, bin_rows: int) -> LogCorrelation:
    """How fast means of neighbouring rows settle: third differences of means over half a bin to four bins, against `local`.

    value, pieces (n,); local (n,): smoothed `log_scatter`, 0 where it says nothing (constant or coarsely rounded
    readings). Medians over the log keep bends and jumps of the curve out. A white and a forgetful share are fitted to
    the scales.
    """
    sizes = sorted({max(1, bin_rows // 4), max(1, bin_rows // 2), bin_rows, 2 * bin_rows, 4 * bin_rows})
    rows, ratios, weights = [], [], []
    for size in sizes:
        samples, alternating = [], []
        for start, stop in piece_bounds(pieces):
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
        noise = len(sample) >= 20 and float(np.mean(np.concatenate(alternating))) > ALTERNATES
        if noise and np.median(sample) > 0:
            rows.append(size)
            ratios.append(np.median(sample) / MEDIAN_OF_CHI2)
            weights.append(len(sample) / 4.0)
    if not rows:
        return LogCorrelation()
    fitted = _fit_shares(np.array(rows, float), np.array(ratios), np.array(weights))
    return replace(fitted, row_variance=max(_row_variance(value, local, pieces, 2 * bin_rows), 1e-12))


def _row_variance(value: np.ndarray, local: np.ndarray, pieces: np.ndarray, size: int) -> float:
    """Variance of a row about parabolas over blocks of `size` rows, against `local`; median over the blocks."""
    size = max(size, 12)
    t = np.linspace(-1.0, 1.0, size)
    basis, _ = np.linalg.qr(np.stack([np.ones(size), t, t**2], axis=1))
    ratios = []
    for start, stop in piece_bounds(pieces):
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
    """The share of white noise and the memory of the rest that agree best with the scatter of means of so many rows."""
    # Scales share their rows, and ripple is neither white nor forgetful: no scale is trusted beyond 10 %.
    trust = 1.0 / (0.1**2 + 2.0 / weights)
    memories = np.geomspace(1.0, 2.0 * rows.max(), 24)
    best, least = LogCorrelation(), np.inf
    for white in (1.0, 0.95, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1, 0.0):
        memory = np.zeros(1) if white == 1.0 else memories
        misfit = np.log(ratios) - np.log(_third_difference_of_means(rows, white, memory[:, None]))
        level = np.sum(weights * misfit, axis=1) / np.sum(weights)
        cost = np.sum(trust * (misfit - level[:, None]) ** 2, axis=1) + (0.0 if white == 1.0 else PENALTY)
        k = int(np.argmin(cost))
        if cost[k] < least:
            least = float(cost[k])
            excess = np.exp((misfit[k] - level[k]) * weights / (weights + 20.0))
            best = LogCorrelation(float(np.exp(level[k])), white, float(memory[k]), sizes=rows, excess=excess)
    return best


def _third_difference_of_means(rows: np.ndarray, white: float, memory: np.ndarray) -> np.ndarray:
    """Variance (over 20) of third differences between means of `rows` neighbouring rows, for noise of variance 1."""
    total = [_sum_variance(k * rows, white, memory) for k in range(5)]
    covariance = [total[1], *((total[k + 1] - 2 * total[k] + total[k - 1]) / 2.0 for k in (1, 2, 3))]
    seen = 20 * covariance[0] - 30 * covariance[1] + 12 * covariance[2] - 2 * covariance[3]
    return np.maximum(seen, 1e-300) / (20.0 * rows**2)


def _sum_variance(n: Values, white: float, memory: Values) -> Values:
    """Variance of the sum of n neighbouring rows of unit variance: white share, and the rest AR(1) with the given memory."""
    if white == 1.0:
        return n + 0.0 * memory
    a = np.exp(-1.0 / memory)
    forgetful = n * (1 + a) / (1 - a) - 2 * a * (1 - a**n) / (1 - a) ** 2
    return white * n + (1 - white) * forgetful
