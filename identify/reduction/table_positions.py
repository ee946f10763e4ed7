"""Find how fast and which way the spool moved behind a table's noisy positions, and what their noise does to the readings. NumPy only.

A transducer's noise of 0.1 um becomes, from one row to the next, a rate of several um/s that the spool never had: effects of
rate, direction and heating would follow it (docs/diagnosis.md section 2). Raw logs have their own way (`sweep_position`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .monotone_pieces import monotone_pieces, piece_bounds, running_medians, sweep_axis
from .rounding import column_step
from .sweep_position import curve_slopes, local_cubic, local_line


SMALLEST = 1e-9  # of the sweep's range: no noise
FEWEST_ROWS = 8  # of a piece: fewer do not show a line and a scatter about it
# What a line may leave, as a share of the variance that third differences show: theirs is known to some 20 % of 100 rows.
STRAIGHT = 1.5
# A variance up to so many times of what the rounding of positions and times makes is no noise of the transducer: rounding
# errors have a median of up to 0.75 of their variance where normal ones have 0.45, and 200 rows tell it to some 30 %.
ROUNDED = 3.0
# Below this share of it positions are no rounded ones, unless they step aside now and then: an even grid, which is commanded, scatters
# by nothing at all, and of a sweep that moves on by nearly whole steps most rows are even.
COMMANDED = 0.3
ASIDE, NOW_AND_THEN = 0.2, 0.02  # steps, of a third difference as if of noise; share of the rows
# Gain in log-likelihood from which on the readings say that the spool did move as its positions scatter, or did not. Rows share their
# third differences with three others, so that 9 is a likelihood ratio of about e^3.
MOVED = 9.0
# Shares of the scatter that readings may follow; of barely any, positions are as good along the curve.
SHARES, BARELY = np.linspace(0.0, 1.0, 21), 0.15
NEARLY = 0.05  # that a share of all may seem to lack: slopes are known to some per cent
HEAVY = 3.0  # standard deviations beyond which a third difference is the curve's bend rather than noise
# Rows either side of a cubic; lines over more than `ENOUGH` are as good as any.
WIDEST, NARROWEST, ENOUGH = 64, 3, 16


# Value, slope, and the share of a row's variance that its distance keeps, per row.
_Curve = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class _Lines:
    """Straight lines in time through the positions, or cubics, per row (SI).

    found: rows that have one; `error`: its variance there, as a share of a row's.
    """

    value: np.ndarray
    slope: np.ndarray
    found: np.ndarray
    error: np.ndarray


def as_measured(test: TestRecord, *, along_curve: bool = False) -> TestRecord:
    """A table with time with directions and rates [m/s] of its smooth sweep, and what noise of its positions adds to the readings.

    That noise is stated (`position_std`) or the scatter that third differences in time show, unless the readings follow it: then
    the spool moved so. It adds to a reading's by the slope of the curve (effective variance; Fuller, Measurement Error Models,
    1987, sec. 3.1): `Channel.position_part`. The same with positions that scatter as rounded ones do; where the readings
    clearly do not follow, they are those of the line: sweeps that repeat each other repeat their rounding errors, which then are
    no noise.

    along_curve: for a fit. Positions go to the smooth sweep, and each reading goes with its own along the slope of its curve
    (`_with_parts`); else positions stay as read.
    """
    stated = test.position_std
    if test.in_motion or sweep_axis(test) is not test.spool_position:
        return test
    pieces, direction = _ways(test)
    if test.time is None:
        return _with_parts(test, stated, test.spool_position, pieces)
    beyond, noise, rounding = (stated, stated, 0.0) if stated is not None else _scatter(test, pieces)
    if noise <= SMALLEST * float(np.ptp(test.spool_position)):
        return test
    lines = _lines(test.time, test.spool_position, pieces, noise)
    if not lines.found.any():
        return _with_parts(test, stated, test.spool_position, pieces)
    direction = np.where(lines.found, direction, test.direction).astype(test.direction.dtype)
    rate = lines.slope if test.rate is None else np.where(lines.found, lines.slope, test.rate)
    swept = replace(test, direction=direction, rate=rate)
    if stated is None:
        clear, share = _followed(test, lines, pieces)
        if clear and (share > BARELY or beyond == 0.0):
            return _where_it_was(swept, lines, noise, rounding, share, pieces)
        if beyond == 0.0:
            return _with_parts(swept, noise, lines.value, pieces, along_curve=along_curve)
        note = (
            f"{test.name}: positions scatter by {significant(noise * 1e6, 2)} um about a smooth sweep in time, and the readings "
            "do not follow: this is taken for noise of the position and adds to the readings' by the slope of their curves; a fit "
            "sees each reading on the smooth sweep, taken there along its curve"
        )
        swept = replace(swept, notes=(*test.notes, note))
    return _with_parts(swept, noise, lines.value, pieces, along_curve=along_curve)


def _where_it_was(
    test: TestRecord, lines: _Lines, noise: float, rounding: float, share: float, pieces: np.ndarray
) -> TestRecord:
    """The test at the positions that are likeliest where the readings follow this share of the positions' scatter: the rest is noise.

    Of a scatter of variance s^2 the spool made share s^2; of where it was is known, beside the line, all but
    share (1 - share) s^2 (Fuller 1987, sec. 1.2), and where it did not move the line is, by the root of its rows.
    """
    if share >= 1.0 - NEARLY:  # what is left is rounding
        return _with_parts(test, min(rounding, noise * np.sqrt(BARELY)), test.spool_position, pieces)
    value = lines.value + share * (test.spool_position - lines.value)
    left = noise * np.sqrt((1.0 - share) * (share + (1.0 - share) * lines.error))
    return _with_parts(replace(test, spool_position=value), left, value, pieces)


def _ways(test: TestRecord) -> tuple[np.ndarray, np.ndarray]:
    """The monotone pieces and their directions (rows,), each with the row at which it turned: the motion before ended there."""
    pieces, direction = (column.copy() for column in monotone_pieces(test))
    for a, _ in list(piece_bounds(pieces))[1:]:
        step = test.spool_position[a] - test.spool_position[a - 1]
        if test.run[a] == test.run[a - 1] and direction[a] != direction[a - 1] and step * direction[a - 1] > 0.0:
            pieces[a], direction[a] = pieces[a - 1], direction[a - 1]
    return pieces, direction


def _with_parts(
    test: TestRecord,
    noise: np.ndarray | float | None,
    along: np.ndarray,
    pieces: np.ndarray,
    *,
    along_curve: bool = False,
) -> TestRecord:
    """What noise of the positions adds to each reading's, by its curve's slope over the smoother positions `along` (rows,).

    along_curve: positions go there too, and each reading with its own by that slope. To first order of the noise the misfit of
    every row stays what it is, and so does its noise: a line that is aside shifts no sweep. But the slopes of the model no longer
    scatter with the positions' noise, which the misfit has in it as well. Where the readings' noise remembers many rows, a fit
    sees changes from row to row, and the two look alike: of a valve with nothing wrong, read 12,000 times, curves without
    meaning explained chi-square 85 so.
    """
    if noise is None or not np.any(noise):
        return test
    channels = []
    for channel in test.channels:
        slope = _slopes(along, channel.value, pieces)
        found = replace(channel, position_part=noise * np.abs(slope))
        if along_curve:
            move = slope * (along - test.spool_position)
            found = replace(found, value=channel.value + move, moved=move)
        channels.append(found)
    return replace(
        test,
        channels=tuple(channels),
        spool_position=along if along_curve else test.spool_position,
        input_error={**test.input_error, "spool_position": np.broadcast_to(noise, test.spool_position.shape)},
    )


def _slopes(along: np.ndarray, value: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """Slope of the curve at every row (rows,) from medians of five neighbours: a bad row bends no good one's."""
    smooth = value.copy()
    for a, b in piece_bounds(pieces):
        if b - a >= FEWEST_ROWS:
            smooth[a:b] = running_medians(value[a:b])
    return curve_slopes(along, smooth, pieces)


