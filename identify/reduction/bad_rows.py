"""Find rows that are not readings of the valve because they lie apart from their neighbours. NumPy and SciPy's laws only.

A missing effect is no outlier: a row counts as one only where its neighbours, without any model, leave no room for it. A table
may have one row on a sharp peak, so there the fitted valve must not explain the row either (`outliers`, called by the fit).
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from thermohyd.identify.bench.columns import reading_unit
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import Channel, DynamicTest, Fault, FaultyRow, TestRecord
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .monotone_pieces import monotone_pieces, piece_bounds, sweep_axis, sweep_ids
from .rounding import local_steps


CHANCE = 0.01  # of taking any good row of a test for an outlier
Key = tuple[str, str]  # test, channel

LONGEST = 3  # rows of an outlier, one after the other
MOST = 0.05  # share of a test's rows beyond which they are no outliers but its noise
AROUND = 12  # rows on either side that say how large the noise is there
# Third differences share rows and their median is 37 % efficient: degrees of freedom of the noise per row.
WORTH = 0.25
APART = 8  # rows between two outliers that are found at once
AS_COMMANDED = 1e-3  # of the command's range: a row without which it is the same
# The steepest share of a piece says how far a model's curve, or a row's position by its noise, lies aside. So many times that a
# good row may lie beyond all that its neighbours allow; or from the line across, as half of the rows of normal noise lie within
# 0.67 standard deviations, and one in some thousands seven times as far.
STEEPEST, SHIFTS, FROM_THE_LINE = 0.25, 3.0, 7.0


def outliers(
    test: TestRecord,
    values: np.ndarray,
    noise: np.ndarray | None = None,
    pieces: np.ndarray | None = None,
    aside: np.ndarray | None = None,
) -> dict[int, float]:
    """{row: standard deviations} of `values` (rows,) beyond all that their neighbours allow: readings, or what a model leaves.

    Without the row (or two, three in a row), lines and parabolas through the rows before it and behind it, and a line across,
    say where it might be; the span of all of them has room for kinks, peaks and steps. What a row is beyond that span is
    compared with the `noise` (rows,), by default what third differences show about there, by Student's law with Bonferroni's
    allowance for all rows. The worst go first, then their neighbours are looked at anew. The three rows at either
    end of a sweep are not judged. More than `MOST` of the rows: all that were found, for the caller to say so.
    pieces: the test's monotone ones, for who has them. aside (rows,): how far the model's curve lies aside there, where `values`
    are what a model leaves; a row then needs `SHIFTS` of it beyond its neighbours, or `FROM_THE_LINE` of it from the line across.
    """
    pieces = _pieces(test) if pieces is None else pieces
    noise = noise_about(values, pieces) if noise is None else noise
    level = -float(stdtrit(max(WORTH * test.rows, 3.0), CHANCE / (2 * LONGEST * max(test.rows, 1))))
    found: dict[int, float] = {}
    axis = _axis(test)
    for a, b in piece_bounds(pieces):
        rows = np.arange(a, b)
        while len(found) <= MOST * test.rows + LONGEST:
            blocks = _beyond(
                _along(axis[rows]), values[rows], noise[rows], level, None if aside is None else aside[rows]
            )
            if not blocks:
                break
            for first, count, sigma in blocks:
                found |= dict.fromkeys(rows[first : first + count].tolist(), sigma)
            rows = np.array([row for row in rows.tolist() if row not in found])
    return dict(sorted(found.items()))


def noise_about(values: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """Standard deviation of each row from third differences along its piece, about it and over the whole; rounding at least."""
    squares = np.zeros(len(values))
    for a, b in piece_bounds(pieces):
        if b - a >= 4:
            e = divided_third(np.arange(float(b - a)), values[a:b]) ** 2
            squares[a:b] = np.concatenate([e[:1], e, e[-1:], e[-1:]])
    around = np.full(len(values), np.median(squares))
    if len(values) > 2 * AROUND:
        padded = np.pad(squares, AROUND, mode="reflect")
        around = np.maximum(around, np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1), axis=1))
    least = np.hypot(local_steps(values), 1e-6 * np.ptp(values))
    return np.maximum(np.maximum(np.sqrt(around / MEDIAN_OF_CHI2), least), 1e-300)


def lies_aside(test: TestRecord, modelled: np.ndarray, misfit: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    """How far a model's curve lies aside at each row (rows,): its slope there times the shift of its piece.

    The shift is the median of misfit over slope where the piece is steepest, rows weighted by their slope squared, as noise
    shifts them less there: what the model lacks moves all of these rows, bad ones are few. modelled, misfit (rows,): readings
    as the model has them, and less what was read.
    """
    aside = np.zeros(test.rows)
    axis = _axis(test)
    for a, b in piece_bounds(pieces):
        steps = np.diff(axis[a:b])
        rise = np.divide(np.diff(modelled[a:b]), steps, out=np.zeros(b - a - 1), where=steps != 0.0)
        slope = np.maximum(np.abs(np.append(rise, 0.0)), np.abs(np.append(0.0, rise)))
        steep = slope > np.quantile(slope, 1.0 - STEEPEST)
        if steep.any():
            shift, weight = np.abs(misfit[a:b][steep]) / slope[steep], slope[steep] ** 2
            order = np.argsort(shift)
            middle = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
            aside[a:b] = slope * shift[order][middle]
    return aside


def outliers_beside(test: TestRecord, channel: Channel, modelled: np.ndarray) -> dict[int, float]:
    """{row: standard deviations} of a channel's rows that neither their neighbours nor the fitted valve allow.

    modelled (rows,): the readings as the fitted valve has them.
    """
    pieces = _pieces(test)
    misfit = modelled - channel.value
    size = np.maximum(noise_about(misfit, pieces), 0.0 if channel.std is None else channel.std)
    size = size if channel.position_part is None else np.hypot(size, channel.position_part)
    left = outliers(test, misfit, size, pieces)
    if not left:
        return {}
    suspects = outliers(test, channel.value, size, pieces)
    # On a steep rise neighbours leave room for anything: there the curve says how far the model lies aside.
    suspects |= outliers(test, misfit, size, pieces, lies_aside(test, modelled, misfit, pieces))
    return {row: sigma for row, sigma in left.items() if row in suspects}


def beside_the_fit(tests: Mapping[str, TestRecord], misfits: Mapping[Key, np.ndarray]) -> dict[str, TestRecord]:
    """{test: the same without rows that neither their neighbours nor the fitted model allow}, of the tests that have such rows.

    misfits {(test, channel): (rows,)}: the readings as the fit has them less what was read, SI. A reduced log's rows are so dense that
    their neighbours alone have decided. In time a row on which the command turns stays: without it the run's command would be another.
    """
    found: dict[str, dict[str, dict[int, float]]] = {}
    for (name, reading), misfit in misfits.items():
        test = tests[name]
        if test.rows_of_log is not None:
            continue
        channel = test.channel(reading)
        bad = outliers_beside(test, channel, channel.value + misfit)
        if isinstance(test, DynamicTest) and test.axis == "time":
            bad = {row: sigma for row, sigma in bad.items() if command_goes_on(test, row)}
        found.setdefault(name, {})[reading] = bad
    return {name: without_outliers(tests[name], bad) for name, bad in found.items() if any(bad.values())}


def command_goes_on(test: DynamicTest, row: int) -> bool:
    """Whether a row's command is what a line between its neighbours' has there, so that the run's is the same without it."""
    if not 0 < row < test.rows - 1 or not test.run[row - 1] == test.run[row] == test.run[row + 1]:
        return False
    (t0, t, t1), (u0, u, u1) = test.place[row - 1 : row + 2], test.command[row - 1 : row + 2]
    return bool(abs(u - u0 - (u1 - u0) * (t - t0) / (t1 - t0)) <= AS_COMMANDED * np.ptp(test.command))


