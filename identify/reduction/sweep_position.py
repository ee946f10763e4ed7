"""Recover the smooth sweep behind a log's rounded, dithered position, by straight lines through the rows around. NumPy only."""

from dataclasses import dataclass

import numpy as np

from thermohyd.identify.noise.correlation import effective_size
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .monotone_pieces import piece_bounds, running_medians
from .rounding import local_steps, reading_steps, rounding_error


NEAREST = 2  # rows either side of the narrowest line through a curve
# Standard errors; of 0.5 to 3 this comes nearest to the slopes of a tanh in noise of a thousandth to a hundredth of its height.
AGREE = 3.0
AROUND, FEW_AROUND, FEWER = (
    49,
    5,
    0.01,
)  # rows that are of about one slope; pieces of few such; least share of the whole piece's variance
NOISELESS = 0.01  # of the way from row to row: a position that scatters by less is exact
STEPS_ACROSS = 3.0  # a window over this many steps of the log averages its rounding away


@dataclass(frozen=True)
class Abscissa:
    """The sweep's position behind a log, one entry per row (SI).

    position: smoothed; scatter: variance of a row about it, as of rows that are independent; error: standard error of it by what dither
    and sweep leave of the log's rounding; step: of that rounding.
    half: rows on either side that the line through a row is of. staircase: True in pieces whose spool stands still between steps, so
    that bins had better end with a step.
    """

    position: np.ndarray
    scatter: np.ndarray
    error: np.ndarray
    half: np.ndarray
    staircase: np.ndarray
    step: np.ndarray

    def covariance_of_means(self, pieces: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Of the errors of the smooth sweep's means over bins that begin at rows `starts` (bins, bins): neighbours in one window share
        theirs."""
        rows = np.diff(np.append(starts, len(pieces)))
        found = np.zeros((len(starts), len(starts)))
        for start, stop in piece_bounds(pieces):
            bins = np.flatnonzero((starts >= start) & (starts < stop))
            weight = _weights_of_means(stop - start, int(self.half[start:stop].max()), starts[bins] - start)
            found[np.ix_(bins, bins)] = (weight * self.scatter[start:stop]) @ weight.T
        mean = np.add.reduceat(self.error, starts) / rows
        own = np.diag(found).copy()
        # What rounding leaves is shared as noise is.
        more = np.sqrt((own + mean**2) / np.where(own > 0.0, own, 1.0))
        found *= np.outer(more, more)
        found[np.diag_indices_from(found)] = own + mean**2
        return found


def smooth_abscissa(position: np.ndarray, pieces: np.ndarray, readings: list[np.ndarray] | None = None) -> Abscissa:
    """Local straight lines through the logged position of each piece, over as many rows as its rounding and dither ask for.

    A position that stands still between steps, where the `readings` (rows,) do not, was only rounded: it is joined up.
    """
    step, read = local_steps(position), reading_steps(position, pieces)
    smooth, staircase, halves = position.copy(), np.zeros(len(position), bool), np.zeros(len(position), int)
    variance, error = np.zeros(len(position)), np.zeros(len(position))
    for start, stop in piece_bounds(pieces):
        part = slice(start, stop)
        x = position[part]
        if stop - start < 8 or np.ptp(x) == 0:
            continue
        if _is_staircase(x):
            joined = _joined_steps(x)
            if any(_moves_with(joined - x, x, reading[part]) for reading in readings or []):
                smooth[part] = joined
            else:
                staircase[part] = True
            continue
        step[part] = read[part]  # an even sweep lies on a grid that no rounding made
        half = _half_window(x, float(step[part].max()))
        if half == 0:
            continue
        line, slope, _ = local_line(x, half)
        scatter = float(np.sqrt(np.mean((x - line) ** 2)))
        smooth[part], halves[part] = line, half
        correlated = float(np.clip((stop - start) / effective_size(x - line), 1.0, 5.0))
        covered = np.abs(slope) * (2 * half + 1)
        variance[part], error[part] = scatter**2 * correlated, rounding_error(step[part], scatter, covered)
    return Abscissa(smooth, variance, error, halves, staircase, step)


def _weights_of_means(rows: int, half: int, starts: np.ndarray) -> np.ndarray:
    """What each of a piece's rows counts (bins, rows) in the means over bins of `local_line` through them."""
    row = np.arange(rows)
    low, high = np.maximum(row - half, 0), np.minimum(row + half, rows - 1) + 1
    count, middle = high - low, 0.5 * (low + high - 1)
    spread = count * (count**2 - 1.0) / 12.0
    slope = np.where(spread > 0.0, (row - middle) / np.where(spread > 0.0, spread, 1.0), 0.0)
    level = 1.0 / count - slope * middle
    size = np.diff(np.append(starts, rows))
    of = np.repeat(np.arange(len(starts)), size)
    sums = np.zeros((2, len(starts), rows + 1))
    for found, own in zip(sums, (level, slope), strict=True):
        np.add.at(found, (of, low), own)
        np.add.at(found, (of, high), -own)
    level, slope = np.cumsum(sums, axis=2)[..., :-1]
    return (level + slope * row) / size[:, None]


def local_line(
    values: np.ndarray, half: int, along: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Straight lines over `half` rows on either side (one-sided at the ends), per row, `along` the rows' order or what is given.

    Value, slope, and what share of the variance of a row's noise is left in its distance from the line.
    """
    line, slope, spread, away, count = _lines_through(values, half, along)
    return line, slope, 1.0 - 1.0 / count - away**2 / np.where(spread > 0, spread, 1.0)


def _lines_through(
    values: np.ndarray, half: int, along: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Value and slope of `local_line`; sum of squares of `along` about the rows' mean, each row's distance from it, and rows."""
    n = len(values)
    row = np.arange(n)
    low, high = np.maximum(row - half, 0), np.minimum(row + half, n - 1) + 1
    t = row - n / 2.0 if along is None else along - along.mean()
    y = values - values.mean()
    sums = [np.concatenate([[0.0], np.cumsum(a)]) for a in (t, t * t, y, t * y)]
    st, stt, sy, sty = (s[high] - s[low] for s in sums)
    count = high - low
    spread = stt - st**2 / count
    slope = np.where(spread > 0, (sty - st * sy / count) / np.where(spread > 0, spread, 1.0), 0.0)
    away = t - st / count
    return values.mean() + sy / count + slope * away, slope, spread, away, count


def local_cubic(values: np.ndarray, half: int, along: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `local_line`, by cubics `along` what is given over 2 half + 1 rows; at the ends over as many, all on one side."""
    n, width = len(values), 2 * half + 1
    rows = np.clip(np.arange(n) - half, 0, n - width)[:, None] + np.arange(width)
    t = along[rows] - along[:, None]
    scale = np.max(np.abs(t), axis=1)
    q, r = np.linalg.qr((t / scale[:, None])[..., None] ** np.arange(4))
    inverse = np.linalg.inv(r)  # of a row's own place, where t = 0, the value is the first coefficient
    fitted = np.einsum("nij,nwj,nw->ni", inverse[:, :2], q, values[rows] - values[:, None])
    return values + fitted[:, 0], fitted[:, 1] / scale, 1.0 - np.sum(inverse[:, 0] ** 2, axis=1)


def curve_slopes(position: np.ndarray, value: np.ndarray, pieces: np.ndarray, *, shrunk: bool = False) -> np.ndarray:
    """Slope of a reading's curve at every row (rows,), by lines through as many neighbours as its noise asks for and its bend allows.

    The widest of doubling windows whose slope agrees with those of all narrower ones to within `AGREE` standard errors each
    (Goldenshluger & Nemirovski, Mathematical Methods of Statistics 6, 1997, p. 135). shrunk: towards 0 as far as they are unknown, so
    that where a curve is flat no slope is made of its noise (James & Stein, Berkeley Symposium 4, 1961).
    """
    slope = np.zeros(len(position))
    for start, stop in piece_bounds(pieces):
        x, y, count = position[start:stop], value[start:stop], stop - start
        if count < 3 or np.ptp(x) == 0.0:
            continue
        noise = _noise_around(x, y)
        found, unknown, open_ = np.zeros(count), np.zeros(count), np.ones(count, dtype=bool)
        low, high = np.full(count, -np.inf), np.full(count, np.inf)
        half = NEAREST
        while half <= max(NEAREST, count // 4) and open_.any():
            _, slopes, spread, *_ = _lines_through(y, half, x)
            error = AGREE * noise / np.sqrt(np.where(spread > 0.0, spread, np.inf))
            low, high = np.maximum(low, slopes - error), np.minimum(high, slopes + error)
            open_ &= (low <= high) | (half == NEAREST)
            found[open_], unknown[open_] = slopes[open_], error[open_]
            half *= 2
        if shrunk:
            square = np.where(found == 0.0, 1.0, found**2)
            found = found * np.maximum(1.0 - unknown**2 / square, 0.0)
        slope[start:stop] = found
    return slope


def _noise_around(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Standard deviation of readings about their curve, by third differences: of all rows, of many of those around (rows,)."""
    if len(x) < 4:
        return np.zeros(len(x))
    square = divided_third(x, y) ** 2
    if len(x) < FEW_AROUND * AROUND:
        return np.full(len(x), np.sqrt(np.median(square) / MEDIAN_OF_CHI2))
    # A spool that shakes makes a steep curve scatter more than a flat one.
    around = running_medians(np.pad(square, (1, 2), mode="edge"), AROUND)
    return np.sqrt(np.maximum(around, FEWER * np.median(square)) / MEDIAN_OF_CHI2)


def _is_staircase(x: np.ndarray) -> bool:
    """Steps in one direction only, with rests between them: no dither, and nothing to be learned between the steps."""
    change = np.diff(x)
    moves = change[change != 0]
    forward = max(np.mean(moves > 0), np.mean(moves < 0)) if len(moves) else 0.0
    return bool(0 < len(moves) < 0.2 * len(change) and forward > 0.97)


def _joined_steps(x: np.ndarray) -> np.ndarray:
    """A staircase's position joined up through the middles of its risers; its first and last tread at the same pace."""
    risers = np.flatnonzero(np.diff(x))
    row, middle = risers + 0.5, 0.5 * (x[risers] + x[risers + 1])
    if len(row) < 2:
        return x
    at = np.arange(len(x))
    ends = [middle[0] + (middle[1] - middle[0]) / (row[1] - row[0]) * (at - row[0]),
            middle[-1] + (middle[-1] - middle[-2]) / (row[-1] - row[-2]) * (at - row[-1])]  # fmt: skip
    inside = np.interp(at, row, middle)
    found = np.where(at < row[0], ends[0], np.where(at > row[-1], ends[1], inside))
    return x + np.clip(found - x, -0.5 * np.abs(np.median(np.diff(middle))), 0.5 * np.abs(np.median(np.diff(middle))))


def _moves_with(ramp: np.ndarray, x: np.ndarray, reading: np.ndarray) -> bool:
    """Whether a reading follows the `ramp` within the treads of a staircase, at the slope that it has from tread to tread."""
    tread = np.cumsum(np.append(0, np.diff(x) != 0))
    rows = np.bincount(tread)
    level, height = np.bincount(tread, reading) / rows, np.bincount(tread, x) / rows
    if len(rows) < 4:
        return False
    expected = np.gradient(level, height)[tread] * (ramp - (np.bincount(tread, ramp) / rows)[tread])
    power = float(expected @ expected)
    return power > 0.0 and float(expected @ (reading - level[tread])) > 0.5 * power


def _half_window(x: np.ndarray, step: float) -> int:
    """Rows on either side that cross enough rounding steps, halved until the sweep is straight enough over them."""
    n = len(x)
    pace = abs(float(x[-1] - x[0])) / n
    fine, *_ = local_line(x, 2)
    dither = float(np.sqrt(np.mean((x - fine) ** 2) * 5.0 / 3.0))
    if dither == 0.0 and step == 0.0:
        return 0
    wanted = STEPS_ACROSS * step / (2.0 * pace) if pace > 0 else 0.0
    half = int(np.clip(max(wanted, 10.0 if dither > NOISELESS * pace else 0.0), 0, n // 20))
    allowed = 1.5 * max(dither, step / np.sqrt(12.0))
    while half > 0:
        line, *_ = local_line(x, half)
        if np.sqrt(np.mean((x - line) ** 2)) <= allowed:
            return _widened(x, line, half, step)
        half //= 2
    return 0


def _widened(x: np.ndarray, line: np.ndarray, half: int, step: float) -> int:
    """The window doubled as long as its lines agree with those of half of it to within what these are known to: no bend shows.

    Lepskii, Theory of Probability and its Applications 35, 1991: of estimates that agree the widest.
    """
    pace = abs(float(x[-1] - x[0])) / len(x)
    while 2 * half <= len(x) // 4:
        wider, *_ = local_line(x, 2 * half)
        known = np.mean((x - line) ** 2) / (2 * half + 1) * float(len(x) / effective_size(x - line))
        known += float(rounding_error(step, 0.0, pace * (2 * half + 1))) ** 2
        if np.mean((wider - line) ** 2) > known:
            break
        line, half = wider, 2 * half
    return half
