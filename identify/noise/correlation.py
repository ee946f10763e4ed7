"""How the noise of neighbouring readings correlates, estimated from residuals along the sweeps, and what that does to error bars.

Two estimates. `noise_correlation` fits AR(1) plus white noise to the autocorrelation of a fit's residuals. `ProjectedNoise` does
so where only what a projection leaves of the noise is seen: moments of the rest against their expectation. A projection takes
mostly slow parts, so what is left of white noise is correlated negatively, and of noise with a long memory hardly anything is
left. Both are known exactly: with r = (I - P) e and cov(e) = R, cov(r) = (I - P) R (I - P).
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtbtrs  # pyright: ignore[reportAttributeAccessIssue]  # its stubs do not list it
from scipy.special import chdtrc

from thermohyd.identify.reduction.monotone_pieces import piece_bounds


MOST_MEMORY = 0.995  # phi: noise that remembers longer is drift, which a sweep cannot tell from the curve
LAGS = 12  # rows: a third is still left there of a phi of 0.91, and fewer lags would not tell share and phi apart
# Residuals, alone and per parameter, below which nothing is said: what a fit takes out of few of them looks like memory.
FEWEST, PER_PARAMETER = 20, 15
SIGNIFICANT = 2.5  # fitted share in units of its standard error under white noise, below which noise counts as white


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


def recursion(keep: float, source: np.ndarray) -> np.ndarray:
    """y of the shape of `source` with y_i = keep y_(i-1) + source_i along the first axis, y = 0 before the first row.

    By substitution in a banded triangle (LAPACK), what `scipy.signal.lfilter` gives as fast: importing that package takes 0.4 s of every
    process.
    """
    rows = len(source)
    return dtbtrs(np.stack([np.ones(rows), np.full(rows, -keep)]), source, uplo="L", diag="U")[0]


@dataclass(frozen=True)
class NoiseCorrelation:
    """Stationary noise: rho_0 = 1, rho_l = share phi^l. share 0 is white; 1 is AR(1); between them AR(1) plus white."""

    share: float = 0.0
    phi: float = 0.0

    @property
    def inflation(self) -> float:
        """1 + 2 sum rho: how many correlated readings are worth one independent reading."""
        return 1.0 + 2.0 * self.share * self.phi / (1.0 - self.phi)

    def independent(self, rows: float) -> float:
        """How many independent readings say as much of the variance as so many of these: rows over 1 + 2 sum rho^2."""
        return rows / (1.0 + 2.0 * (self.share * self.phi) ** 2 / (1.0 - self.phi**2))


@dataclass(frozen=True)
class Sums:
    """Sums of r_t r_(t+l) (lags + 1,) over stretches of noise of variance 1, and of how many pairs each is."""

    products: np.ndarray
    pairs: np.ndarray

    @staticmethod
    def of(stretches: Sequence[np.ndarray], lags: int = LAGS) -> "Sums":
        products, pairs = np.zeros(lags + 1), np.zeros(lags + 1)
        for r in stretches:
            for lag in range(min(lags + 1, len(r))):
                products[lag] += float(r[lag:] @ r[: len(r) - lag])
                pairs[lag] += len(r) - lag
        return Sums(products, pairs)

    def cut(self, lags: int) -> "Sums":
        return Sums(self.products[: lags + 1], self.pairs[: lags + 1])

    def expected(self, phi: float) -> np.ndarray:
        return self.pairs * phi ** np.arange(len(self.pairs))


def noise_correlation(residual: np.ndarray, sweeps: np.ndarray, parameters: float) -> NoiseCorrelation:
    """Fit (share, phi) to the autocorrelation of residuals (n,) pooled over the sweeps (n,), an id per row in sweep order.

    Fitting p parameters takes (1 + 2 sum rho) p/n off every correlation; that bias is added back once (Kendall, 1954,
    for a fitted mean; here spread over the sweeps' rows), so that short sweeps do not look whiter than they are.
    """
    pieces = [residual[sweeps == s] for s in np.unique(sweeps)]
    n = len(residual)
    lags = min(LAGS, max((len(p) for p in pieces), default=1) - 2)
    power = float(np.sum(residual**2))
    if lags < 1 or power <= 0.0 or n < max(FEWEST, PER_PARAMETER * parameters):
        return NoiseCorrelation()
    seen = Sums.of(pieces, lags)
    rho = seen.products[1:] / power * n / np.maximum(seen.pairs[1:], 1.0)
    # Over all lags together, not lag 1 alone: weak noise with a long memory costs most and shows least at any one lag.
    found, significance = _fitted(rho + parameters / n, n)
    if significance < SIGNIFICANT:
        return NoiseCorrelation()
    unbiased = rho + found.inflation * parameters / n * (1.0 - rho)
    return _fitted(np.clip(unbiased, -1.0, 1.0), n)[0]


def _fitted(rho: np.ndarray, n: int) -> tuple[NoiseCorrelation, float]:
    """Least squares of share phi^l over a grid of phi, for which the share is linear; and share/(its standard error).

    Later lags count less, as they say less. The standard error is that of n white readings: 1/sqrt(n) for every rho_l.
    """
    lag = np.arange(1, len(rho) + 1)
    weight = 1.0 / lag
    phi = np.concatenate([np.linspace(0.05, 0.95, 91), np.linspace(0.955, MOST_MEMORY, 9)])
    shape = phi[:, None] ** lag
    norm = np.sum(weight * shape**2, axis=1)
    raw = np.sum(weight * shape * rho, axis=1) / norm
    share = np.clip(raw, 0.0, 1.0)
    best = int(np.argmin(np.sum(weight * (rho - share[:, None] * shape) ** 2, axis=1)))
    error = np.sqrt(np.sum((weight * shape[best]) ** 2) / n) / norm[best]
    return NoiseCorrelation(float(share[best]), float(phi[best])), float(raw[best] / error)


def correlated_sum(columns: np.ndarray, sweeps: np.ndarray, noise: NoiseCorrelation) -> np.ndarray:
    """J' R J (p, p) for columns J (n, p): R has ones on the diagonal and share phi^|i-j| within a sweep.

    O(n log n): the memory m_i = J_i + phi m_(i-1) of a sweep doubles its reach with every pass.
    """
    total = columns.T @ columns
    if noise.share == 0.0 or noise.phi == 0.0:
        return total
    order = np.argsort(sweeps, kind="stable")
    columns, sweeps = columns[order], sweeps[order]
    memory = columns.copy()
    reach, fade = 1, noise.phi
    while reach < len(columns) and fade > 1e-17:
        inside = (sweeps[reach:] == sweeps[:-reach])[:, None]
        memory[reach:] += fade * np.where(inside, memory[:-reach], 0.0)
        reach, fade = 2 * reach, fade**2
    cross = columns.T @ (memory - columns)
    return total + noise.share * (cross + cross.T)


FEW = 20  # rows, below which nothing is said
# Where a memory is looked for; about the best of them at `FINER` steps once more: of a log of 3,000 rows phi is known to 0.01, and
# where it is taken for 0.90 instead of 0.86 noise looks a third too large.
MEMORIES = np.concatenate([np.arange(0.1, 0.9, 0.05), np.arange(0.9, 0.99, 0.02), [0.99, MOST_MEMORY]])
FINER = np.arange(-0.04, 0.041, 0.01)
# All channels ask for these; each of the finer ones would be as large as the record's columns.
KEPT = frozenset((0.0, *MEMORIES.tolist()))
# Of chi-square, that white noise beside the one with a memory must be worth (Akaike): of some hundred rows share and phi are known
# together only, and a share of a half with a memory of ten rows looks like a memory of two.
TWO_PARTS = 2.0
# Probability of sums further from any such noise than chance makes them. The real servovalve's leakage beside the ideal valve has a
# chi-square of 155 with 11 degrees of freedom: sums that fall along a straight line and go below zero, as a missing effect's do. Its
# memory was taken for 0.95 by the weights of noise that has one and for 0.90 by those of white noise.
NO_NOISE = 1e-4
# Of the power of noise with a memory, against white noise's: where the projection leaves less, it hides the memory too.
LEAST_LEFT = 0.2
SHARES = np.linspace(0.0, 1.0, 41)


@dataclass(frozen=True)
class Remembered:
    """correlation of the noise, and its variance [of the rest's squares], as it was before the projection."""

    correlation: NoiseCorrelation
    variance: float


class ProjectedNoise:
    """Stationary noise of which only what a projection leaves is seen, to tell its memory from that.

    q (rows, k): orthonormal columns that were projected out. stretches (rows,): ids of rows that remember each other.
    """

    def __init__(self, q: np.ndarray, stretches: np.ndarray) -> None:
        self.q = q
        self.pieces = list(piece_bounds(stretches))
        self._kept: dict[float, np.ndarray] = {}

    def _spread(self, phi: float) -> np.ndarray:
        """A with cov(r) = R - Q A' - A Q' for R with phi^|i-j| within a stretch."""
        remembered = self.q.copy()
        if phi > 0.0:
            for start, stop in self.pieces:
                part = self.q[start:stop]
                ahead = recursion(phi, part)
                back = recursion(phi, part[::-1])[::-1]
                remembered[start:stop] = ahead + back - part
        return remembered - 0.5 * self.q @ (self.q.T @ remembered)

    def sums(self, phi: float, rows: slice, lags: int) -> np.ndarray:
        """Expected sums of r_t r_(t+l), l = 0 ... lags, over the stretches in `rows`, for noise of variance 1."""
        a, q = self._kept.get(phi), self.q
        if a is None:
            a = self._spread(phi)
            if phi in KEPT:
                self._kept[phi] = a
        expected = np.zeros(lags + 1)
        for start, stop in self._within(rows):
            for lag in range(min(lags + 1, stop - start)):
                early, late = slice(start, stop - lag), slice(start + lag, stop)
                whole = (stop - start - lag) * (phi**lag if phi > 0.0 else float(lag == 0))
                expected[lag] += whole - np.sum(q[early] * a[late]) - np.sum(a[early] * q[late])
        return expected

    def degrees_of_freedom(self, rows: slice) -> float:
        """Rows less what the projection took of them: the expected sum of r_t^2 of white noise."""
        return float(self.sums(0.0, rows, 0)[0])

    def _within(self, rows: slice) -> list[tuple[int, int]]:
        return [(start, stop) for start, stop in self.pieces if rows.start <= start and stop <= rows.stop]

    def remembered(
        self, rest: np.ndarray, rows: slice, size: float | None = None, beside: Sums | None = None
    ) -> Remembered:
        """Correlation and variance of the noise in `rows` of the projected residual `rest`; size: its variance where known.

        Least squares of the sums of r_t r_(t+l) over all memories and shares, against their scatter for white noise first and, where
        that is not it, for noise with the memory found so far: lags that share their rows then count as one. Where the size is known a
        long memory must have left as much as is seen: a few rows say that more safely than a slope.
        beside: sums of the same noise that no projection touched.
        """
        pieces = self._within(rows)
        n = rows.stop - rows.start
        lags = min(LAGS, max((stop - start for start, stop in pieces), default=1) - 2)
        seen = Sums.of([rest[a:b] for a, b in pieces], max(lags, 0))
        white = self.sums(0.0, rows, max(lags, 0))
        plain = Remembered(NoiseCorrelation(), float(seen.products[0]) / max(white[0], 1.0) if n else 0.0)
        if lags < 1 or n < FEW or seen.products[0] <= 0.0:
            return plain
        more = beside.cut(lags) if beside is not None else Sums(np.zeros(lags + 1), np.zeros(lags + 1))
        products, pairs = seen.products + more.products, seen.pairs + more.pairs
        white = white + more.expected(0.0)
        fewer = np.sqrt(pairs[0] / pairs)
        remembering = functools.cache(lambda phi: self.sums(phi, rows, lags) + more.expected(phi))

        def best(memories: np.ndarray, inverse: np.ndarray, level: float) -> tuple[float, Remembered]:
            """The least chi-square, with its noise. inverse (lags + 1, lags + 1): of the scatter of the sums of noise of variance 1,
            per row; level: that variance."""
            found = [(np.inf, plain)]
            for phi in memories.tolist():
                remembered = remembering(phi)
                if remembered[0] < LEAST_LEFT * white[0]:
                    break
                power = (1.0 - SHARES)[:, None] * white + SHARES[:, None] * remembered
                weighed = power @ inverse
                scale = size or (weighed @ products / np.sum(weighed * power, axis=1))[:, None]
                away = (products - scale * power) / (level * white[0] * fewer)
                left = white[0] * np.einsum("si,ij,sj->s", away, inverse, away)
                left[:-1] += TWO_PARTS
                k = int(np.argmin(left))
                variance = float(products[0]) / max(power[k, 0], 1.0)
                found.append((float(left[k]), Remembered(NoiseCorrelation(float(SHARES[k]), phi), variance)))
            return min(found, key=lambda each: each[0])

        # A correlation of white rows scatters by 1/sqrt(rows), a variance by sqrt(2/rows); later lags say less.
        of_white = np.diag(1.0 / np.append(2.0, np.arange(1.0, lags + 1.0)))
        scale = size or float(products[0]) / max(white[0], 1.0)
        away = (products - scale * white) / (scale * white[0] * fewer)
        least, found = first = best(MEMORIES, of_white, scale)
        if least > white[0] * float(away @ of_white @ away) - SIGNIFICANT**2:
            return plain
        # Once more with what sums of such noise scatter by, and once about the best.
        for near in (False, True):
            memories = found.correlation.phi + FINER if near else MEMORIES
            memories = memories[(memories >= MEMORIES[0]) & (memories <= MOST_MEMORY)]
            inverse = np.linalg.inv(_scatter_of_sums(found.correlation, lags))
            least, found = best(memories, inverse, size or found.variance)
        # What no such noise leaves is a misfit of the model, and to weigh it as one only makes it look longer.
        return found if chdtrc(max(lags - 1, 1), least) > NO_NOISE else first[1]


FURTHEST = 400  # rows, of a memory: 0.13 of the longest is left there


def _scatter_of_sums(noise: NoiseCorrelation, lags: int) -> np.ndarray:
    """Covariances (lags + 1, lags + 1) of the sums of r_t r_(t+l) of Gaussian noise of variance 1, per row (Bartlett 1946)."""
    rows = np.abs(np.arange(-FURTHEST - 2 * lags, FURTHEST + 2 * lags + 1))
    rho = np.where(rows == 0, 1.0, noise.share * noise.phi**rows)
    at = lambda lag: rho[2 * lags + lag : 2 * lags + lag + 2 * FURTHEST + 1]
    apart = [float(at(0) @ at(lag)) for lag in range(2 * lags + 1)]
    lag = np.arange(lags + 1)
    return np.take(apart, np.abs(np.subtract.outer(lag, lag))) + np.take(apart, np.add.outer(lag, lag))
