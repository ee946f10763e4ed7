"""Estimate the scatter of a raw log's rows about a smooth curve, and how long that noise lasts. NumPy only.

Third differences along the log are blind to any parabola, so that neither slope nor bend of the curve counts as noise.
Rows are independent unless the log says clearly otherwise: then the mean of n of them is known to 1/sqrt(n) of one,
whatever the bin, and nothing is estimated bin by bin.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc, polygamma

from .monotone_pieces import piece_bounds


Values = Any  # a number, or an array of them

PENALTY = 9.0  # in chi-square: white noise, unless the scales say clearly otherwise
MEDIAN_OF_CHI2 = 0.4549  # one degree of freedom
REDUNDANT = 2.31  # neighbouring third differences that are worth one independent one: 1 + 2 sum of squared correlations
STRETCH, FEW = 48, 12  # third differences that are judged together
AROUND = 5  # stretches whose median is local
UNEQUAL = 1e-4  # probability of stretches as unequal as this by chance, below which the noise varies along the log
ALTERNATES = 0.62  # share of neighbouring third differences of opposite sign: 0.77 in noise, however long its memory
MOSTLY = 0.6  # of the stretches must show noise alone for a lag to say anything
RESOLVED = 75  # parts of a sweep within which a valve's curve hardly bends


@dataclass(frozen=True)
class LogCorrelation:
    """Noise of neighbouring rows: a share of its variance forgets by the factor phi from row to row, the rest is white."""

    share: float = 0.0
    phi: float = 0.0

    @property
    def seen(self) -> float:
        """Variance that third differences of neighbouring rows show, as a share of a row's."""
        return float(_seen_at(np.ones(1), self.share, self.phi)[0])

    @property
    def white(self) -> bool:
        return self.share == 0.0 or self.phi == 0.0

    @property
    def memory(self) -> float:
        """Rows over which it fades to 1/e."""
        return 0.0 if self.white else -1.0 / float(np.log(self.phi))

    def of_mean(self, rows: Values) -> Values:
        """Variance of the mean of `rows` neighbouring rows, as a share of a row's."""
        n = np.asarray(rows, float)[()]
        return _sum_variance(n, self.share, self.phi) / n**2

    def effective_rows(self, rows: Values) -> Values:
        """Independent rows that the mean of `rows` neighbouring ones is worth."""
        return np.clip(1.0 / self.of_mean(rows), 1.0, rows)

    def rows_per_reading(self) -> float:
        """Rows that one independent reading takes, for means of many."""
        return 1.0 if self.white else float(1.0 + 2.0 * self.share * self.phi / (1.0 - self.phi))

    def of_neighbours(self, rows: float) -> float:
        """Correlation between the means of two neighbouring bins of `rows` rows."""
        one, two = (_sum_variance(k * rows, self.share, self.phi) for k in (1.0, 2.0))
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


LAGS = (1, 2, 3, 5, 8, 13, 21, 34, 55)  # rows between the readings of a third difference
SHARES, PHIS = np.linspace(0.0, 1.0, 41)[1:], np.concatenate([np.arange(0.1, 0.9, 0.02), np.arange(0.9, 0.995, 0.005)])
TRUSTED = 0.03  # relative error to which any lag's ratio is trusted at best


def log_correlation(value: np.ndarray, pieces: np.ndarray, scatter: np.ndarray) -> LogCorrelation | None:
    """How a log's noise forgets: third differences between rows 1, 2, ... apart beside the variance that those of neighbours show.

    value, pieces (n,); scatter (n,): that variance (`row_scatter`), 0 for rows that are not to be asked. None: too few rows say
    anything. Medians over stretches keep bends and jumps of the curve out, and a lag at which its bends show says nothing: third
    differences of noise alternate in sign, however long its memory, those of the curve do not.
    """
    longest = np.median(np.bincount(pieces - pieces.min())) / RESOLVED
    found = {lag: _at_lag(value, pieces, scatter, lag) for lag in LAGS if lag <= max(longest, LAGS[2])}
    kept = [(lag, *of_lag) for lag, of_lag in found.items() if of_lag is not None]
    if len(kept) < 3 or kept[0][0] != 1:
        return None
    lags, ratio, error = (np.array(each, float) for each in zip(*kept, strict=True))
    seen = np.log(ratio / ratio[0])[1:]
    weight = 1.0 / (error[1:] ** 2 + error[0] ** 2 + TRUSTED**2)
    expected = _seen_at(lags, SHARES[:, None, None], PHIS[:, None])
    away = seen - np.log(expected[..., 1:] / expected[..., :1])
    cost = np.sum(weight * away**2, axis=-1)
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    if float(np.sum(weight * seen**2)) - float(cost[best]) < PENALTY:
        return LogCorrelation()
    return LogCorrelation(float(SHARES[best[0]]), float(PHIS[best[1]]))


def _at_lag(value: np.ndarray, pieces: np.ndarray, scatter: np.ndarray, lag: int) -> tuple[float, float] | None:
    """Variance that third differences between rows `lag` apart show, beside `scatter`, and its relative error; None: it says nothing.

    By stretches, without those where the curve's bends show: there differences do not alternate in sign.
    """
    ratios, asked, length = [], 0, STRETCH + 3 * lag
    for start, stop in piece_bounds(pieces):
        y, s = value[start:stop], scatter[start:stop]
        if stop - start < 4 * lag + FEW:
            continue
        third = y[: -3 * lag] - 3.0 * y[lag : -2 * lag] + 3.0 * y[2 * lag : -lag] - y[3 * lag :]
        least = np.minimum(np.minimum(s[: -3 * lag], s[lag : -2 * lag]), np.minimum(s[2 * lag : -lag], s[3 * lag :]))
        level = (s[: -3 * lag] + s[lag : -2 * lag] + s[2 * lag : -lag] + s[3 * lag :]) / 4.0
        square = np.divide(third**2 / 20.0, level, out=np.zeros(len(third)), where=least > 0.0)
        turns = np.append(third[lag:] * third[:-lag] < 0.0, np.zeros(lag, dtype=bool))
        rows = np.flatnonzero(least > 0.0)
        for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            for first in range(0, len(part) - length - lag + 1, length):
                own = part[first : first + length]
                asked += 1
                if np.mean(turns[own]) > ALTERNATES:
                    ratios.append(float(np.mean(square[own])))
    if len(ratios) < max(6, MOSTLY * asked):
        return None
    spread = float(np.var(np.log(np.maximum(ratios, 1e-12))))
    # The further apart, the fewer independent differences a stretch holds: from how far the logarithms of stretches scatter.
    freedom = 2.0 * (1.0 + 0.5 * spread) / max(spread, 1e-12)
    return float(np.median(ratios)) / _median_of_mean(max(freedom, 1.0)), np.sqrt(np.pi / 2.0 * spread / len(ratios))


def _seen_at(lag: Values, share: Values, phi: Values) -> Any:
    """Variance that third differences between rows `lag` apart show of noise of variance 1."""
    rho = lambda rows: share * np.power(phi, rows)
    return 1.0 - 1.5 * rho(lag) + 0.6 * rho(2 * lag) - 0.1 * rho(3 * lag)


def _sum_variance(n: Values, share: float, phi: float) -> Values:
    """Variance of the sum of n neighbouring rows of unit variance."""
    if share == 0.0 or phi == 0.0:
        return n
    forgetful = n * (1 + phi) / (1 - phi) - 2 * phi * (1 - phi**n) / (1 - phi) ** 2
    return (1.0 - share) * n + share * forgetful