def _pieces(test: TestRecord) -> np.ndarray:
    """Stretches of rows (rows,) whose neighbours say something of each other: a run in motion, a sweep one way else."""
    return sweep_ids(test) if test.in_motion else monotone_pieces(test)[0]


def _axis(test: TestRecord) -> np.ndarray:
    """What these rows follow each other along."""
    if test.axis == "frequency":
        return np.log(test.place)  # over which a response bends evenly
    return test.place if test.in_motion else sweep_axis(test)


def _along(axis: np.ndarray) -> np.ndarray:
    """What neighbours are compared along: the position where it goes one way, else (a dithered log's) the rows' order."""
    steps = np.diff(axis)
    return axis if np.all(steps > 0.0) or np.all(steps < 0.0) else np.arange(float(len(axis)))


def _beyond(
    x: np.ndarray, y: np.ndarray, noise: np.ndarray, level: float, aside: np.ndarray | None
) -> list[tuple[int, int, float]]:
    """(first row, rows, standard deviations) of the blocks beyond their neighbours, the worst first, none near another."""
    blocks = []
    for count in range(1, LONGEST + 1):
        at = np.arange(3, len(y) - 2 - count)
        if not len(at):
            continue
        left = [(x[at - k], y[at - k]) for k in (1, 2, 3)]
        right = [(x[at + count - 1 + k], y[at + count - 1 + k]) for k in (1, 2, 3)]
        excess = np.full(len(at), np.inf)
        for row in (at + k for k in range(count)):
            place, own = x[row], y[row]
            across = _through([left[0], right[0]], place)
            near = np.stack([across, *_ahead(left, place), *_ahead(right, place)])
            beyond = np.maximum(own - near.max(axis=0), near.min(axis=0) - own)
            if aside is not None:
                far = np.abs(own - across) - FROM_THE_LINE * aside[row]
                beyond = np.minimum(beyond, np.maximum(beyond - SHIFTS * aside[row], far))
            excess = np.minimum(excess, beyond)
        sigma = excess / (np.sqrt(1.5) * noise[at])  # noise of a row about the line across
        blocks += [(int(at[i]), count, float(sigma[i])) for i in np.flatnonzero(sigma > level)]
    apart: list[tuple[int, int, float]] = []
    for block in sorted(blocks, key=lambda b: -b[2]):
        if all(abs(block[0] - other[0]) > APART for other in apart):
            apart.append(block)
    return apart


