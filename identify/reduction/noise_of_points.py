"""The standard error of the mean of a bin of log rows, from scatter, correlation, and rounding of reading and position. NumPy only."""

from dataclasses import dataclass

import numpy as np

from thermohyd.identify.bench.test_record import Channel

from .monotone_pieces import moving_mean
from .noise_of_logs import LogCorrelation, independent_rows, log_correlation, log_scatter, row_scatter
from .rounding import local_steps, rounding_error, scatter_before_rounding
from .sweep_position import Abscissa


ALONG_BINS = 12  # on either side: scatter changes along a sweep slowly, and 25 bins know it to some per cent
POOLED_BINS = 4  # on either side, for bins with few rows
POOLED_ROWS = 40.0  # a bin of so many rows stands half for itself, half for its neighbours


@dataclass(frozen=True)
class Points:
    """The means of one reading over bins, with standard errors; one entry per bin (SI).

    value: mean of the bin's rows; std: standard error of it; degrees_of_freedom: what that was estimated from (infinite: stated).
    step: rounding step of the log; correlation: of the log's rows; row_std: typical scatter of one row; floored:
    where the rounding counts for more than the noise; sharing: how many neighbouring bins stand on one rounded reading.
    """

    value: np.ndarray
    std: np.ndarray
    degrees_of_freedom: float
    step: np.ndarray
    correlation: LogCorrelation
    row_std: float
    floored: np.ndarray
    sharing: np.ndarray


def points_of(channel: Channel, starts: np.ndarray, pieces: np.ndarray, abscissa: Abscissa) -> Points:
    """Means and standard errors of a channel's readings over the bins of a log that begin at rows `starts`."""
    y = channel.value
    rows = np.diff(np.append(starts, len(y)))
    mean = lambda values: np.add.reduceat(values, starts) / rows
    value, position, piece = mean(y), mean(abscissa.position), pieces[starts]
    step = _known_steps(y, starts)
    ramp, slope = _slopes(value, position, piece)
    bin_rows = int(np.median(rows))
    scatter = row_scatter(y, pieces)
    independent = independent_rows(y, pieces, scatter, 2 * bin_rows)
    if independent:
        seen = np.sqrt(mean(scatter.variance))
    else:
        lag = int(np.clip(np.quantile(rows, 0.1) // 3, 1, 10))
        seen = np.sqrt(_pooled(mean(log_scatter(y, pieces, lag)), rows, piece))
    before = scatter_before_rounding(np.sqrt(np.maximum(_along(seen**2, rows, piece), 0.0)), step, ramp)
    coarse = before < 0.3 * step  # the log shows its own rounding rather than the noise
    local = np.repeat(np.where(coarse, 0.0, seen**2), rows)
    correlation = LogCorrelation() if independent else log_correlation(y, local, pieces, bin_rows)
    square = np.maximum(seen, before) ** 2 * correlation.of_mean(rows)
    if channel.std is not None:  # declared for one row
        square = mean(channel.std**2) / correlation.effective_rows(rows)
    sharing = np.where(coarse, _sharing(y, starts), 1.0)
    rounding = rounding_error(step, before, ramp) * np.sqrt(sharing)
    square_x = slope**2 * (mean(abscissa.scatter**2) / rows + mean(abscissa.rounding**2))
    least = 1e-6 * max(float(np.ptp(y)), float(np.max(np.abs(y), initial=0.0)))
    total = square + rounding**2 + square_x
    typical = seen[~coarse] * np.sqrt(correlation.row_variance)
    return Points(
        value=value,
        std=np.maximum(np.sqrt(total), least),
        degrees_of_freedom=np.inf if channel.std is not None else scatter.degrees_of_freedom,
        step=step,
        correlation=correlation,
        row_std=float(np.median(typical)) if len(typical) else 0.0,
        floored=coarse & (step > 0) & (step**2 / 12.0 > 0.1 * total),
        sharing=sharing,
    )


def _pooled(scatter: np.ndarray, rows: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Scatter of each bin, leaning on the median of its neighbours where it has few rows."""
    neighbours = np.empty_like(scatter)
    for one in np.unique(piece):
        bins = np.flatnonzero(piece == one)
        reach = min(POOLED_BINS, (len(bins) - 1) // 2)
        padded = np.pad(scatter[bins], reach, mode="reflect") if reach else scatter[bins]
        neighbours[bins] = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1), axis=1)
    return (rows * scatter + POOLED_ROWS * neighbours) / (rows + POOLED_ROWS)


def _along(square: np.ndarray, rows: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """Mean over many bins of the piece: where a reading jumps between two steps of the log, the noise is no larger than elsewhere."""
    smooth = square.copy()
    for one in np.unique(piece):
        bins = np.flatnonzero(piece == one)
        reach = min(ALONG_BINS, (len(bins) - 1) // 2)
        smooth[bins] = moving_mean(rows[bins] * square[bins], reach) / moving_mean(rows[bins].astype(float), reach)
    return smooth


def _slopes(value: np.ndarray, position: np.ndarray, piece: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the reading moves across each bin, and its slope along the position."""
    before = np.maximum(np.arange(len(piece)) - 1, 0)
    after = np.minimum(np.arange(len(piece)) + 1, len(piece) - 1)
    before = np.where(piece[before] == piece, before, np.arange(len(piece)))
    after = np.where(piece[after] == piece, after, np.arange(len(piece)))
    rise, run = value[after] - value[before], position[after] - position[before]
    # Over one bin the steps of a rounded reading look like a ramp that is not there; over several bins less so.
    ramp = np.abs(rise) / np.maximum(after - before, 1)
    index = np.arange(len(piece))
    for reach in (2, 4, 8):
        low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(piece) - 1)
        inside = (piece[low] == piece) & (piece[high] == piece)
        ramp = np.where(inside, np.minimum(ramp, np.abs(value[high] - value[low]) / np.maximum(high - low, 1)), ramp)
    return ramp, np.where(run != 0, rise / np.where(run != 0, run, 1.0), 0.0)


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
