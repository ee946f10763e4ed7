"""Turn a raw log of tens of thousands of rows into a few hundred points with honest noise. Plain NumPy.

Bins are stretches of neighbouring rows, so that dither and rounding of the position blur nothing, within one run, one
leg of the sweep and one set of conditions. A point is the mean of its rows, and is compared with the model's mean over
the same rows: `Nodes` say where to evaluate it. Nothing is assumed about the curve inside a bin.
"""

from dataclasses import replace

import numpy as np

from .abscissa import smooth_abscissa
from .bins import bin_starts
from .display_units import reading_unit, significant
from .legs import log_legs, piece_bounds, sweep_axis
from .point_noise import Points, points_of
from .record import Channel, Nodes, TestRecord


LOG_ROWS = 2000
FULL_LOG, LEAST_SHARE = (
    20_000,
    0.3,
)  # rows of a log that gets all its points; fewer and more by the third root of the rows
MEMORIES = 1.5  # rows of a bin, at least, in independent readings' worth
ROWS_PER_LEG = 200  # fewer, and the rows are readings that somebody took one by one


def reduce_test(test: TestRecord, *, max_points: int = 600, log_rows: int = LOG_ROWS) -> TestRecord:
    """The test with about `max_points` points instead of the rows of a raw log; any other test comes back as it is.

    test: STATIC test, SI. Points keep the order, direction, run, rate and mean time and conditions of their rows;
    `rows_of_log` counts these, `Channel.std` is the standard error of each point and `std_source`, `notes` say how it
    was found.
    """
    if not is_raw_log(test, max_points=max_points, log_rows=log_rows):
        return test
    legs, direction = log_legs(test)
    axis = sweep_axis(test)
    readings = [channel.value for channel in test.channels]
    abscissa = smooth_abscissa(axis, legs, readings)
    # Errors from the bins' finite width, where an edge closes within one, must not outgrow the noise of longer logs.
    max_points = round(max_points * max(test.rows / FULL_LOG, LEAST_SHARE) ** (1.0 / 3.0))
    starts = bin_starts(abscissa, readings, legs, max_points)
    first = [points_of(channel, starts, legs, abscissa) for channel in test.channels]
    remembered = max((p.correlation.rows_per_reading() for p in first if p.correlation.white < 1.0), default=0.0)
    if remembered > 0.0:
        # Of a row, were rows independent and their means as uncertain as these are.
        scatter = [p.row_std * np.sqrt(max(p.correlation.rows_per_reading(), 1.0)) for p in first]
        starts = bin_starts(abscissa, readings, legs, max_points, MEMORIES * remembered, scatter)
    rows = np.diff(np.append(starts, test.rows))
    mean = lambda values: np.add.reduceat(values.astype(float), starts) / rows
    position = mean(abscissa.position)
    held = axis is not test.spool_position
    channels, notes = [], [_what_was_done(test, legs, starts)]
    for channel in test.channels:
        points = points_of(channel, starts, legs, abscissa)
        if channel.std is None and np.ptp(channel.value) == 0:
            notes.append(f"{test.name}, {channel.name}: the reading never changes, so nothing is known of its noise")
            channels.append(Channel(channel.name, points.value))
            continue
        notes.append(_noise_note(test, channel, points, rows))
        declared = channel.std is not None
        source = "declared noise of a row, averaged over its bin" if declared else "scatter of the log's rows"
        channels.append(Channel(channel.name, points.value, points.std, source, points.step, points.freedom))
    return replace(
        test,
        spool_position=mean(test.spool_position) if held else position,
        supply_pressure=mean(test.supply_pressure),
        return_pressure=mean(test.return_pressure),
        temperature=mean(test.temperature),
        load_pressure=None if test.load_pressure is None else (position if held else mean(test.load_pressure)),
        channels=tuple(channels),
        run=test.run[starts],
        direction=direction[starts].astype(test.direction.dtype),
        time=None if test.time is None else mean(test.time),
        rate=None
        if test.time is None
        else _rates(test.time, abscissa.position if not held else test.spool_position, legs, starts),
        lines=None if test.lines is None else test.lines[starts],
        rows_of_log=rows,
        table=None,
        notes=(*test.notes, *notes),
        nodes=nodes_of(abscissa.position, test.time, starts, "load_pressure" if held else "spool_position"),
    )


