"""Which rows of a raw log go into one point? Narrow bins where the curve is steep or bends, wide ones where it rests. Plain NumPy."""

import numpy as np

from .abscissa import Abscissa
from .legs import piece_bounds


CELLS = 400  # per leg: the resolution at which the curve's shape is judged
SMALLEST_BIN = 2  # rows; their mean of the model is then exact
BENT = 10.0  # scatters of a row by which a reading may bend over one row squared, where a bin of one row is wanted
FEW_BINS, FEWEST_BINS = 8, 60  # per leg, where there are many legs and where there are few
SHARES = {
    "width": 0.35,
    "rise": 0.30,
    "bend": 0.35,
}  # of the points: even along the sweep, along the reading, at its bends


def bin_starts(
    abscissa: Abscissa,
    readings: list[np.ndarray],
    legs: np.ndarray,
    max_points: int,
    smallest: float = SMALLEST_BIN,
    scatter: list[float] | None = None,
) -> np.ndarray:
    """First row of every bin, ascending, so that about `max_points` bins cover the log and none crosses a leg's end.

    smallest: rows of a bin, at least: some times what the noise remembers, so that points are independent readings; but for
    narrower ones where a reading bends by more than its `scatter` (of a row, as if independent; one per reading).

    Bins hold equal parts of a density that grows with the sweep, the rise of the readings and, as the 2/5th power, their
    curvature. How they are cut biases nothing, as means of readings are compared with means of the model: they are
    narrow where the curve tells something.
    """
    rows = len(legs)
    width = np.abs(_steps(abscissa.position, legs))
    rise, bend, needed = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    for reading, own in zip(readings, scatter or [np.inf] * len(readings), strict=True):
        slope, curvature = _shape(reading, legs)
        needed = np.maximum(needed, (np.abs(curvature) / (BENT * max(own, 1e-300))) ** 0.4)
        rise += _share(np.abs(slope))
        bend += _share(np.abs(curvature) ** 0.4)
    parts = {"width": _share(width), "rise": _share(rise), "bend": _share(bend)}
    density = np.full(rows, 0.02 / rows)
    for name, part in parts.items():
        density += SHARES[name] * part
    density *= max_points / density.sum()
    fewest = float(np.clip(0.5 * max_points / len(np.unique(legs)), FEW_BINS, FEWEST_BINS))
    starts: list[np.ndarray] = []
    for start, stop in piece_bounds(legs):
        stairs = abscissa.position[start:stop] if abscissa.staircase[start] else None
        most = np.maximum(needed[start:stop], max(1.0 / smallest, fewest / (stop - start)))
        starts.append(start + _cut(density[start:stop], fewest, np.minimum(most, 1.0 / SMALLEST_BIN), stairs))
    return np.concatenate(starts)


def _cut(density: np.ndarray, fewest: float, most: np.ndarray, stairs: np.ndarray | None) -> np.ndarray:
    """Starts of the bins of one leg: equal parts of the density, nowhere denser than `most`, on the steps of a staircase."""
    bins = max(1, round(min(max(float(density.sum()), fewest), float(most.sum()))))
    for _ in range(20):  # what the cap takes goes to the rest
        density = density * (bins / density.sum())
        if np.all(density <= 1.001 * most):
            break
        density = np.minimum(density, most)
    edge = np.searchsorted(np.cumsum(density) * (bins / density.sum()), np.arange(1, bins) - 1e-9)
    starts = np.unique(np.append(0, edge))
    if stairs is not None:
        treads = np.append(0, 1 + np.flatnonzero(np.diff(stairs)))
        starts = np.unique(treads[np.searchsorted(treads, starts, side="right") - 1])
    return starts


def _shape(reading: np.ndarray, legs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope and curvature per row of the smoothed reading, leg by leg."""
    slope, curvature = np.zeros(len(reading)), np.zeros(len(reading))
    for start, stop in piece_bounds(legs):
        n = stop - start
        size = max(1, n // CELLS)
        count = n // size
        if count < 20:
            slope[start:stop] = (reading[stop - 1] - reading[start]) / n
            continue
        level = _unstepped(reading[start:stop])
        cells = level[: count * size].reshape(count, size).mean(axis=1)
        _, first, second = local_parabola(cells, _best_half(cells))
        cell = np.minimum(np.arange(n) // size, count - 1)
        slope[start:stop], curvature[start:stop] = first[cell] / size, second[cell] / size**2
    return slope, curvature


def _unstepped(reading: np.ndarray) -> np.ndarray:
    """A reading that stands still between the steps of its rounding, joined up through the middles of its steps."""
    row = 1 + np.flatnonzero(np.diff(reading))
    if len(row) < 2 or len(row) > 0.5 * len(reading):
        return reading
    return np.interp(np.arange(len(reading)), row - 0.5, 0.5 * (reading[row] + reading[row - 1]))


def local_parabola(values: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, first and second derivative per entry of parabolas over `half` entries on either side (one-sided at the ends)."""
    t = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv(np.stack([np.ones_like(t), t, t**2], axis=1))
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * half + 1)
    a, b, c = fit @ windows.T
    row = np.arange(len(values))
    at = np.clip(row, half, len(values) - 1 - half)
    off = row - at
    a, b, c = a[at - half], b[at - half], c[at - half]
    return a + b * off + c * off**2, b + 2 * c * off, 2 * c


def _best_half(cells: np.ndarray) -> int:
    """Half window whose parabolas predict left-out cells best."""
    best, least = 2, np.inf
    for half in (2, 3, 5, 8, 12, 20):
        if 2 * half + 1 > len(cells) // 3:
            break
        value, _, _ = local_parabola(cells, half)
        t = np.arange(-half, half + 1.0)
        own = np.linalg.pinv(np.stack([np.ones_like(t), t, t**2], axis=1))[0, half]
        inside = slice(half, len(cells) - half)
        error = float(np.mean(((cells - value)[inside] / (1.0 - own)) ** 2))
        if error < least:
            best, least = half, error
    return best


def _steps(values: np.ndarray, legs: np.ndarray) -> np.ndarray:
    change = np.diff(values, prepend=values[0])
    change[np.append(False, legs[1:] != legs[:-1])] = 0.0
    return change


def _share(density: np.ndarray) -> np.ndarray:
    total = float(density.sum())
    return density / total if total > 0 else np.zeros_like(density)