Point = tuple[np.ndarray, np.ndarray]


def _ahead(near: list[Point], place: np.ndarray) -> list[np.ndarray]:
    """The nearest of three rows, and the line and the parabola through them, at `place`."""
    return [near[0][1], _through(near[:2], place), _through(near, place)]


def _through(points: list[Point], place: np.ndarray) -> np.ndarray:
    """The polynomial through these points, at `place` (Lagrange)."""
    value = np.zeros_like(place)
    for i, (at, reading) in enumerate(points):
        weight = np.ones_like(place)
        for j, (other, _) in enumerate(points):
            weight = weight if j == i else weight * (place - other) / (at - other)
        value = value + weight * reading
    return value


def without_outliers(test: TestRecord, found: Mapping[str, Mapping[int, float]]) -> TestRecord:
    """The test without these rows ({channel: {row: standard deviations}}) and with faults that name them; as it is without any.

    Where a channel has more than `MOST` of the rows they stay: so many say that the noise is of another kind.
    """
    faults, gone = list(test.faults), set()
    for name, rows in found.items():
        if not rows:
            continue
        masked = len(rows) <= MOST * test.rows
        faults.append(_outliers_fault(test, name, rows, masked))
        gone |= set(rows) if masked else set()
    if len(faults) == len(test.faults):
        return test
    return replace(without_rows(test, sorted(gone)) if gone else test, faults=tuple(faults))


def _outliers_fault(test: TestRecord, name: str, rows: Mapping[int, float], masked: bool) -> Fault:
    channel = test.channel(name)
    unit = reading_unit(name, channel.signal)
    worst = max(rows, key=lambda row: rows[row])
    reading = f"{significant(float(channel.as_read[worst]) * unit.factor, 3)} {unit.label}"
    what = "one row lies" if len(rows) == 1 else f"{len(rows)} rows lie"
    who = "" if len(rows) == 1 else "the worst "
    then = "left out of the fit" if masked else "so many are no outliers: they stay, and the noise is not normal"
    sentence = (
        f"{test.name}, {name}: {what} beyond what the rows around allow, {who}by {rows[worst]:.0f} standard deviations "
        f"({place_in_file(test, worst).words}: {reading}); {then}"
    )
    places = tuple(replace(place_in_file(test, row), sigma=sigma) for row, sigma in rows.items())
    return Fault("outliers", test.name, name, float(len(rows)), "1", places, sentence, masked)


def without_outliers_in_log(test: TestRecord) -> TestRecord:
    """A raw log without its outliers: its rows are so dense that no peak of the valve's is one row wide."""
    pieces = monotone_pieces(test)[0]
    return without_outliers(
        test, {channel.name: outliers(test, channel.value, pieces=pieces) for channel in test.channels}
    )


def place_in_file(test: TestRecord, row: int) -> FaultyRow:
    """Where a row stands in the file that the test was read from."""
    line = None if test.lines is None else int(test.lines[row])
    return FaultyRow(str(test.path.name), line, test.run_names[int(test.run[row])] if test.run_names else "")


def without_rows(test: TestRecord, rows: list[int]) -> TestRecord:
    """The test without these rows, in every column."""
    kept = np.ones(test.rows, dtype=bool)
    kept[rows] = False
    cut = lambda column: None if column is None else column[kept]
    channels = tuple(
        replace(
            c,
            value=c.value[kept],
            std=cut(c.std),
            rounding=cut(c.rounding),
            position_part=cut(c.position_part),
            moved=cut(c.moved),
        )
        for c in test.channels
    )
    if isinstance(test, DynamicTest):
        test = replace(
            test, command=test.command[kept], external_force=cut(test.external_force), frequency=cut(test.frequency)
        )
    return replace(
        test,
        channels=channels,
        spool_position=test.spool_position[kept],
        supply_pressure=test.supply_pressure[kept],
        return_pressure=test.return_pressure[kept],
        temperature=test.temperature[kept],
        run=test.run[kept],
        direction=test.direction[kept],
        load_pressure=cut(test.load_pressure),
        time=cut(test.time),
        rate=cut(test.rate),
        lines=cut(test.lines),
        input_error={name: error[kept] for name, error in test.input_error.items()},
        table=None,
    )
