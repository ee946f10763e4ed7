"""Find rows at which a gauge was at its limit, or a meter stood still in its dead band. NumPy and SciPy's laws only."""

from dataclasses import replace

import numpy as np
from scipy.special import bdtrc

from thermohyd.identify.bench.columns import reading_unit
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import DynamicTest, Fault, TestRecord
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .bad_rows import CHANCE, command_goes_on, place_in_file, without_rows
from .monotone_pieces import piece_bounds
from .rounding import column_step, local_steps


# A constant reading counts as a limit from a share of the rows on, in stretches of so many one after the other and more; chance is
# judged by the share of the other rows that lie nearest to it.
SHARE, IN_A_ROW, NEAREST = 0.02, 3, 0.2
SLOPE_OF_A_CUT = 2.0  # rounding steps from row to row
# ... of a valve's flow in static tests, which levels out within no row: coarse rounding alone would not tell a meter's limit there.
SLOPE_OF_A_FLOW = 10.0
CLEAR = 3.0  # standard deviations of the noise from a limit
LEFT = 8  # rows that must remain: a reading that never changes has a sentence of its own


def without_limits(test: TestRecord) -> TestRecord:
    """The test without rows at which a gauge was at its limit or a meter stood still: one constant where readings never repeat.

    In motion of pressures alone, since a piston or a flow may come to rest; a row on which the command turns stays. Not over frequency.
    """
    if test.axis == "frequency":
        return test
    for at, channel in enumerate(test.channels):
        if test.in_motion and "pressure" not in channel.name:
            continue
        ends = (float(np.min(channel.value)), float(np.max(channel.value)))
        limits = tuple(dict.fromkeys(ends if test.in_motion else (*ends, 0.0)))
        for limit in limits:
            rows = _standing(test, at, limit, limits)
            if len(rows) < SHARE * test.rows or test.rows - len(rows) < LEFT:
                continue
            if not test.in_motion:
                chosen = _by_their_noise(test, at, limit, limits, rows)
                rows = chosen if test.rows - len(chosen) >= LEFT else rows
            name = "meter_dead_band" if limit == 0.0 and not test.in_motion else "clipped"
            unit = reading_unit(channel.name, channel.signal)
            shown = f"{significant(limit * unit.factor, 3)} {unit.label}"
            how = "a gauge at its limit" if name == "clipped" else "a meter's dead band"
            value = test.channels[at].value
            beside = len(rows) - int(np.sum(value[rows] == limit))
            among = f", with {beside} beside them that only their noise kept from it" if beside else ""
            sentence = (
                f"{test.name}, {channel.name}: {len(rows) - beside} rows stand at exactly {shown}, where no other reading repeats: "
                f"{how}; left out of the fit{among}"
            )
            places = tuple(place_in_file(test, int(row)) for row in rows)
            fault = Fault(name, test.name, channel.name, limit, unit.si or "1", places, sentence)
            test = replace(without_rows(test, rows.tolist()), faults=(*test.faults, fault))
    return test


def _standing(test: TestRecord, at: int, limit: float, limits: tuple[float, ...]) -> np.ndarray:
    """Rows in which channel `at` is at exactly `limit`, in stretches while the spool moved, where a reading is followed by the same more
    often than by chance. A gauge that has a limit is at it in any row of that reading: where a sweep begins or turns these may be two.
    """
    value, none = test.channels[at].value, np.zeros(0, dtype=int)
    if test.rows < 2:
        return none
    moved = _moved(test, at)
    stays = moved & (value[:-1] == limit)
    again = stays & (value[1:] == limit)
    if not again.any():
        return none
    stretches = [(a, b) for a, b in piece_bounds(np.cumsum(np.append(0, ~again))) if b - a >= IN_A_ROW]
    by_chance = bdtrc(int(again.sum()) - 1, int(stays.sum()), _by_rounding(test, value, moved, limit, limits)) > CHANCE
    if by_chance and not (limit != 0.0 and _flow_ends_abruptly(test, at, stretches)):
        return none
    if not isinstance(test, DynamicTest):
        if stretches and limit != 0.0:
            return np.flatnonzero(value == limit)
        return np.concatenate([none, *(np.arange(a, b) for a, b in stretches)])
    least = SLOPE_OF_A_CUT * float(np.median(local_steps(value)))
    cut = [(a, b) for a, b in stretches if _cut_off(test, value, a, b, least)]
    return np.array([row for a, b in cut for row in range(a, b) if command_goes_on(test, row)], dtype=int)


