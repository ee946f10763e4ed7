"""Bins of a log end where its curve has a corner: an edge that closes within one is no cubic, and two nodes miss its mean. NumPy only.

A corner is looked for as what it is, a change of slope between two rows: beside a cubic over the bin and what lies around it, which a
mean over two nodes follows whatever its coefficients. Where it would shift the bin's mean against its nodes the bin is cut there, and
both parts are smooth. How a log is cut biases nothing, so that a cut in the wrong place costs a point and no more.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .monotone_pieces import piece_bounds
from .nodes import nodes_of


# Rows looked at on either side of a bin, in its own rows: narrow for two corners close together, wide for weak ones; at least so many.
WINDOWS, FEWEST_AROUND = (0.5, 1.5), 8
FEWEST_ROWS = 3  # of a bin that is cut: of two rows the mean over two nodes is exact
DEGREE = 3  # of the curve beside the corner: what two nodes integrate exactly
MISSED = 0.2  # standard errors of a point by which two nodes may miss its mean
# Chi-square of a change of slope from which on it is one; cuts of other sweeps that make one of their own unnecessary.
SURE, ELSEWHERE = 12.0, 2
PLACES = 24  # between rows of a bin, at most, that are asked; what is left of it is asked again
AT_ONCE = 250_000  # numbers
SAME = 4.0  # a place that is worse by so much may still be that of the corner
ROUNDS = 3  # a cut leaves two bins, whose windows are narrower
MOST_MORE = 0.25  # points, as a share of those there are


@dataclass(frozen=True)
class _Sweeps:
    """A log's rows: their place along the sweep, readings, noise of one row of each reading (rows,), and bounds of its piece."""

    position: np.ndarray
    readings: list[np.ndarray]
    row_std: list[np.ndarray]
    begin: np.ndarray
    end: np.ndarray


def ending_at_corners(
    starts: np.ndarray, pieces: np.ndarray, position: np.ndarray, readings: list[np.ndarray], std: list[np.ndarray]
) -> np.ndarray:
    """First rows of the bins (ascending), cut where readings turn a corner; std: of the mean of each reading over each bin."""
    bounds = list(piece_bounds(pieces))
    lengths = [stop - start for start, stop in bounds]
    begin, end = (np.repeat(np.array(each), lengths) for each in zip(*bounds, strict=True))
    rows = np.diff(np.append(starts, len(pieces)))
    moves = [(y, np.repeat(s * np.sqrt(rows), rows)) for y, s in zip(readings, std, strict=True) if np.ptp(y) > 0]
    sweeps = _Sweeps(position, [y for y, _ in moves], [s for _, s in moves], begin, end)
    most = len(starts) + int(MOST_MORE * len(starts))
    cut = _cut(starts, sweeps, most)
    return _cut_as_elsewhere(cut, np.setdiff1d(cut, starts), sweeps, most)


def _cut_as_elsewhere(starts: np.ndarray, seen: np.ndarray, sweeps: _Sweeps, most: int) -> np.ndarray:
    """The bins with those cut, too, in which several cuts of other sweeps, `seen` there (first rows behind them), stand.

    At the first and at the last of these places, and two rows beside them: of two rows the mean over two nodes is exact. Two corners
    within one bin hide each other.
    """
    position = sweeps.position
    places = np.sort(0.5 * (position[seen - 1] + position[seen]))
    stops = np.append(starts[1:], len(position))
    low, high = np.sort(np.stack([position[starts], position[stops - 1]]), axis=0)
    first, behind = np.searchsorted(places, low, "right"), np.searchsorted(places, high, "left")
    new = []
    for i in np.flatnonzero((behind - first >= ELSEWHERE) & (stops - starts >= FEWEST_ROWS)):
        rows = np.arange(starts[i] + 1, stops[i])
        between = 0.5 * (position[rows - 1] + position[rows])
        at = [int(np.argmin(np.abs(between - places[k]))) for k in (first[i], behind[i] - 1)]
        new += [int(rows[k + beside]) for k in at for beside in (0, -2, 2) if 0 <= k + beside < len(rows)]
    return np.union1d(starts, np.array(new[: most - len(starts)], dtype=int))


def _cut(starts: np.ndarray, sweeps: _Sweeps, most: int) -> np.ndarray:
    """Bins cut at their corners, the worst first, up to so many bins; then the parts of these."""
    asked = np.ones(len(starts), dtype=bool)
    for _ in range(ROUNDS):
        missed, at = _corners(starts, asked, sweeps)
        worst = np.argsort(-missed, kind="stable")[: most - len(starts)]
        new = at[worst[missed[worst] > MISSED]]
        if len(new) == 0:
            break
        starts = np.union1d(starts, new)
        asked = np.isin(starts, new)
        asked[:-1] |= asked[1:]
    return starts


