"""Direction and rate of the sweep at each row, from the order of the rows within each run."""

import numpy as np


def sweep_direction(position: np.ndarray, run: np.ndarray) -> np.ndarray:
    """+1.0 or -1.0 per row: the sign of the last change of position within the run.

    A repeated position keeps the direction; the rows before the first change take the direction of that change. A run
    whose position never changes counts as upward.
    """
    direction = np.ones(len(position))
    for rows in _runs(run):
        signs = np.sign(np.diff(position[rows], prepend=position[rows[0]]))
        direction[rows] = _carried(signs, 1.0)
    return direction


def sweep_rate(position: np.ndarray, time: np.ndarray, run: np.ndarray) -> np.ndarray:
    """dx/dt of the step that led to each row [position unit per s]; a run's first row takes that of its second.

    Rows with the time of the row before keep that row's rate.
    """
    rate = np.zeros(len(position))
    for rows in _runs(run):
        dx = np.diff(position[rows], prepend=position[rows[0]])
        dt = np.diff(time[rows], prepend=time[rows[0]])
        slope = np.divide(dx, dt, out=np.zeros_like(dx), where=dt > 0.0)
        index = _last_true(dt > 0.0)
        rate[rows] = slope[index]
    return rate


def first_step_back(time: np.ndarray, run: np.ndarray) -> int | None:
    """Row number where time runs backwards within a run; None where it does not."""
    found = []
    for rows in _runs(run):
        back = np.flatnonzero(np.diff(time[rows]) < 0.0)
        if len(back):
            found.append(int(rows[back[0] + 1]))
    return min(found) if found else None


def _runs(run: np.ndarray) -> list[np.ndarray]:
    """Row numbers of each run, in order."""
    order = np.argsort(run, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(run[order])) + 1)


def _carried(signs: np.ndarray, default: float) -> np.ndarray:
    """Each entry, or the last one before it that is not zero; those before the first take the first."""
    if not signs.any():
        return np.full(len(signs), default)
    return signs[_last_true(signs != 0.0)]


def _last_true(mask: np.ndarray) -> np.ndarray:
    """For each entry the index of the last True up to it, or of the first True where there is none before."""
    index = np.maximum.accumulate(np.where(mask, np.arange(len(mask)), -1))
    return np.where(index < 0, int(np.argmax(mask)), index)