def _by_their_noise(test: TestRecord, at: int, limit: float, limits: tuple[float, ...], rows: np.ndarray) -> np.ndarray:
    """The rows at a limit with those beside them that differ from it by their noise alone, all in runs that were at it.

    Of readings whose truth is near a limit those are left that noise took away from it, all on one side: a meter with a dead band of
    three times its noise read 0.024 l/min among zeros where 0.008 leaked. So from a row at the limit on all are taken until two in
    a row are clear of it.
    """
    value = test.channels[at].value
    own = np.isin(test.run, np.unique(test.run[rows]))
    stands = own & (value == limit)
    away = np.abs(value - limit)
    edge = float(np.min(away[own & ~stands], initial=np.inf)) if limit == 0.0 else 0.0
    near = _near(value, limit, limits)
    noise = 0.0 if near is None else _noise_at(test, value, ~np.isin(value, limits), near)
    doubtful = own & ~np.isin(value, [other for other in limits if other != limit]) & (away < edge + CLEAR * noise)
    taken = stands.copy()
    for first, end in piece_bounds(test.run):
        for step in (range(first, end), range(end - 1, first - 1, -1)):
            clear = 2
            for row in step:
                clear = 0 if stands[row] else clear + (not doubtful[row])
                taken[row] |= clear < 2 and doubtful[row]
    for first, end in piece_bounds(test.run):  # one that is clear among those that are not
        inner = taken[first : end - 2] & taken[first + 2 : end]
        taken[first + 1 : end - 1] |= inner & own[first + 1 : end - 1]
    return np.flatnonzero(taken)


def _moved(test: TestRecord, at: int) -> np.ndarray:
    """Whether the spool moved from each row to the next (rows - 1,); in motion, whether another reading than that of channel `at` did."""
    one_run = np.diff(test.run) == 0
    if not test.in_motion:
        return (np.diff(test.spool_position) != 0.0) & one_run
    others = [np.diff(channel.value) != 0.0 for i, channel in enumerate(test.channels) if i != at]
    return one_run & np.any(np.stack([np.zeros(len(one_run), dtype=bool), *others]), axis=0)


def _cut_off(test: TestRecord, value: np.ndarray, a: int, b: int, least: float) -> bool:
    """Whether readings in time come to rows a to b - 1, and leave them, by more than `least` from row to row within one run: a pressure
    that settles comes by a step of its rounding."""
    if not 0 < a < b < test.rows or test.run[a - 1] != test.run[b]:
        return False
    return bool(min(abs(value[a - 1] - value[a]), abs(value[b] - value[b - 1])) > least)


def _flow_ends_abruptly(test: TestRecord, at: int, stretches: list[tuple[int, int]]) -> bool:
    """Whether a valve's flow comes to and leaves all stretches as steeply as nothing does that then keeps still while the spool goes on.

    A rounding coarser than the noise makes neighbours equal wherever a curve is flat. Leakage and blocked ports' pressures can be that flat
    from one row to the next; a flow through an opening edge is not.
    """
    if test.in_motion or test.channels[at].name != "flow" or not stretches:
        return False
    value, position = test.channels[at].value, test.spool_position
    least = SLOPE_OF_A_FLOW * column_step(value)

    for a, b in stretches:
        beside = [
            (near, outer)
            for near, outer in ((a - 1, a - 2), (b, b + 1))
            if 0 <= outer < test.rows and test.run[outer] == test.run[a]
        ]
        went_on = [
            np.max(np.abs(position[a:b] - position[near])) > abs(position[near] - position[outer])
            for near, outer in beside
        ]
        steep = [abs(value[near] - value[outer]) > least for near, outer in beside]
        if not beside or not all(went_on) or not all(steep):
            return False
    return True


def _by_rounding(
    test: TestRecord, value: np.ndarray, moved: np.ndarray, limit: float, limits: tuple[float, ...]
) -> float:
    """How often neighbouring readings near a limit are equal because they were rounded: as often as they are, or as noise makes it.

    Noise of standard deviation s, rounded in steps h, gives equal neighbours with probability h/(2 sqrt(pi) s), where it spans a
    few steps. Judged by the readings nearest to the limit: a curve that levels out there is as flat, and its gauge as quiet, as it is.
    """
    off, near = ~np.isin(value, limits), _near(value, limit, limits)
    if near is None:
        return 1.0
    pairs = moved & near[:-1] & off[1:]
    equal = (float(np.sum(pairs & (np.diff(value) == 0.0))) + 1.0) / (float(pairs.sum()) + 2.0)
    step = float(np.median(local_steps(value[off])))
    if step == 0.0:
        return equal
    noise = _noise_at(test, value, off, near)
    return max(equal, min(1.0, step / (2.0 * np.sqrt(np.pi) * noise)) if noise > 0.0 else 1.0)


def _near(value: np.ndarray, limit: float, limits: tuple[float, ...]) -> np.ndarray | None:
    """Of the readings at no limit those nearest to this one; None where there are too few."""
    off = ~np.isin(value, limits)
    if off.sum() < LEFT:
        return None
    count = max(LEFT, round(NEAREST * int(off.sum())))
    reach = np.sort(np.abs(value[off] - limit))[min(count, int(off.sum())) - 1]
    return off & (np.abs(value - limit) <= reach)


def _noise_at(test: TestRecord, value: np.ndarray, off: np.ndarray, near: np.ndarray) -> float:
    """Standard deviation of the noise of the readings `near`, by third differences of those `off` all limits."""
    seen = []
    for a, b in piece_bounds(test.run[off]):
        part = value[off][a:b]
        if b - a >= LEFT:
            third = divided_third(np.arange(float(b - a)), part)
            seen.append(third[near[off][a + 1 : b - 2]])
    squares = np.concatenate(seen) ** 2 if seen else np.zeros(0)
    return float(np.sqrt(np.median(squares) / MEDIAN_OF_CHI2)) if len(squares) else 0.0
