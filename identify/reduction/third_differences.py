"""Stretches of a raw log's rows by their third differences, which are blind to any parabola. NumPy only.

Neither slope nor bend of the curve counts as noise; third differences of noise alternate in sign, those of a curve do not.
"""

from dataclasses import dataclass, replace

import numpy as np

from .monotone_pieces import moving_mean, piece_bounds
from .rounding import scatter_before_rounding


STRETCH = 48  # third differences that are judged together
# Share of neighbouring third differences of opposite sign, 0.77 in white noise and less in one with a memory; of such as differ at all.
ALTERNATES, MOVES = 0.62, 0.1
STEPS_AROUND = 6  # stretches on either side, whose readings lie anywhere between two steps
COARSE = 0.3  # of a step: readings that scatter by less show their rounding rather than their noise
AT_ONCE = 100  # stretches: what is tried for each takes 4 kB
ENOUGH = 20  # stretches that are worth more than all of them


@dataclass(frozen=True)
class Stretches:
    """Of stretches of rows: mean square of third differences / 20, whether they move at all and alternate, first and last row, piece."""

    square: np.ndarray
    moves: np.ndarray
    alternates: np.ndarray
    first: np.ndarray
    last: np.ndarray
    piece: np.ndarray

    def mean(self, values: np.ndarray) -> np.ndarray:
        sums = np.concatenate([[0.0], np.cumsum(values)])
        return (sums[self.last + 1] - sums[self.first]) / (self.last + 1 - self.first)

    def only(self, kept: np.ndarray) -> "Stretches":
        return Stretches(*(getattr(self, n)[kept] for n in ("square", "moves", "alternates", "first", "last", "piece")))

    @property
    def clear(self) -> float:
        """Share that shows noise alone, of those that move: readings that rest on a step of their rounding say nothing."""
        return float(np.mean(self.alternates[self.moves])) if self.moves.any() else 0.0

    def without_bends(self) -> "Stretches":
        return self.only(self.alternates | ~self.moves)


def stretches_of(value: np.ndarray, pieces: np.ndarray, lag: int) -> Stretches:
    """Stretches of rows and their third differences between rows `lag` apart."""
    square, moves, alternates, first, piece = [], [], [], [], []
    for start, stop in piece_bounds(pieces):
        y = value[start:stop]
        if stop - start < STRETCH + 4 * lag:
            continue
        third = y[: -3 * lag] - 3.0 * y[lag : -2 * lag] + 3.0 * y[2 * lag : -lag] - y[3 * lag :]
        turns = np.sign(third[lag:] * third[:-lag])
        count = len(turns) // STRETCH
        cut = lambda values, count=count: values[: count * STRETCH].reshape(count, STRETCH).mean(axis=1)
        square.append(cut(third**2 / 20.0))
        moves.append(cut(turns != 0.0) > MOVES)
        alternates.append(cut(turns < 0.0) > ALTERNATES * cut(turns != 0.0))
        first.append(start + STRETCH * np.arange(count))
        piece.append(np.full(count, pieces[start]))
    if not square:
        none = np.zeros(0, dtype=int)
        return Stretches(np.zeros(0), none.astype(bool), none.astype(bool), none, none, none)
    square, moves, alternates, first, piece = (
        np.concatenate(each) for each in (square, moves, alternates, first, piece)
    )
    return Stretches(square, moves, alternates, first, first + STRETCH + 3 * lag - 1, piece)


def before_rounding(stretches: Stretches, step: np.ndarray) -> Stretches:
    """The stretches with the squares that readings had before they were rounded; where enough are left, without those that show their
    rounding alone."""
    if not step.any():
        return stretches
    around, before = _before(stretches, step)
    share = np.divide(before**2, around, out=np.ones(len(around)), where=around > 0.0)
    stretches, fine = replace(stretches, square=stretches.square * share), before >= COARSE * stretches.mean(step)
    return stretches.only(fine) if np.sum(fine) >= ENOUGH else stretches


def coarse_scatter(value: np.ndarray, pieces: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Standard deviation (rows,) that readings had before they were rounded, where they show little but their rounding; else infinite."""
    found = np.full(len(value), np.inf)
    stretches = stretches_of(value, pieces, 1)
    if not len(stretches.square):
        return found
    _, before = _before(stretches, step)
    before[before >= COARSE * stretches.mean(step)] = np.inf
    for start, stop in piece_bounds(pieces):
        inside = np.flatnonzero(stretches.piece == pieces[start])
        if len(inside):
            nearest = np.searchsorted(stretches.first[inside], np.arange(start, stop), "right") - 1
            found[start:stop] = before[inside[np.maximum(nearest, 0)]]
    return found


def _before(stretches: Stretches, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean square of the stretches around each (stretches,), and the standard deviation before rounding behind it.

    Rows near each other share what rounding does to all of them, so that third differences do not show it; stretches differ by where
    between two steps they lie.
    """
    steps, around = stretches.mean(step), np.maximum(moving_mean(stretches.square, STEPS_AROUND), 0.0)
    blocks = np.array_split(np.arange(len(around)), len(around) // AT_ONCE + 1)
    return around, np.concatenate([scatter_before_rounding(np.sqrt(around[part]), steps[part], 0.0) for part in blocks])


def median_of_mean(degrees_of_freedom: float) -> float:
    """Median of chi-square over its degrees of freedom (Wilson and Hilferty, PNAS 17, 1931)."""
    return (1.0 - 2.0 / (9.0 * degrees_of_freedom)) ** 3
