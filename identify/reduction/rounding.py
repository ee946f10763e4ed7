"""Find the step to which a log rounded its readings, and how far a rounded reading may be believed. NumPy only.

A logger writes readings on a grid whose step may change with the range (four digits, say), and a later unit
conversion hides the decimals. The grid is therefore looked for in the values themselves: neighbouring distinct values
lie whole multiples of a step apart.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from thermohyd.identify.bench.test_record import Channel, TestRecord

from .monotone_pieces import piece_bounds, sweep_ids


Values = float | np.ndarray

FLICKERS = 0.1  # share of a position's moves that go back: more than bad rows and turning points make
LATTICE_TOLERANCE = 0.1  # of a step: files print converted values with few digits
# Of a rounding error's sawtooth, which fall as 1/k^2 in its power: the rest is 7 % of it, made up for below.
HARMONICS = np.arange(1, 9)


def local_steps(values: np.ndarray) -> np.ndarray:
    """Step of the grid on which each value was logged, same shape and unit as `values`; 0 where no grid shows.

    The step is local: it is found among the nearest distinct values, so that a log with a fine and a coarse range
    gets both.
    """
    values = np.asarray(values, float)
    distinct, index, counts = _distinct(values)
    if len(distinct) < 3:
        return np.full(values.shape, _few_values_step(distinct))
    gaps = np.diff(distinct)
    step = np.zeros(len(distinct))
    for width in (3, 8):
        if len(gaps) >= width:
            step = np.maximum(step, _windows(gaps, counts, width))
    # A value cannot be rounded more coarsely than the distance to a neighbour on both sides.
    left, right = np.append(np.inf, gaps), np.append(gaps, np.inf)
    inner = np.minimum(left, right)
    outer = np.where(np.isinf(np.maximum(left, right)), inner, np.maximum(left, right))
    allowed = np.where(counts >= 5, outer, inner) * (1 + LATTICE_TOLERANCE)
    step = np.where(step <= allowed, step, 0.0)
    return np.where(step > 0, step, _common_step(distinct, gaps))[index]


def column_step(values: np.ndarray) -> float:
    """One step for a whole column: the largest that all distances, or power of ten that all values, are multiples of; 0: none.

    Not a local one: where several sweeps repeat each other's rows, neighbouring values lie a row apart, not a step.
    """
    size = float(np.max(np.abs(values), initial=0.0))
    decimal = 0.0
    if size > 0.0:
        for step in 10.0 ** np.arange(np.floor(np.log10(size)), np.floor(np.log10(size)) - 7.0, -1.0):
            if np.all(np.abs(values / step - np.round(values / step)) < 1e-4):
                decimal = float(step)
                break
    distinct = _distinct(np.asarray(values, float))[0]
    return max(decimal, _common_step(distinct, np.diff(distinct)))


def rounding_error(step: Values, scatter: Values, span: Values) -> np.ndarray:
    """Standard deviation of the mean of many rounded readings that scatter (Gaussian, std) and ramp (over `span`) before rounding.

    step/sqrt(12) where the reading stands still; scatter or a ramp that crosses whole steps averages it away,
    harmonic by harmonic of the saw-tooth error (Widrow & Kollar, Quantization Noise, 2008, ch. 4). All in the
    reading's unit.
    """
    step, scatter, span = np.broadcast_arrays(*(np.asarray(a, float) for a in (step, scatter, span)))
    safe = np.where(step > 0, step, 1.0)
    k = HARMONICS.reshape(-1, *([1] * step.ndim))
    ramp = np.minimum(1.0, 1.0 / np.maximum(np.pi * k * np.abs(span) / safe, 1e-9) ** 2)
    dither = np.exp(-np.minimum(4 * np.pi**2 * k**2 * (scatter / safe) ** 2, 700.0))
    still = 1.0 / np.sum(1.0 / HARMONICS**2)  # so that a reading at rest gets step^2/12 exactly
    return np.where(step > 0, safe * np.sqrt(still / 12.0 * np.sum(dither * ramp / k**2, axis=0)), 0.0)


def scatter_before_rounding(scatter: Values, step: Values, span: Values) -> np.ndarray:
    """The standard deviation that readings had before rounding, from the scatter seen after it.

    Averaged over where the readings lie on the grid, seen^2 = before^2 + step^2/12 - rounding_error(before)^2.
    """
    trial = np.concatenate([[0.0], np.geomspace(0.01, 3.0, 60)]).reshape(-1, 1)  # in steps
    scatter, step, span = (np.atleast_1d(np.asarray(a, float)) for a in np.broadcast_arrays(scatter, step, span))
    safe = np.where(step > 0, step, 1.0)
    seen = trial**2 + 1 / 12 - rounding_error(np.ones_like(safe), trial, span / safe) ** 2
    target = (scatter / safe) ** 2
    best = trial[np.argmin(np.abs(seen - target), axis=0), 0] * safe
    large = np.sqrt(np.maximum(scatter**2 - step**2 / 12, 0.0))
    return np.where((step > 0) & (target < seen[-1]), best, np.where(step > 0, large, scatter))


def rounding_floor(test: TestRecord, channel: Channel) -> np.ndarray:
    """Least honest standard deviation of each row's reading (SI): steps of the reading and of the position / sqrt(12).

    The position's step counts with the local slope of the curve. For tests that are fitted row by row.
    """
    sweeps = sweep_ids(test)
    position_step = reading_steps(test.spool_position, sweeps)
    slope = local_slopes(test.spool_position, channel.value, sweeps) if position_step.any() else np.zeros(test.rows)
    return np.sqrt((local_steps(channel.value) ** 2 + (slope * position_step) ** 2) / 12.0)


def joined_steps(values: np.ndarray) -> np.ndarray:
    """Values that stand still between the steps of their rounding, joined up through the middles of their risers (rows,); before the
    first and behind the last one they stand still."""
    row = np.flatnonzero(np.diff(values))
    return np.interp(np.arange(len(values)), row + 0.5, 0.5 * (values[row] + values[row + 1]))


def reading_steps(position: np.ndarray, sweeps: np.ndarray) -> np.ndarray:
    """Rounding steps of positions that were read; 0 for set points and even sweeps, which lie on a grid of their own.

    The increments of rounded readings differ by single steps from row to row; those of a grid are equal or jump.
    """
    step = local_steps(position)
    within = (sweeps[2:] == sweeps[:-2]) & (step[1:-1] > 0)
    size = np.where(step > 0, step, 1.0)[1:-1]
    change = np.abs(np.diff(position, n=2))[within] / size[within]
    single = np.abs(change - 1.0) < LATTICE_TOLERANCE
    if len(single) and float(np.mean(single)) > 0.15:
        return step
    # Where it mostly stands still: it goes back and forth between two steps, as no set point does.
    move = np.diff(position)[sweeps[1:] == sweeps[:-1]]
    move = move[move != 0.0]
    return step if len(move) and float(np.mean(move[1:] * move[:-1] < 0.0)) > FLICKERS else np.zeros(len(position))


def _distinct(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sorted distinct values, index of each value among them, and how often each occurs; floating-point twins count as one."""
    distinct, index, counts = np.unique(values, return_inverse=True, return_counts=True)
    twin = np.diff(distinct, prepend=-np.inf) <= 1e-11 * np.max(np.abs(distinct), initial=0.0)
    group = np.cumsum(~twin) - 1
    return distinct[~twin], group[index.reshape(values.shape)], np.bincount(group, weights=counts)


