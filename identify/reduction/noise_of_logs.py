"""Estimate the scatter of a raw log's rows about a smooth curve, what it is made of, and how long it lasts. NumPy and SciPy only.

Third differences along the log are blind to any parabola, so that neither slope nor bend of the curve counts as noise; those of noise
alternate in sign, those of a curve do not. A meter that is read faster than it measures shows none of its noise from row to row: the
rows that are compared lie as far apart as they have to.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, polygamma

from thermohyd.identify.noise.two_parts import parts_of_variance

from .monotone_pieces import moving_mean, piece_bounds
from .third_differences import COARSE, ENOUGH, STRETCH, Stretches, before_rounding, median_of_mean, stretches_of


Values = Any  # a number, or an array of them

PENALTY = 9.0  # in chi-square: white noise, unless the scales say clearly otherwise
REDUNDANT = 2.31  # neighbouring third differences that are worth one independent one: 1 + 2 sum of squared correlations
AROUND, LEAST_LEFT = 5, 0.1  # stretches whose median is local; what positions leave of it, at least
UNEQUAL = 1e-4  # probability of stretches as unequal as this by chance, below which the noise varies along the log
MOSTLY = 0.6  # of the stretches must show noise alone for a lag to say anything
FAR = 4.0  # times what was expected: such a stretch holds a bend or a bad row
# Of the readings' own variance: what positions make in stretches that are asked for the memory, at most.
MINOR = (0.2, 0.5, 1.0)
FADED = 0.7  # share of a variance that a lag shows, from which on it shows enough
CLEARLY = 0.95  # of the stretches that show noise alone at the best lag, so many must at another
SMOOTH = 1e-4  # of a reading's range: what scatters by less is as good as exact
RESOLVED = 110  # parts of a sweep within which a valve's curve hardly bends
UNTOLD = 5.0  # rows that count as one reading where rounding hides what noise remembers
LAGS = (1, 2, 3, 5, 8, 13, 21, 34, 55)  # rows between the readings of a third difference
SHARES, PHIS = np.linspace(0.0, 1.0, 41)[1:], np.concatenate([np.arange(0.1, 0.9, 0.02), np.arange(0.9, 0.995, 0.005)])
TRUSTED = 0.03  # relative error to which any lag's ratio is trusted at best


@dataclass(frozen=True)
class LogCorrelation:
    """Noise of neighbouring rows: a share of its variance forgets by the factor phi from row to row, the rest is white.

    assumed: rounding, or bends that look like noise, hide what rows remember.
    """

    share: float = 0.0
    phi: float = 0.0
    assumed: bool = False

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
class RowNoise:
    """Noise of a log's rows: own variance (rows,), SI; what a position's error does is not in it.

    position: variance of one position's error, m^2, that readings show by their slope; its standard error. degrees_of_freedom:
    from which it was estimated. coarse (rows,): standard deviation where readings rest on steps of their rounding, elsewhere
    infinite; None: no steps, or a stated noise.
    """

    own: np.ndarray
    position: float
    position_error: float
    degrees_of_freedom: float
    correlation: LogCorrelation = LogCorrelation()
    coarse: np.ndarray | None = None


def row_noise(
    value: np.ndarray,
    pieces: np.ndarray,
    slope: np.ndarray | None = None,
    stated: np.ndarray | None = None,
    position: float | None = None,
    step: np.ndarray | None = None,
) -> RowNoise:
    """Noise of a log's readings (rows,): of its own, in proportion to the reading, by the position's error, and what it remembers.

    By stretches of some dozens of rows. Where these scatter beyond what such parts explain, each row takes the median of the stretches
    around it. slope (rows,): of the curve along the position; stated (rows,): standard deviation of a row, where it is; position:
    variance of the position's error [m^2], where it is known.
    """
    slope = np.zeros(len(value)) if slope is None else slope
    step = np.zeros(len(value)) if step is None else step
    lags = [lag for lag in LAGS if lag <= _longest(pieces)]
    found = {lag: stretches for lag in lags if len((stretches := stretches_of(value, pieces, lag)).square)}
    # The shortest distance at which noise shows; where it shows at none, neighbours.
    lag = next((lag for lag, stretches in found.items() if stretches.clear >= MOSTLY), LAGS[0])
    if lag not in found or not np.any(found[lag].square > 0.0):
        return RowNoise(np.zeros(len(value)), 0.0, np.inf, 1.0)
    parts_at = lambda lag, position, correlation: _clear_parts(
        value, pieces, found[lag], slope, step, lag, stated, position, correlation
    )
    noise = first = parts_at(lag, position, LogCorrelation())
    if _only_rounding(found[lag], step):
        return replace(first, correlation=_one_reading_in(UNTOLD))
    told = _correlation(found, first.own, first.position * slope**2, lag, step)
    if told is None:
        return _untold(value, found.get(lags[-1]), lags[-1], first)
    if told.white and lag > 1:
        told = _one_reading_in(lag)  # rows nearer than that are one reading
    elif not told.white:
        # What positions make of it shows best in neighbours, what is remembered in rows farther apart.
        noise = parts_at(_faded(found, told, lag), first.position, told)
    return replace(noise, position_error=first.position_error, correlation=told)


def _one_reading_in(rows: float) -> LogCorrelation:
    """Noise of which so many rows are worth one independent reading."""
    return LogCorrelation(1.0, (rows - 1.0) / (rows + 1.0), assumed=True)


def _clear_parts(
    value: np.ndarray,
    pieces: np.ndarray,
    found: Stretches,
    slope: np.ndarray,
    step: np.ndarray,
    lag: int,
    stated: np.ndarray | None,
    position: float | None,
    correlation: LogCorrelation,
) -> RowNoise:
    """The parts behind stretches without those that hold a bend, a bad row or nothing but their rounding."""
    kept = found.without_bends() if found.clear >= MOSTLY else found
    kept = before_rounding(kept, step)
    shown = float(_seen_at(lag, correlation.share, correlation.phi))
    noise = _parts(value, pieces, kept, slope, lag, stated, position, shown)
    far = kept.square > FAR * kept.mean(shown * noise.own + noise.position * slope**2)
    if far.any() and np.mean(far) <= 1.0 - MOSTLY:
        noise = _parts(value, pieces, kept.only(~far), slope, lag, stated, position, shown)
    return noise


def _untold(value: np.ndarray, longest: Stretches | None, lag: int, noise: RowNoise) -> RowNoise:
    """Noise of a log at whose rows noise and bends look alike: as large as what the longest lag shows, and remembered as long."""
    seen = 0.0 if longest is None else float(np.median(longest.square))
    if seen <= (SMOOTH * float(np.ptp(value))) ** 2:
        return noise  # next to nothing, and bends make most of that
    return replace(
        noise, own=np.maximum(noise.own, seen), correlation=LogCorrelation(1.0, float(np.exp(-1.0 / lag)), True)
    )


def _only_rounding(stretches: Stretches, step: np.ndarray) -> bool:
    """Whether a log shows its rounding rather than its noise, all over: nothing then tells what the noise remembers."""
    left = before_rounding(stretches, step)
    return bool(step.any() and np.sqrt(np.mean(left.square)) < COARSE * np.mean(left.mean(step)))


def _faded(found: dict[int, Stretches], correlation: LogCorrelation, shortest: int) -> int:
    """The shortest lag that shows most of a noise with a memory, or the longest that shows noise at all."""
    clear = {lag: stretches.clear for lag, stretches in found.items() if lag >= shortest}
    told = [lag for lag in clear if clear[lag] >= max(MOSTLY, CLEARLY * max(clear.values()))] or [shortest]
    enough = [lag for lag in told if _seen_at(lag, correlation.share, correlation.phi) > FADED]
    return min(enough, default=max(told))


def _longest(pieces: np.ndarray) -> float:
    """Rows that a lag may have: within so many, a valve's curve hardly bends."""
    return max(float(np.median(np.bincount(pieces - pieces.min()))) / RESOLVED, float(LAGS[2]))