def _scatter(test: TestRecord, pieces: np.ndarray) -> tuple[float, float, float]:
    """Standard deviation of a position about any parabola in time [m] beyond what rounding makes, 0 where that may be all; with the
    rounding, 0 where the positions scatter by less: they are then what was commanded; and of rounding alone where there is more.

    A time rounded to 10 ms moves a sweep of 20 um/s by 0.06 um and one of 4 um/s by 0.01 um: each piece has its own. Where rounding may
    be all, what is seen counts: a transducer's noise of a third of a step doubles the variance that rounding makes.
    """
    assert test.time is not None
    seen, rounding = [], []
    steps = column_step(test.spool_position), column_step(test.time)
    for a, b in piece_bounds(pieces):
        time, position = test.time[a:b], test.spool_position[a:b]
        if b - a < FEWEST_ROWS or not np.all(np.diff(time) > 0.0):
            continue
        seen.append(divided_third(time, position) ** 2)
        pace = abs(position[-1] - position[0]) / (time[-1] - time[0])
        tick = steps[1] if np.ptp(np.diff(time)) > 0.5 * steps[1] else 0.0  # an even clock is not rounded
        rounding.append(np.full(len(seen[-1]), (steps[0] ** 2 + (pace * tick) ** 2) / 12.0))
    if not seen:
        return 0.0, 0.0, 0.0
    square, rounded = np.concatenate(seen) / MEDIAN_OF_CHI2, np.concatenate(rounding)
    low, high = 0.0, float(np.median(square))
    share = float(np.median(square / np.maximum(rounded, 1e-9 * high))) if high > 0.0 else 0.0
    aside = float(np.mean(np.sqrt(square * MEDIAN_OF_CHI2) > ASIDE * steps[0]))
    own = steps[0] / np.sqrt(12.0) if steps[0] > 0.0 and (share > COMMANDED or aside > NOW_AND_THEN) else 0.0
    if share < ROUNDED:
        if np.mean(rounded) > 2.0 * steps[0] ** 2 / 12.0:
            return 0.0, own, 0.0  # mostly the clock's rounding, which is no noise of the position
        # A jump is no noise. Of coarse steps most third differences are 0, and so is their median.
        whole = np.mean(np.minimum(square * MEDIAN_OF_CHI2, HEAVY**2 * max(high, own**2)))
        return 0.0, float(np.sqrt(max(own**2, whole))) if own > 0.0 else 0.0, 0.0
    for _ in range(40):  # the variance beside which the median of all is what it should be
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.median(square / (middle + rounded)) > 1.0 else (low, middle)
    return float(np.sqrt(high)), float(np.hypot(np.sqrt(high), own)), own