def _few_values_step(distinct: np.ndarray) -> float:
    return float(distinct[1] - distinct[0]) if len(distinct) == 2 else 0.0


def _windows(gaps: np.ndarray, counts: np.ndarray, width: int) -> np.ndarray:
    """Largest step per distinct value among the windows of `width` gaps that end at it, hold it, or start at it."""
    window = sliding_window_view(gaps, width)
    smallest = window.min(axis=1)
    step = np.zeros(len(smallest))
    if width < 5:  # few gaps prove a grid only where they are equal and the values come again and again
        repeats = sliding_window_view(counts, width + 1).min(axis=1) >= 3
        step = np.where((window.max(axis=1) < 1.05 * smallest) & repeats, smallest, 0.0)
    else:
        for divisor in (3, 2, 1):
            ratio = window / (smallest / divisor)[:, None]
            on_grid = np.abs(ratio - np.round(ratio)).max(axis=1) < LATTICE_TOLERANCE
            step = np.where(on_grid, smallest / divisor, step)
    best = np.zeros(len(gaps) + 1)
    inner = np.minimum(np.append(np.inf, gaps), np.append(gaps, np.inf)) * (1 + LATTICE_TOLERANCE)
    for offset in range(width + 1):
        part = slice(offset, offset + len(step))
        ends = offset in (0, width)
        fits = step <= (np.inf if ends else inner[part])
        best[part] = np.maximum(best[part], np.where(fits, step, 0.0))
    return best


def _common_step(distinct: np.ndarray, gaps: np.ndarray) -> float:
    """One step for the whole column (decimals of the file's unit), or 0: every distance is a whole multiple of it."""
    if len(gaps) < 8:
        return 0.0
    smallest = gaps.min()
    span = distinct[-1] - distinct[0]
    resolution = 4 * np.finfo(float).eps * np.max(np.abs(distinct)) / smallest
    offsets = distinct - distinct[0]
    for divisor in range(1, 13):
        step = smallest / divisor
        # The step from the smallest gap is inexact; the farthest value refines it.
        step = span / max(round(span / step), 1)
        ratio = offsets / step
        if np.abs(ratio - np.round(ratio)).max() < max(0.02, divisor * resolution) and divisor * resolution < 0.1:
            return float(step)
    return 0.0


def local_slopes(position: np.ndarray, value: np.ndarray, sweeps: np.ndarray) -> np.ndarray:
    """Slope of the curve at every row from its neighbours two rows away within the sweep."""
    slope = np.zeros(len(position))
    for start, stop in piece_bounds(sweeps):
        x, y = position[start:stop], value[start:stop]
        before = np.maximum(np.arange(len(x)) - 2, 0)
        after = np.minimum(np.arange(len(x)) + 2, len(x) - 1)
        run = x[after] - x[before]
        slope[start:stop] = np.where(run != 0, (y[after] - y[before]) / np.where(run != 0, run, 1.0), 0.0)
    return slope