def _parts(
    value: np.ndarray,
    pieces: np.ndarray,
    stretches: Stretches,
    slope: np.ndarray,
    lag: int,
    stated: np.ndarray | None,
    position: float | None,
    shown: float,
) -> RowNoise:
    """The parts, by stretches of third differences at a `lag` that show the share `shown` of the readings' own variance."""
    level = np.abs(_levels(value, pieces, 2 * STRETCH))
    size, steep = stretches.mean(level**2), stretches.mean(slope**2)
    freedom = STRETCH / REDUNDANT / np.sqrt(lag)
    weight = np.full(len(size), freedom)
    known = np.zeros(len(size)) if position is None else position * steep
    if stated is not None:
        if position is not None:
            return RowNoise(stated**2, position, 0.0, np.inf)
        own = shown * stretches.mean(stated**2)
        [amount] = parts_of_variance(stretches.square, [steep], own, weight)
        return RowNoise(stated**2, float(amount), _error(amount * steep + own, steep, freedom), np.inf)
    shapes = [np.full(len(size), shown), shown * size, *([steep] if position is None else [])]
    amounts = parts_of_variance(stretches.square, shapes, known, weight)
    own = amounts[0] + amounts[1] * level**2
    across = float(amounts[2]) if position is None else position
    expected = shown * stretches.mean(own) + across * steep
    error = _error(expected, steep, freedom) if position is None else 0.0
    ratio = np.maximum(stretches.square / expected, 1e-12)
    spread = np.log(ratio) - np.log(np.median(ratio))
    unequal = float(np.sum(spread**2) / polygamma(1, freedom / 2.0))
    if len(ratio) >= 2 * AROUND and chdtrc(len(ratio), unequal) < UNEQUAL:
        left = np.maximum(stretches.square - across * steep, LEAST_LEFT * stretches.square)
        own = _around(left, stretches, pieces) / (shown * median_of_mean(freedom))
    return RowNoise(own, across, error, freedom * len(size))


