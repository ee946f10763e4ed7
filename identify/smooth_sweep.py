"""Where was the spool, how fast and which way, at each row of a raw log? The smooth sweep behind dither and rounding. Plain NumPy.

A fit sees a log through bins of this sweep (`reduction`); a prediction row by row needs the sweep itself: from one dithered
row to the next the position steps back and forth, and effects of direction and rate would follow every step.
"""

from dataclasses import replace

import numpy as np

from .abscissa import STEPS_ACROSS, local_line, smooth_abscissa
from .legs import log_legs, piece_bounds, sweep_axis
from .record import DynamicTest, TestRecord
from .reduction import is_raw_log


SHARE_OF_LEG = 100  # rates are slopes over twice this share of a leg's rows, about as wide as a fit's bins


def smooth_sweep(test: TestRecord) -> TestRecord:
    """The test with position, direction and rate [m/s] of the smooth sweep where it is a raw log; else as it is (SI).

    A held position (load_flow with a load that sweeps) stays as logged; its load pressure is smoothed instead.
    """
    if isinstance(test, DynamicTest) or not is_raw_log(test):
        return test
    legs, direction = log_legs(test)
    axis = sweep_axis(test)
    abscissa = smooth_abscissa(axis, legs)
    held = axis is not test.spool_position
    position = test.spool_position if held else abscissa.position
    rate = None if test.time is None else sweep_rates(test.time, position, legs, abscissa.step)
    return replace(
        test,
        spool_position=position,
        load_pressure=abscissa.position if held else test.load_pressure,
        direction=direction.astype(test.direction.dtype),
        rate=rate,
    )


def sweep_rates(time: np.ndarray, position: np.ndarray, legs: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Speed at each row (rows,), m/s: slopes of straight lines through position and time over a hundredth of the leg either
    side, or over as many rows as cross a few of the log's rounding `step`s (rows,)."""
    rate = np.zeros(len(time))
    for start, stop in piece_bounds(legs):
        x, t, rows = position[start:stop], time[start:stop], stop - start
        if rows < 3 or np.ptp(x) == 0.0:
            continue
        pace = abs(float(x[-1] - x[0])) / rows
        across = STEPS_ACROSS * float(step[start:stop].max()) / (2.0 * pace) if pace > 0.0 else 0.0
        half = int(np.clip(max(across, rows / SHARE_OF_LEG), 1, max(rows // 4, 1)))
        along, passed = local_line(x, half)[1], local_line(t, half)[1]
        rate[start:stop] = np.divide(along, passed, out=np.zeros(rows), where=passed > 0.0)
    return rate
