"""Cut a test's rows into monotone pieces: one run, one direction of the sweep, one set of conditions. NumPy only.

A piece ends where the sweep turns or where a condition steps. On a raw log the turning points are those of the smoothed
position, so that neither dither nor rounding makes one.
"""

from collections.abc import Iterator

import numpy as np

from thermohyd.identify.bench.test_record import TestRecord


SMALLEST_PIECE = 0.02  # of the position's range: a reversal smaller than this is dither
PRESSURE_STEP = 0.01  # of the largest supply pressure: beyond this, conditions are different
TEMPERATURE_STEP = 1.0  # K


def piece_bounds(ids: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and past-the-last row of every stretch of equal ids."""
    if len(ids) == 0:
        return iter(())
    starts = np.append(0, 1 + np.flatnonzero(ids[1:] != ids[:-1]))
    return zip(starts.tolist(), np.append(starts[1:], len(ids)).tolist(), strict=True)


def sweep_ids(test: TestRecord, *, across_conditions: bool = False) -> np.ndarray:
    """Number of the sweep that each row of a test belongs to: same run, direction and conditions, one row after the other.

    A run of a dynamic test is one sweep, whatever its measured supply pressure does. across_conditions: so is every stretch
    of one direction, for who only looks at the shape of a curve and must not be thrown by noisy pressures.
    """
    if test.in_motion:
        return test.run
    if across_conditions:
        return _numbered(test.run, test.direction)
    return _numbered(test.run, test.direction, condition_ids(test, window=1))


def run_ids(test: TestRecord) -> np.ndarray:
    """Number of the run that each row belongs to, its sweeps one after the other: noise remembers along these."""
    return _numbered(test.run)


def condition_stretches(test: TestRecord) -> np.ndarray:
    """Number of the stretch of one run and one set of conditions that each row belongs to."""
    return _numbered(test.run, condition_ids(test))


def level_numbers(values: np.ndarray, width: float) -> np.ndarray:
    """Number of the level (rows,) that each value belongs to, the lowest first; levels lie more than `width` apart."""
    order = np.argsort(values, kind="stable")
    level = np.empty(len(values), dtype=int)
    level[order] = np.concatenate([[0], np.cumsum(np.diff(values[order]) > width)])[: len(values)]
    return level


def monotone_pieces(test: TestRecord) -> tuple[np.ndarray, np.ndarray]:
    """Number of the monotone piece that each row of a raw log belongs to, and the piece's direction (+1, -1) per row.

    Turning points are those of the smoothed position, so that dither and rounding make none.
    """
    turns = np.zeros(test.rows, int)
    for start, stop in piece_bounds(test.run):
        for row in turning_points(sweep_axis(test)[start:stop]):
            turns[start + row] = 1
    pieces = _numbered(test.run, np.cumsum(turns), condition_ids(test))
    direction = np.ones(test.rows)
    last = 0
    for start, stop in piece_bounds(pieces):
        x = test.spool_position[start:stop]
        third = max(1, len(x) // 3)
        change = float(np.mean(x[-third:]) - np.mean(x[:third]))
        if abs(change) > 0 and len(x) > 1:
            direction[start:stop] = np.sign(change)
        elif start > 0 and test.run[start] == test.run[last]:
            direction[start:stop] = direction[start - 1]
        last = start
    return pieces, direction


def sweep_axis(test: TestRecord) -> np.ndarray:
    """What a log sweeps: the position, or the imposed load pressure where the position is held and the load varies."""
    if test.load_pressure is None:
        return test.spool_position
    travel = [float(np.sum(np.abs(np.diff(running_medians(a))))) / max(float(np.ptp(a)), 1e-300) if np.ptp(a) > 0 else 0.0
              for a in (test.spool_position, test.load_pressure)]  # fmt: skip
    return test.spool_position if travel[0] >= travel[1] else test.load_pressure


def turning_points(position: np.ndarray) -> list[int]:
    """Rows at which the sweep turns: extremes of the smoothed position that later reverse by more than dither does."""
    rows = len(position)
    if rows < 3 or np.ptp(position) == 0:
        return []
    half = min(25, rows // 100)
    smooth = moving_mean(position, half)
    spread = float(np.median(np.abs(position - smooth))) / 0.6745 if half else 0.0
    reversal = max(SMALLEST_PIECE * float(np.ptp(smooth)), 6.0 * spread / np.sqrt(2 * half + 1))
    turns: list[int] = []
    high = low = 0
    heading = 0
    values = smooth.tolist()
    for row, value in enumerate(values):
        if value > values[high]:
            high = row
        if value < values[low]:
            low = row
        if heading >= 0 and value < values[high] - reversal:
            if heading > 0:
                turns.append(_middle_of_dwell(smooth, high, reversal))
            heading, low = -1, row
        elif heading <= 0 and value > values[low] + reversal:
            if heading < 0:
                turns.append(_middle_of_dwell(smooth, low, reversal))
            heading, high = 1, row
    return turns


def condition_ids(test: TestRecord, window: int = 15) -> np.ndarray:
    """Stretches of rows at the same supply, return (and held) pressure and temperature.

    A new stretch starts where the running median of a condition has moved by more than 1 % of the supply pressure or
    1 K since the stretch began: a step is cut once, a slow drift every now and then, noise never.
    """
    pressure_step = PRESSURE_STEP * max(float(np.max(np.abs(test.supply_pressure), initial=0.0)), 1e-300)
    columns = [(test.supply_pressure, pressure_step), (test.return_pressure, pressure_step),
               (test.temperature, TEMPERATURE_STEP)]  # fmt: skip
    if test.load_pressure is not None:
        if sweep_axis(test) is test.spool_position:
            columns.append((test.load_pressure, pressure_step))
        else:
            columns.append((test.spool_position, SMALLEST_PIECE * max(float(np.ptp(test.spool_position)), 1e-300)))
    cuts = np.zeros(test.rows, int)
    most = max(10, test.rows // (500 if window > 1 else 2))  # a column that never rests must not shred the log
    for values, step in columns:
        if np.ptp(values) > step:
            cuts[_cuts(running_medians(values, window), step, most)] = 1
    return np.cumsum(cuts)


def moving_mean(values: np.ndarray, half: int) -> np.ndarray:
    """Mean over `half` rows on either side, fewer (but still as many on both sides) near the ends."""
    if half == 0:
        return values
    total = np.concatenate([[0.0], np.cumsum(values - values[0])])
    row = np.arange(len(values))
    reach = np.minimum(half, np.minimum(row, len(values) - 1 - row))
    return values[0] + (total[row + reach + 1] - total[row - reach]) / (2 * reach + 1)


def _middle_of_dwell(smooth: np.ndarray, extreme: int, reversal: float) -> int:
    """A sweep that stands still at its end turns in the middle of the stop."""
    near = np.abs(smooth - smooth[extreme]) < 0.02 * reversal
    before = extreme - int(np.argmin(near[extreme::-1])) + 1 if not near[: extreme + 1].all() else 0
    after = extreme + int(np.argmin(near[extreme:])) if not near[extreme:].all() else len(smooth)
    return (before + after) // 2


def _cuts(values: np.ndarray, step: float, most: int) -> list[int]:
    """Rows at which the value has moved by more than `step` since the last cut; a column that never rests gets a wider step."""
    while True:
        cuts: list[int] = []
        at = 0
        while len(cuts) <= most:
            moved = np.abs(values[at:] - values[at]) > step
            first = int(np.argmax(moved))
            if not moved[first]:
                return cuts
            at += first
            cuts.append(at)
        step *= 2.0


def running_medians(values: np.ndarray, window: int = 5) -> np.ndarray:
    """Running median over an odd number of rows, which keeps steps where they are."""
    if window == 1 or len(values) < window:
        return values
    padded = np.pad(values, window // 2, mode="edge")
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, window), axis=-1)


def _numbered(*ids: np.ndarray) -> np.ndarray:
    """0, 1, 2, ... for every stretch over which none of the ids changes."""
    change = np.zeros(len(ids[0]), bool)
    for one in ids:
        change[1:] |= one[1:] != one[:-1]
    return np.cumsum(change)
