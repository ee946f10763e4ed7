"""The standard error of the mean of a bin of log rows, from scatter, correlation, and rounding of reading and position. NumPy only."""

from dataclasses import dataclass

import numpy as np

from thermohyd.identify.bench.test_record import Channel

from .monotone_pieces import moving_mean, piece_bounds
from .noise_of_logs import STRETCH, LogCorrelation, log_correlation, row_scatter
from .rounding import local_steps, rounding_error, scatter_before_rounding
from .sweep_position import Abscissa


ALONG_BINS = 12  # on either side: scatter changes along a sweep slowly, and 25 bins know it to some per cent
# Of a row's variance what the position's scatter makes: from so much on, and where it is so many times what it is elsewhere, it counts.
LEAST_CARRIED, DIFFERENT = 0.1, 4.0


@dataclass(frozen=True)
class Points:
    """The means of one reading over bins, with standard errors; one entry per bin (SI).

    value: mean of the bin's rows; std: standard error of it; degrees_of_freedom: what that was estimated from (infinite: stated).
    step: rounding step of the log; correlation: of the log's rows; row_std: typical scatter of one row; floored:
    where the rounding counts for more than the noise; sharing: how many neighbouring bins stand on one rounded reading.
    position_part: what the position's error adds to `std`, by the slope from bin to bin.
    """

    value: np.ndarray
    std: np.ndarray
    degrees_of_freedom: float
    step: np.ndarray
    correlation: LogCorrelation
    row_std: float
    floored: np.ndarray
    sharing: np.ndarray
    position_part: np.ndarray


def points_of(
    channel: Channel, starts: np.ndarray, pieces: np.ndarray, abscissa: Abscissa, carried: np.ndarray
) -> Points:
    """Means and standard errors of a channel's readings over the bins of a log that begin at rows `starts`.

    carried (rows,): what scatter of the position makes of a row by the curve's slope. It remembers nothing: where the curve is steep,
    what a row scatters by beyond what it does elsewhere is taken for that.
    """
    y = channel.value
    rows = np.diff(np.append(starts, len(y)))
    mean = lambda values: np.add.reduceat(values, starts) / rows
    value, piece = mean(y), pieces[starts]
    step = _known_steps(channel.as_read, starts)
    ramp = _ramp(value, piece)
    scatter = row_scatter(y, pieces)
    seen = np.sqrt(mean(scatter.variance))
    before = scatter_before_rounding(np.sqrt(np.maximum(_along(seen**2, rows, piece), 0.0)), step, ramp)
    coarse = before < 0.3 * step  # the log shows its own rounding rather than the noise
    local = np.where(np.repeat(coarse, rows), 0.0, scatter.variance)
    steep = _steep(carried**2, scatter.variance, pieces)
    correlation = log_correlation(y, pieces, np.where(steep, 0.0, local)) or log_correlation(y, pieces, local)
    correlation = correlation or LogCorrelation()
    shown = np.maximum(seen, before) ** 2  # by third differences of neighbours
    elsewhere = np.median(scatter.variance[~steep])
    part = np.where(mean(steep) > 0.5, np.maximum(shown - elsewhere, 0.0), 0.0)
    own = (shown - part) / correlation.seen * correlation.of_mean(rows)
    if channel.std is not None:  # declared for one row
        own = mean(channel.std**2) / correlation.effective_rows(rows)
        part = np.clip(shown - mean(channel.std**2) * correlation.seen, 0.0, mean(carried**2))
    part = np.sqrt(part / rows)
    sharing = np.where(coarse, _sharing(y, starts), 1.0)
    rounding = rounding_error(step, before, ramp) * np.sqrt(sharing)
    least = 1e-6 * max(float(np.ptp(y)), float(np.max(np.abs(y), initial=0.0)))
    own = own + rounding**2
    typical = seen[~coarse] / np.sqrt(correlation.seen)
    return Points(
        value=value,
        std=np.maximum(np.sqrt(own), least),
        degrees_of_freedom=np.inf if channel.std is not None else scatter.degrees_of_freedom,
        step=step,
        correlation=correlation,
        row_std=float(np.median(typical)) if len(typical) else 0.0,
        floored=coarse & (step > 0) & (step**2 / 12.0 > 0.1 * (own + part**2)),
        sharing=sharing,
        position_part=part,
    )


def _steep(carried: np.ndarray, variance: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """Rows (rows,) of whose noise the position's scatter makes a larger part than elsewhere; none where it is the same all over."""
    part = carried / np.where(variance > 0.0, variance, np.inf)
    for start, stop in piece_bounds(pieces):
        part[start:stop] = moving_mean(part[start:stop], STRETCH)  # slopes of single rows are noisy
    low, high = np.quantile(part, (0.05, 0.95))
    if not high > max(DIFFERENT * low, LEAST_CARRIED):
        return np.zeros(len(part), dtype=bool)
    return part > np.sqrt(max(low, LEAST_CARRIED**2) * high)


def _along(square: np.ndarray, rows: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Mean over many bins of the piece: where a reading jumps between two steps of the log, the noise is no larger than elsewhere."""
    smooth = square.copy()
    for one in np.unique(piece):
        bins = np.flatnonzero(piece == one)
        reach = min(ALONG_BINS, (len(bins) - 1) // 2)
        smooth[bins] = moving_mean(rows[bins] * square[bins], reach) / moving_mean(rows[bins].astype(float), reach)
    return smooth


def _ramp(value: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """How far the reading moves across each bin."""
    index = np.arange(len(piece))
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, len(piece) - 1)
    before = np.where(piece[before] == piece, before, index)
    after = np.where(piece[after] == piece, after, index)
    # Over one bin the steps of a rounded reading look like a ramp that is not there; over several bins less so.
    ramp = np.abs(value[after] - value[before]) / np.maximum(after - before, 1)
    for reach in (2, 4, 8):
        low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(piece) - 1)
        inside = (piece[low] == piece) & (piece[high] == piece)
        ramp = np.where(inside, np.minimum(ramp, np.abs(value[high] - value[low]) / np.maximum(high - low, 1)), ramp)
    return ramp


def _known_steps(y: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Rounding step per bin (the largest of its rows); a bin whose readings never change takes the distance to the next reading."""
    step = np.maximum.reduceat(local_steps(y), starts)
    constant = np.maximum.reduceat(y, starts) == np.minimum.reduceat(y, starts)
    if (constant & (step == 0)).any():
        distinct = np.unique(y)
        if len(distinct) > 1:
            gap = np.diff(distinct)
            nearest = np.minimum(np.append(np.inf, gap), np.append(gap, np.inf))
            step = np.where(constant & (step == 0), nearest[np.searchsorted(distinct, y[starts])], step)
    return step


def _sharing(y: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """How many neighbouring bins stand on the same reading, by their medians: they share its rounding error.

    Together they count for one reading known to step/sqrt(12). Where a curve passes through a level its error does
    change sign, but not evenly where the curve bends, and the fit's own directions pick up what is left.
    """
    level = np.array([np.median(part[: len(part) - 1 + len(part) % 2]) for part in np.split(y, starts[1:])])
    group = np.cumsum(np.append(False, level[1:] != level[:-1]))
    return np.bincount(group)[group].astype(float)
