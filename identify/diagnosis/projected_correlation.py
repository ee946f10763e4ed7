"""The memory of noise of which only what a projection leaves is seen: moments of the rest against their expectation.

A projection takes mostly slow parts, so what is left of white noise is correlated negatively, and of noise with a long
memory hardly anything is left. Both are known exactly: with r = (I - P) e and cov(e) = R, cov(r) = (I - P) R (I - P).
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from ..legs import piece_bounds
from ..noise_correlation import LAGS, MOST_MEMORY, SIGNIFICANT, NoiseCorrelation


FEW = 20  # rows, below which nothing is said
MEMORIES = np.concatenate([np.arange(0.1, 0.9, 0.05), np.arange(0.9, 0.99, 0.02), [0.99, MOST_MEMORY]])
# Of the power of noise with a memory, against white noise's: where the projection leaves less, it hides the memory too.
LEAST_LEFT = 0.2
SHARES = np.linspace(0.0, 1.0, 41)


@dataclass(frozen=True)
class Remembered:
    """correlation of the noise, and its variance [of the rest's squares], as it was before the projection."""

    correlation: NoiseCorrelation
    variance: float


class ProjectedNoise:
    """q (rows, k): orthonormal columns that were projected out. stretches (rows,): ids of rows that remember each other."""

    def __init__(self, q: np.ndarray, stretches: np.ndarray) -> None:
        self.q = q
        self.pieces = list(piece_bounds(stretches))
        self._kept: dict[float, np.ndarray] = {}

    def _spread(self, phi: float) -> np.ndarray:
        """A with cov(r) = R - Q A' - A Q' for R with phi^|i-j| within a stretch."""
        remembered = self.q.copy()
        if phi > 0.0:
            for start, stop in self.pieces:
                own = self.q[start:stop]
                ahead = lfilter([1.0], [1.0, -phi], own, axis=0)
                back = lfilter([1.0], [1.0, -phi], own[::-1], axis=0)[::-1]
                remembered[start:stop] = ahead + back - own
        return remembered - 0.5 * self.q @ (self.q.T @ remembered)

    def sums(self, phi: float, rows: slice, lags: int) -> np.ndarray:
        """Expected sums of r_t r_(t+l), l = 0 ... lags, over the stretches in `rows`, for noise of variance 1."""
        if phi not in self._kept:
            self._kept[phi] = self._spread(phi)
        a, q = self._kept[phi], self.q
        found = np.zeros(lags + 1)
        for start, stop in self._within(rows):
            for lag in range(min(lags + 1, stop - start)):
                early, late = slice(start, stop - lag), slice(start + lag, stop)
                whole = (stop - start - lag) * (phi**lag if phi > 0.0 else float(lag == 0))
                found[lag] += whole - np.sum(q[early] * a[late]) - np.sum(a[early] * q[late])
        return found

    def freedom(self, rows: slice) -> float:
        """Rows less what the projection took of them: the expected sum of r_t^2 of white noise."""
        return float(self.sums(0.0, rows, 0)[0])

    def _within(self, rows: slice) -> list[tuple[int, int]]:
        return [(start, stop) for start, stop in self.pieces if rows.start <= start and stop <= rows.stop]

    def remembered(self, rest: np.ndarray, rows: slice, size: float | None = None) -> Remembered:
        """Correlation and variance of the noise in `rows` of the projected residual `rest`; size: its variance where known.

        Least squares of the sums of r_t r_(t+l) over all memories and shares, against their scatter for white noise. Where
        the size is known a long memory must have left as much as is seen: a few rows say that more safely than a slope.
        """
        pieces = self._within(rows)
        n = rows.stop - rows.start
        lags = min(LAGS, max((stop - start for start, stop in pieces), default=1) - 2)
        seen = np.array(
            [sum(float(rest[a + lag : b] @ rest[a : b - lag]) for a, b in pieces) for lag in range(lags + 1)]
        )
        white = self.sums(0.0, rows, max(lags, 0))
        plain = Remembered(NoiseCorrelation(), float(seen[0]) / max(white[0], 1.0) if len(seen) else 0.0)
        if lags < 1 or n < FEW or seen[0] <= 0.0:
            return plain
        pairs = np.array([sum(max(b - a - lag, 0) for a, b in pieces) for lag in range(lags + 1)])
        # A correlation of white rows scatters by 1/sqrt(rows), a variance by sqrt(2/rows); later lags say less.
        weight = white[0] * (n / pairs) ** 2 / np.append(2.0, np.arange(1.0, lags + 1.0))

        def misfit(power: np.ndarray) -> np.ndarray:  # (shares, lags + 1) -> (shares,)
            expected, scale = (size * power, size * white[0]) if size else (seen[0] / power[:, :1] * power, seen[0])
            return np.sum(weight * ((seen - expected) / scale) ** 2, axis=1)

        best, least = plain, float(misfit(white[None])[0]) - SIGNIFICANT**2
        for phi in MEMORIES:
            own = self.sums(float(phi), rows, lags)
            if own[0] < LEAST_LEFT * white[0]:
                break
            power = (1.0 - SHARES)[:, None] * white + SHARES[:, None] * own
            left = misfit(power)
            at = int(np.argmin(left))
            if left[at] < least:
                least = left[at]
                variance = float(seen[0]) / max(power[at, 0], 1.0)
                best = Remembered(NoiseCorrelation(float(SHARES[at]), float(phi)), variance)
        return best