def _lines(time: np.ndarray, position: np.ndarray, pieces: np.ndarray, noise: float) -> _Lines:
    """Lines over as many rows of each piece as the sweep is straight over, to within its noise; cubics where more rows follow one, as
    on a sine, which no five rows of a line do."""
    rows = len(time)
    lines = _Lines(position.copy(), np.zeros(rows), np.zeros(rows, dtype=bool), np.ones(rows))
    for a, b in piece_bounds(pieces):
        part, count = slice(a, b), b - a
        if count < FEWEST_ROWS or np.ptp(position[part]) == 0.0 or not np.all(np.diff(time[part]) > 0.0):
            continue
        x, t = position[part], time[part]
        found = _widest(local_line, x, t, noise, count - 1, 2)
        if found is None or np.mean(1.0 - found[2]) > 0.5 / ENOUGH:
            cubic = _widest(local_cubic, x, t, noise, min(WIDEST, (count - 1) // 2), NARROWEST)
            found = min(
                (f for f in (found, cubic) if f is not None), key=lambda f: float(np.mean(1.0 - f[2])), default=None
            )
        if found is not None:
            value, slope, kept = found
            lines.value[part], lines.slope[part], lines.found[part] = value, slope, True
            lines.error[part] = 1.0 - kept
    return lines


def _widest(
    curve: Callable[..., _Curve], x: np.ndarray, t: np.ndarray, noise: float, widest: int, narrowest: int
) -> _Curve | None:
    """The curve through the positions over the most rows that leaves no more than noise does."""
    half = widest
    while half >= narrowest:
        value, _, kept = found = curve(x, half, t)
        if np.sum((x - value) ** 2) <= STRAIGHT * noise**2 * max(np.sum(kept), 1.0):
            return found
        half //= 2
    return None


def _followed(test: TestRecord, lines: _Lines, pieces: np.ndarray) -> tuple[bool, float]:
    """Whether the readings say clearly that they followed the scatter of the positions, or did not; and what share of it they did
    follow: the spool made that, the rest is the transducer's noise and rounding."""
    losses = np.zeros(len(SHARES))
    for channel in test.channels:
        seen, expected = [], []
        slope = curve_slopes(lines.value, channel.value, pieces)
        shift = slope * (test.spool_position - lines.value)
        for a, b in piece_bounds(pieces):
            if b - a < FEWEST_ROWS or not lines.found[a]:
                continue
            seen.append(divided_third(lines.value[a:b], channel.value[a:b]))
            expected.append(divided_third(lines.value[a:b], shift[a:b]))
        if not seen:
            continue
        e, g = np.concatenate(seen), np.concatenate(expected)
        rest = e - SHARES[:, None] * g
        size = np.sqrt(np.min(np.median(rest**2, axis=1)) / MEDIAN_OF_CHI2)
        if size > 0.0:
            losses += [_loss(r / size) for r in rest]
    best = int(np.argmin(losses))
    if SHARES[best] >= 1.0 - BARELY and losses[-1] - losses[best] < MOVED:
        best = len(SHARES) - 1  # all of it is not excluded
    return bool(max(losses[0], losses[-1]) - losses[best] > MOVED), float(SHARES[best])


def _loss(r: np.ndarray) -> float:
    """Half the sum of squares of small residuals, of large ones their logarithm: minus the log-likelihood with heavy tails."""
    return float(np.sum(np.log1p((r / HEAVY) ** 2)) * HEAVY**2 / 2.0)
