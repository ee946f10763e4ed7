"""What a step response is judged by: rise, settling, overshoot. Plain NumPy on readings."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Real


BAND = 0.02  # of the step: settled within it
STAYS = 0.9  # of the run: what is not settled by then may only be passing through the band


class StepFigures(NamedTuple):
    """rise_time: from 10 to 90 % of the step [s]; time_to_90 [s] and settling_time [s], to stay within 2 %, from its start.

    overshoot: beyond the step, as a share of it. swing: from lowest to highest in the last tenth of the run, as a share of the
    step: how much it still moves. NaN for what the run does not reach. Shape (), or that of several runs.
    """

    rise_time: np.ndarray
    time_to_90: np.ndarray
    settling_time: np.ndarray
    overshoot: np.ndarray
    swing: np.ndarray


def step_figures(time: Real[np.ndarray, " rows"], position: Real[np.ndarray, " rows"], step: float) -> StepFigures:
    """Figures of a response that leaves `position[0]` at `time[0]`, when a setpoint step of this size begins; SI units.

    The step counts from where the piston stood: a steady load moves it before and after alike. Between rows, lines.

    >>> time = np.linspace(0.0, 10.0, 10_001)
    >>> [round(float(figure), 3) for figure in step_figures(time, 2.0 - 2.0 * np.exp(-time), 2.0)]
    [2.197, 2.303, 3.912, 0.0, 0.0]
    """
    time, share = np.asarray(time, dtype=float), (np.asarray(position, dtype=float) - position[0]) / step
    began = time - time[0]
    first, last = _first_above(began, share, 0.1), _first_above(began, share, 0.9)
    overshoot = max(float(np.max(share)) - 1.0, 0.0)
    swing = float(np.ptp(share[began > STAYS * began[-1]]))
    figures = (last - first, last, _settled(began, share), overshoot, swing)
    return StepFigures(*(np.asarray(figure) for figure in figures))


def _first_above(time: np.ndarray, share: np.ndarray, level: float) -> float:
    above = np.flatnonzero(share >= level)
    if above.size == 0 or above[0] == 0:
        return float("nan")
    return _between(time, share, int(above[0]), level)


def _settled(time: np.ndarray, share: np.ndarray) -> float:
    """When the share last enters the band around 1."""
    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    if outside.size == 0 or time[outside[-1]] > STAYS * time[-1]:
        return float("nan")
    row = int(outside[-1]) + 1
    return _between(time, share, row, 1.0 + BAND * float(np.sign(share[row - 1] - 1.0)))


def _between(time: np.ndarray, share: np.ndarray, row: int, level: float) -> float:
    """When the line from the row before reaches the level."""
    part = (level - share[row - 1]) / (share[row] - share[row - 1])
    return float(time[row - 1] + part * (time[row] - time[row - 1]))
