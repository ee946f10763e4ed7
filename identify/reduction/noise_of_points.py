"""The standard error of the mean of a bin of log rows, from scatter, correlation, and rounding of reading and position. NumPy only."""

from dataclasses import dataclass

import numpy as np

from thermohyd.identify.bench.test_record import Channel

from .noise_of_logs import LogCorrelation, RowNoise
from .rounding import local_steps, rounding_error
from .third_differences import COARSE


FLICKERS = 0.6  # of a step: a noise as large rests on none, wherever between two of them the reading lies


@dataclass(frozen=True)
class Points:
    """The means of one reading over bins, with standard errors; one entry per bin (SI).

    value: mean of the bin's rows; std: standard error of it, without what the position's error makes; degrees_of_freedom: what that was
    estimated from (infinite: stated). step: rounding step of the log; correlation: of the log's rows; row_std: typical scatter of one
    row; floored: where the rounding counts for more than the noise; sharing: how many neighbouring bins stand on one rounded reading.
    """

    value: np.ndarray
    std: np.ndarray
    degrees_of_freedom: float
    step: np.ndarray
    correlation: LogCorrelation
    row_std: float
    floored: np.ndarray
    sharing: np.ndarray


def points_of(channel: Channel, starts: np.ndarray, pieces: np.ndarray, noise: RowNoise) -> Points:
    """Means and standard errors of a channel's readings over the bins of a log that begin at rows `starts`."""
    y, correlation = channel.value, noise.correlation
    rows = np.diff(np.append(starts, len(y)))
    mean = lambda values: np.add.reduceat(values, starts) / rows
    value, piece = mean(y), pieces[starts]
    step = _known_steps(channel.as_read, starts)
    ramp = _ramp(value, piece)
    before = np.sqrt(mean(noise.own))
    if noise.coarse is not None:
        # What readings scatter by elsewhere they need not where they rest on steps of their rounding that it would carry them over.
        before = np.where(before > FLICKERS * step, np.minimum(before, mean(noise.coarse)), before)
    coarse = before < COARSE * step  # the log shows its own rounding rather than the noise
    # What is declared is of one row.
    own = (
        before**2 * correlation.of_mean(rows)
        if channel.std is None
        else mean(channel.std**2) / correlation.effective_rows(rows)
    )
    own = own + step**2 / 12.0 / rows  # rounding of readings that scatter forgets from row to row
    sharing = np.where(coarse, _sharing(y, starts), 1.0)
    rounding = rounding_error(step, before, ramp) * np.sqrt(sharing)
    least = 1e-6 * max(float(np.ptp(y)), float(np.max(np.abs(y), initial=0.0)))
    total = own + rounding**2
    typical = before[~coarse]
    return Points(
        value=value,
        std=np.maximum(np.sqrt(total), least),
        degrees_of_freedom=noise.degrees_of_freedom,
        step=step,
        correlation=correlation,
        row_std=float(np.median(typical)) if len(typical) else 0.0,
        floored=coarse & (step > 0) & (step**2 / 12.0 > 0.1 * total),
        sharing=sharing,
    )


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