def _corners(starts: np.ndarray, asked: np.ndarray, sweeps: _Sweeps) -> tuple[np.ndarray, np.ndarray]:
    """For every bin (bins,) by how much two nodes miss its mean for a corner in it, in standard errors, and the first row behind that.

    0 where there is none.
    """
    stops = np.append(starts[1:], len(sweeps.position))
    rows = stops - starts
    missed, best, at = np.zeros(len(starts)), np.zeros(len(starts)), starts.copy()
    # Not at a sweep's ends, where a row may belong to the other direction.
    between = (starts > sweeps.begin[starts]) & (stops < sweeps.end[starts])
    bins = np.flatnonzero(asked & between & (rows >= FEWEST_ROWS))
    for share in WINDOWS:
        around = np.maximum((share * rows[bins]).astype(int), FEWEST_AROUND)
        before = np.minimum(around, starts[bins] - sweeps.begin[starts[bins]])
        behind = np.minimum(around, sweeps.end[starts[bins]] - stops[bins])
        for own, (count, ahead, after) in _alike(np.stack([rows[bins], before, behind])):
            alike = bins[own]
            window = starts[alike, None] - ahead + np.arange(ahead + count + after)
            bends = _Bends.of(sweeps.position[window], ahead, count)
            for reading, std in zip(sweeps.readings, sweeps.row_std, strict=True):
                gain, error, gap = bends.strongest(reading[window], std[starts[alike]])
                better = (gain > np.maximum(best[alike], SURE)) & (error > MISSED)
                chosen = alike[better]
                best[chosen], missed[chosen], at[chosen] = gain[better], error[better], starts[chosen] + gap[better] + 1
    return missed, at


def _alike(shapes: np.ndarray) -> Iterator[tuple[np.ndarray, list[int]]]:
    """(bins, their shape) of bins of one shape (rows, rows before, rows behind), as many as are handled at once."""
    distinct, own = np.unique(shapes, axis=1, return_inverse=True)
    for number, shape in enumerate(distinct.T.tolist()):
        if sum(shape) > DEGREE + 2:
            every = np.flatnonzero(own.ravel() == number)
            for part in np.array_split(every, -(-len(every) * sum(shape) * PLACES // AT_ONCE)):
                yield part, shape


@dataclass(frozen=True)
class _Bends:
    """Changes of slope by one between two rows of bins of the same size and surroundings, beside a cubic.

    gaps (gaps,): the bin's row before each; apart (bins, rows, gaps): what a cubic over the window leaves of them; norm (bins, gaps): sum
    of its squares, 0 where no row lies apart; off (bins, gaps): the bin's mean over two nodes less that over its rows.
    """

    gaps: np.ndarray
    apart: np.ndarray
    norm: np.ndarray
    off: np.ndarray
    rows: int

    @classmethod
    def of(cls, position: np.ndarray, ahead: int, count: int) -> "_Bends":
        """position (bins, rows of the window), the bin's own from `ahead` on."""
        x = position - position[:, ahead : ahead + count].mean(axis=1, keepdims=True)
        x /= np.maximum(np.max(np.abs(x), axis=1, keepdims=True), 1e-300)
        inside = x[:, ahead : ahead + count]
        gaps = np.linspace(0, count - 2, min(count - 1, PLACES)).round().astype(int)
        place = 0.5 * (inside[:, gaps] + inside[:, gaps + 1])
        bend = lambda at: np.maximum(at[:, :, None] - place[:, None, :], 0.0)
        whole = bend(x)
        smooth = np.linalg.qr(x[:, :, None] ** np.arange(DEGREE + 1))[0]
        apart = whole - smooth @ (smooth.transpose(0, 2, 1) @ whole)
        norm = np.sum(apart**2, axis=1)
        norm[(inside[:, gaps] == inside[:, gaps + 1]) | (norm < 1e-9)] = 0.0
        nodes = nodes_of(inside.ravel(), None, np.arange(0, inside.size, count), "spool_position")
        off = np.sum(bend(nodes.offset) * nodes.weight[:, :, None], axis=1) - bend(inside).mean(axis=1)
        return cls(gaps, apart, norm, off, count)

    def strongest(self, reading: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(chi-square, error of two nodes in standard errors of the mean, bin's row before it) of each bin's clearest change of slope."""
        along = np.einsum("brg,br->bg", self.apart, reading)
        there = self.norm > 0.0
        slope = np.where(there, along / np.where(there, self.norm, 1.0), 0.0)
        gain = slope * along / std[:, None] ** 2
        error = np.abs(slope * self.off) * np.sqrt(self.rows) / std[:, None]
        each, clearest = np.arange(len(gain)), gain.argmax(axis=1)
        most = gain[each, clearest]
        likely = np.where(gain > most[:, None] - SAME, error, 0.0)
        return most, likely.max(axis=1), self.gaps[clearest]