def _error(expected: np.ndarray, shape: np.ndarray, freedom: float) -> float:
    """Standard error of a shape's amount."""
    information = 0.5 * freedom * float(np.sum((shape / np.maximum(expected, 1e-300)) ** 2))
    return 1.0 / np.sqrt(information) if information > 0.0 else np.inf


def _around(of_stretches: np.ndarray, stretches: Stretches, pieces: np.ndarray) -> np.ndarray:
    """Median of the stretches around every row (rows,), within its piece."""
    by_row = np.full(len(pieces), np.median(of_stretches))
    middle = 0.5 * (stretches.first + stretches.last)
    for start, stop in piece_bounds(pieces):
        inside = stretches.piece == pieces[start]
        if not inside.any():
            continue
        values = of_stretches[inside]
        reach = min(AROUND // 2, (len(values) - 1) // 2)
        padded = np.pad(values, reach, mode="reflect") if reach else values
        local = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
        by_row[start:stop] = np.interp(np.arange(start, stop), middle[inside], local)
    return by_row


def _levels(value: np.ndarray, pieces: np.ndarray, rows: int) -> np.ndarray:
    """Means over so many rows around (rows,), piece by piece."""
    level = value.astype(float).copy()
    for start, stop in piece_bounds(pieces):
        level[start:stop] = moving_mean(level[start:stop], rows // 2)
    return level


def _correlation(
    found: dict[int, Stretches], own: np.ndarray, white: np.ndarray, shortest: int, step: np.ndarray
) -> LogCorrelation | None:
    """How a log's noise forgets: third differences between rows farther and farther apart beside the variance at the shortest lag.

    own (n,): that variance; white (n,): what positions add to it, which remembers nothing; step (n,): of rounding. None: too few rows
    say anything. Medians over stretches keep bends and jumps of the curve out, and a lag at which its bends show says nothing.
    """
    at_lags = ((lag, _at_lag(stretches, own, white, step)) for lag, stretches in found.items() if lag >= shortest)
    kept = [(lag, *of_lag) for lag, of_lag in at_lags if of_lag is not None]
    if len(kept) < 3 or kept[0][0] != shortest:
        return None
    lags, ratio, error = (np.array(each, float) for each in zip(*kept, strict=True))
    seen, weight = np.log(ratio), 1.0 / (error**2 + TRUSTED**2)
    weight /= weight.sum()
    away = seen - np.log(_seen_at(lags, SHARES[:, None, None], PHIS[:, None]))
    size = np.sum(weight * away, axis=-1)  # logarithm of a row's variance, in `own`
    independent = float(np.sum(1.0 / (error**2 + TRUSTED**2)))
    cost = independent * np.sum(weight * (away - size[..., None]) ** 2, axis=-1)
    best = np.unravel_index(int(np.argmin(cost)), cost.shape)
    if independent * float(weight @ (seen - weight @ seen) ** 2) - float(cost[best]) < PENALTY:
        return LogCorrelation()
    return LogCorrelation(float(SHARES[best[0]]), float(PHIS[best[1]]))


def _at_lag(stretches: Stretches, own: np.ndarray, white: np.ndarray, step: np.ndarray) -> tuple[float, float] | None:
    """Variance that third differences at one lag show, beside `own`, and its relative error; None: it says nothing.

    By stretches, without those where the curve's bends show: there differences do not alternate in sign.
    """
    found = before_rounding(stretches, step)
    for most in MINOR:
        minor = found.mean(white) < most * found.mean(own)
        if np.sum(minor) >= ENOUGH:
            found = found.only(minor)
            break
    asked = len(found.square)
    found = found.without_bends()
    found = found.only(found.mean(own) > 0.0)
    if len(found.square) < max(6, MOSTLY * asked):
        return None
    ratios = np.maximum(found.square - found.mean(white), 0.0) / found.mean(own)
    spread = float(np.var(np.log(np.maximum(ratios, 1e-12))))
    # The further apart, the fewer independent differences a stretch holds: from how far the logarithms of stretches scatter.
    freedom = 2.0 * (1.0 + 0.5 * spread) / max(spread, 1e-12)
    return float(np.median(ratios)) / median_of_mean(max(freedom, 1.0)), float(
        np.sqrt(np.pi / 2.0 * spread / len(ratios))
    )


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