def nodes_of(axis: np.ndarray, time: np.ndarray | None, starts: np.ndarray, name: str) -> Nodes:
    """Two nodes per bin whose weighted sum is the mean over its rows of any cubic along `axis` (rows,), in the order of time.

    Gauss's rule for the rows themselves as the measure: the roots of x^2 - (m3/m2) x - m2, of their central moments.
    """
    rows = np.diff(np.append(starts, len(axis)))
    mean = lambda values: np.add.reduceat(values, starts) / rows
    offset = axis - np.repeat(mean(axis), rows)
    size = np.maximum(np.repeat(np.maximum.reduceat(np.abs(offset), starts), rows), 1e-300)
    unit = offset / size  # of order one: moments of micrometres must not vanish in rounding
    second, third = mean(unit**2), mean(unit**3)
    flat = second <= 1e-20
    skew = np.where(flat, 0.0, third / np.where(flat, 1.0, second))
    root = np.sqrt(skew**2 + 4.0 * second)
    low, high = (skew - root) / 2.0, (skew + root) / 2.0
    width = np.where(flat, 1.0, high - low)
    weight = np.stack([np.where(flat, 0.5, high / width), np.where(flat, 0.5, -low / width)], axis=1)
    places = np.stack([low, high], axis=1)
    pace = np.zeros(len(starts))
    if time is not None:
        late = time - np.repeat(mean(time), rows)
        pace = np.where(flat, 0.0, mean(unit * late) / np.where(flat, 1.0, second))
        falling = pace < 0.0
        places[falling], weight[falling] = places[falling, ::-1], weight[falling, ::-1]
    return Nodes(places * size[starts][:, None], places * pace[:, None], weight, name)


def is_raw_log(test: TestRecord, *, max_points: int = 600, log_rows: int = LOG_ROWS) -> bool:
    """Whether the rows are a logger's, not readings taken one by one: many, and many to each leg of the sweep.

    Below `log_rows` rows only where the position often stands still or steps back between rows, as a log's does.
    """
    if test.rows <= max_points or test.rows_of_log is not None:
        return False
    legs, direction = log_legs(test)
    long = test.rows / (int(legs[-1]) + 1) >= ROWS_PER_LEG
    if test.rows >= log_rows:
        return long
    forward = np.diff(sweep_axis(test)) * direction[1:] > 0
    return long and float(np.mean(forward)) < 0.7


def _rates(time: np.ndarray, position: np.ndarray, legs: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Speed of the sweep at each point, m/s, from the points' mean times and positions within the leg."""
    rows = np.diff(np.append(starts, len(time)))
    t, x = (np.add.reduceat(values, starts) / rows for values in (time, position))
    rate = np.zeros(len(starts))
    for start, stop in piece_bounds(legs[starts]):
        if stop - start > 1 and np.all(np.diff(t[start:stop]) > 0):
            rate[start:stop] = np.gradient(x[start:stop], t[start:stop])
    return rate


def _what_was_done(test: TestRecord, legs: np.ndarray, starts: np.ndarray) -> str:
    runs, count = len(np.unique(test.run)), int(legs[-1]) + 1
    return (
        f"{test.name}: {test.rows:,} rows -> {len(starts):,} points in bins along the sweep, separately for each of {count} "
        f"{'leg' if count == 1 else 'legs'} (run, direction and conditions) in {runs} {'run' if runs == 1 else 'runs'}; "
        "narrower bins where the curve is steep or bends"
    )


def _noise_note(test: TestRecord, channel: Channel, points: Points, rows: np.ndarray) -> str:
    unit = reading_unit(channel.name)
    shown = lambda value: f"{significant(float(value) * unit.factor, 2)} {unit.label}"
    n = float(np.median(rows))
    parts = []
    if points.row_std > 0:
        worth = float(points.correlation.effective_rows(n))
        kept = (
            "declared noise"
            if channel.std is not None
            else f"scatter of {shown(points.row_std)} of the rows kept as noise"
        )
        if points.correlation.white == 1.0:
            parts.append(f"{kept}; rows are independent of each other ({n:.0f} in a typical bin)")
        else:
            parts.append(
                f"{kept}; a bin of {n:.0f} rows counts as {worth:.1f} independent {'reading' if worth < 1.05 else 'readings'}"
            )
        pause = _memory(test, points)
        if pause:
            parts.append(f"neighbouring rows correlate over {pause}")
        neighbours = points.correlation.of_neighbours(n)
        if neighbours > 0.1:
            parts.append(f"neighbouring points still correlate by {neighbours:.2f}")
    if points.floored.any():
        steps = np.unique(np.round(points.step[points.floored] * unit.factor, 6)) / unit.factor
        size = np.abs(points.value[points.floored])
        coarse = shown(steps[-1]) if len(steps) == 1 else f"up to {shown(steps[-1])}"
        where = f"beyond {shown(size.min())}" if size.min() > 0.05 * np.max(np.abs(points.value)) else "in places"
        parts.append(
            f"{np.sum(points.floored):,} points {where} rest on readings rounded to {coarse} and are not believed beyond that"
        )
    if (points.sharing > 2).any():
        parts.append("neighbouring points on one rounded reading together count as one")
    return f"{test.name}, {channel.name}: " + "; ".join(parts or ["no scatter and no rounding seen"])


def _memory(test: TestRecord, points: Points) -> str:
    if points.correlation.white > 0.9:
        return ""
    rows = points.correlation.memory
    if test.time is not None and (pace := float(np.median(np.diff(test.time)))) > 0:
        return f"{significant(rows * pace, 2)} s"
    return f"{rows:.0f} rows"
