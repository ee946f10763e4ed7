"""Where was the spool when the log wrote a rounded, dithered position? A smooth sweep, read off the rows around. Plain NumPy."""

from dataclasses import dataclass

import numpy as np

from .legs import piece_bounds
from .noise import effective_size
from .rounding import local_steps, rounding_error


STEPS_ACROSS = 3.0  # a window over this many steps of the log averages its rounding away


@dataclass(frozen=True)
class Abscissa:
    """The sweep's position behind a log, one entry per row (SI).

    position: smoothed; scatter: of one row about it, for the mean of n rows to be divided by sqrt(n) although the
    smoothing averages over more, because neighbouring bins then share an error; rounding: what dither and sweep leave
    of the log's rounding.
    staircase: True in legs whose position stands still between steps, so that bins had better end with a step.
    """

    position: np.ndarray
    scatter: np.ndarray
    rounding: np.ndarray
    staircase: np.ndarray
    step: np.ndarray


def smooth_abscissa(position: np.ndarray, legs: np.ndarray) -> Abscissa:
    """Local straight lines through the logged position of each leg, over as many rows as its rounding and dither ask for."""
    step = local_steps(position)
    smooth, staircase = position.copy(), np.zeros(len(position), bool)
    spread, rounding = np.zeros(len(position)), np.zeros(len(position))
    for start, stop in piece_bounds(legs):
        part = slice(start, stop)
        x = position[part]
        if stop - start < 8 or np.ptp(x) == 0:
            continue
        if _is_staircase(x):
            staircase[part] = True
            continue
        half = _half_window(x, float(step[part].max()))
        if half == 0:
            continue
        line, slope = local_line(x, half)
        scatter = float(np.sqrt(np.mean((x - line) ** 2)))
        covered = np.abs(slope) * (2 * half + 1)
        smooth[part] = line
        correlated = float(np.clip((stop - start) / effective_size(x - line), 1.0, 5.0))
        spread[part] = scatter * np.sqrt(correlated)
        rounding[part] = rounding_error(step[part], scatter, covered)
    return Abscissa(smooth, spread, rounding, staircase, step)


def local_line(values: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
    """Value and slope per row of straight lines fitted over `half` rows on either side (one-sided at the ends)."""
    n = len(values)
    row = np.arange(n)
    low, high = np.maximum(row - half, 0), np.minimum(row + half, n - 1) + 1
    t = row - n / 2.0
    y = values - values.mean()
    sums = [np.concatenate([[0.0], np.cumsum(a)]) for a in (t, t * t, y, t * y)]
    st, stt, sy, sty = (s[high] - s[low] for s in sums)
    count = high - low
    spread = stt - st**2 / count
    slope = np.where(spread > 0, (sty - st * sy / count) / np.where(spread > 0, spread, 1.0), 0.0)
    return values.mean() + sy / count + slope * (t - st / count), slope


def _is_staircase(x: np.ndarray) -> bool:
    """Steps in one direction only, with rests between them: no dither, and nothing to be learned between the steps."""
    change = np.diff(x)
    moves = change[change != 0]
    forward = max(np.mean(moves > 0), np.mean(moves < 0)) if len(moves) else 0.0
    return bool(0 < len(moves) < 0.2 * len(change) and forward > 0.97)


def _half_window(x: np.ndarray, step: float) -> int:
    """Rows on either side that cross enough rounding steps, halved until the sweep is straight enough over them."""
    n = len(x)
    pace = abs(float(x[-1] - x[0])) / n
    fine, _ = local_line(x, 2)
    dither = float(np.sqrt(np.mean((x - fine) ** 2) * 5.0 / 3.0))
    if dither == 0.0 and step == 0.0:
        return 0
    wanted = STEPS_ACROSS * step / (2.0 * pace) if pace > 0 else 0.0
    half = int(np.clip(max(wanted, 10.0 if dither > 0.5 * pace else 0.0), 0, n // 20))
    allowed = 1.5 * max(dither, step / np.sqrt(12.0))
    while half > 0:
        line, _ = local_line(x, half)
        if np.sqrt(np.mean((x - line) ** 2)) <= allowed:
            return half
        half //= 2
    return 0
