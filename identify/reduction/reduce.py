"""Reduce a raw log of tens of thousands of rows to a few hundred points with honest noise. NumPy only.

Bins are stretches of neighbouring rows, so that dither and rounding of the position blur nothing, within one run, one monotone
piece of the sweep and one set of conditions; narrow where the curve is steep or bends, wide where it rests. They end at its corners.
A point is the mean of its rows, and is compared with the model's mean over the same rows: `Nodes` say where to evaluate it. Nothing
else is assumed about the curve inside a bin.

A prediction row by row needs the sweep itself (`smooth_sweep`): where the spool was, how fast and which way. From one dithered
row to the next the position steps back and forth, and effects of direction and rate would follow every step.
"""

from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.columns import reading_unit
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2

from .bad_rows import without_outliers_in_log
from .corners import ending_at_corners
from .monotone_pieces import monotone_pieces, piece_bounds, sweep_axis
from .nodes import nodes_of
from .noise_of_logs import RowNoise, row_noise
from .noise_of_points import Points, points_of
from .rounding import joined_steps, local_steps
from .smooth_conditions import followed, with_smooth_conditions
from .sweep_position import STEPS_ACROSS, Abscissa, curve_slopes, local_line, smooth_abscissa
from .table_positions import as_measured
from .third_differences import coarse_scatter


CELLS = 400  # per piece: the resolution at which the curve's shape is judged
SMALLEST_BIN = 2  # rows; their mean of the model is then exact
BENT = 10.0  # scatters of a row by which a reading may bend over one row squared, where a bin of one row is wanted
FEW_BINS, FEWEST_BINS = 8, 60  # per piece, where there are many pieces and where there are few
SHARES = {
    "width": 0.35,
    "rise": 0.30,
    "bend": 0.35,
}  # of the points: even along the sweep, along the reading, at its bends


def bin_starts(
    abscissa: Abscissa,
    readings: list[np.ndarray],
    pieces: np.ndarray,
    max_points: int,
    smallest: float = SMALLEST_BIN,
    scatter: list[float] | None = None,
) -> np.ndarray:
    """First row of every bin, ascending, so that about `max_points` bins cover the log and none crosses a piece's end.

    smallest: rows of a bin, at least: some times what the noise remembers, so that points are independent readings; but for
    narrower ones where a reading bends by more than its `scatter` (of a row, as if independent; one per reading).

    Bins hold equal parts of a density that grows with the sweep, the rise of the readings and, as the 2/5th power, their
    curvature. How they are cut biases nothing, as means of readings are compared with means of the model: they are
    narrow where the curve tells something.
    """
    rows = len(pieces)
    width = np.abs(_steps(abscissa.position, pieces))
    rise, bend, needed = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    for reading, own in zip(readings, scatter or [np.inf] * len(readings), strict=True):
        slope, curvature = _shape(reading, pieces)
        needed = np.maximum(needed, (np.abs(curvature) / (BENT * max(own, 1e-300))) ** 0.4)
        rise += _share(np.abs(slope))
        bend += _share(np.abs(curvature) ** 0.4)
    parts = {"width": _share(width), "rise": _share(rise), "bend": _share(bend)}
    density = np.full(rows, 0.02 / rows)
    for name, part in parts.items():
        density += SHARES[name] * part
    density *= max_points / density.sum()
    fewest = float(np.clip(0.5 * max_points / len(np.unique(pieces)), FEW_BINS, FEWEST_BINS))
    starts: list[np.ndarray] = []
    for start, stop in piece_bounds(pieces):
        stairs = abscissa.position[start:stop] if abscissa.staircase[start] else None
        most = np.maximum(needed[start:stop], max(1.0 / smallest, fewest / (stop - start)))
        starts.append(start + _cut(density[start:stop], fewest, np.minimum(most, 1.0 / SMALLEST_BIN), stairs))
    return np.concatenate(starts)


def _cut(density: np.ndarray, fewest: float, most: np.ndarray, stairs: np.ndarray | None) -> np.ndarray:
    """Starts of the bins of one piece: equal parts of the density, nowhere denser than `most`, on the steps of a staircase."""
    bins = max(1, round(min(max(float(density.sum()), fewest), float(most.sum()))))
    for _ in range(20):  # what the cap takes goes to the rest
        density = density * (bins / density.sum())
        if np.all(density <= 1.001 * most):
            break
        density = np.minimum(density, most)
    edge = np.searchsorted(np.cumsum(density) * (bins / density.sum()), np.arange(1, bins) - 1e-9)
    starts = np.unique(np.append(0, edge))
    if stairs is not None:
        treads = np.append(0, 1 + np.flatnonzero(np.diff(stairs)))
        starts = np.unique(treads[np.searchsorted(treads, starts, side="right") - 1])
    return starts


def _shape(reading: np.ndarray, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope and curvature per row of the smoothed reading, piece by piece."""
    slope, curvature = np.zeros(len(reading)), np.zeros(len(reading))
    for start, stop in piece_bounds(pieces):
        n = stop - start
        size = max(1, n // CELLS)
        count = n // size
        if count < 20:
            slope[start:stop] = (reading[stop - 1] - reading[start]) / n
            continue
        level = _unstepped(reading[start:stop])
        cells = level[: count * size].reshape(count, size).mean(axis=1)
        _, first, second = local_parabola(cells, _best_half(cells))
        cell = np.minimum(np.arange(n) // size, count - 1)
        slope[start:stop], curvature[start:stop] = first[cell] / size, second[cell] / size**2
    return slope, curvature


def _unstepped(reading: np.ndarray) -> np.ndarray:
    """A reading that stands still between the steps of its rounding, joined up through the middles of its steps."""
    return joined_steps(reading) if 2 <= np.count_nonzero(np.diff(reading)) <= 0.5 * len(reading) else reading


def local_parabola(values: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, first and second derivative per entry of parabolas over `half` entries on either side (one-sided at the ends)."""
    t = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv(np.stack([np.ones_like(t), t, t**2], axis=1))
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * half + 1)
    a, b, c = fit @ windows.T
    row = np.arange(len(values))
    at = np.clip(row, half, len(values) - 1 - half)
    off = row - at
    a, b, c = a[at - half], b[at - half], c[at - half]
    return a + b * off + c * off**2, b + 2 * c * off, 2 * c


def _best_half(cells: np.ndarray) -> int:
    """Half window whose parabolas predict left-out cells best."""
    best, least = 2, np.inf
    for half in (2, 3, 5, 8, 12, 20):
        if 2 * half + 1 > len(cells) // 3:
            break
        value, _, _ = local_parabola(cells, half)
        t = np.arange(-half, half + 1.0)
        own = np.linalg.pinv(np.stack([np.ones_like(t), t, t**2], axis=1))[0, half]
        inside = slice(half, len(cells) - half)
        error = float(np.mean(((cells - value)[inside] / (1.0 - own)) ** 2))
        if error < least:
            best, least = half, error
    return best


def _steps(values: np.ndarray, pieces: np.ndarray) -> np.ndarray:
    change = np.diff(values, prepend=values[0])
    change[np.append(False, pieces[1:] != pieces[:-1])] = 0.0
    return change


def _share(density: np.ndarray) -> np.ndarray:
    total = float(density.sum())
    return density / total if total > 0 else np.zeros_like(density)


# Of a test whose sweeps go forward from row to row, as readings do that somebody took: from so many on it may be a log.
LOG_ROWS = 2000
# Rows of a log that gets all its points; fewer and more by the third root of the rows.
FULL_LOG, LEAST_SHARE = 20_000, 0.3
MEMORIES = 3.0  # rows of a bin, at least, in independent readings' worth
# Fewer rows per piece, and they are readings that somebody took one by one; or, where the sweep goes forward from row to row, so
# far apart that the curve's bends and a noise with a memory look alike in them: rows are then fitted one by one, up to so many.
ROWS_PER_PIECE, FORWARD_PER_PIECE, ONE_BY_ONE = 200, 600, 6000
FORWARD = 0.7  # of the rows move on with their sweep, where no dither and no rounding hides it


def reduce_test(test: TestRecord, *, max_points: int = 600, log_rows: int = LOG_ROWS) -> TestRecord:
    """The test with about `max_points` points instead of the rows of a raw log, outliers left out; any other with its sweep's rates.

    test: SI; one in motion keeps its rows. Points keep the order, direction, run, rate and mean time and conditions of their rows;
    `rows_of_log` counts these, `Channel.std` is the standard error of each point and `std_source`, `notes` say how it
    was found.
    """
    test = with_smooth_conditions(test)
    if test.in_motion or not is_raw_log(test, max_points=max_points, log_rows=log_rows):
        return as_measured(test, along_curve=True)
    test = without_outliers_in_log(test)
    pieces, direction = monotone_pieces(test)
    axis = sweep_axis(test)
    readings = [channel.value for channel in test.channels]
    abscissa = smooth_abscissa(axis, pieces, readings)
    test, noises, followed_by, position_noise, shaken = _along_the_sweep(test, abscissa, pieces)
    # Errors from the bins' finite width, where an edge closes within one, must not outgrow the noise of longer logs.
    max_points = round(max_points * max(test.rows / FULL_LOG, LEAST_SHARE) ** (1.0 / 3.0))
    starts = bin_starts(abscissa, readings, pieces, max_points)
    both = list(zip(test.channels, noises, strict=True))
    first = [points_of(channel, starts, pieces, noise) for channel, noise in both]
    remembered = max((p.correlation.rows_per_reading() for p in first if not p.correlation.white), default=0.0)
    if remembered > 0.0:
        # Of a row, were rows independent and their means as uncertain as these are.
        scatter = [p.row_std * np.sqrt(max(p.correlation.rows_per_reading(), 1.0)) for p in first]
        starts = bin_starts(abscissa, readings, pieces, max_points, MEMORIES * remembered, scatter)
        first = [points_of(channel, starts, pieces, noise) for channel, noise in both]
    std = [
        np.hypot(p.std, part)
        for p, part in zip(first, _moved_by_positions(first, abscissa, pieces, starts, position_noise)[1], strict=True)
    ]
    starts = ending_at_corners(starts, pieces, abscissa.position, [c.value for c in test.channels], std)
    rows = np.diff(np.append(starts, test.rows))
    mean = lambda values: np.add.reduceat(values.astype(float), starts) / rows
    position = mean(abscissa.position)
    held = axis is not test.spool_position
    sweep = "load_pressure" if held else "spool_position"
    channels, notes = [], [_what_was_done(test, pieces, starts)]
    reduced = [points_of(channel, starts, pieces, noise) for channel, noise in both]
    error, parts = _moved_by_positions(reduced, abscissa, pieces, starts, position_noise)
    for channel, points, part in zip(test.channels, reduced, parts, strict=True):
        if channel.std is None and np.ptp(channel.value) == 0:
            notes.append(f"{test.name}, {channel.name}: the reading never changes, so nothing is known of its noise")
            channels.append(Channel(channel.name, points.value, sensor=channel.sensor))
            continue
        notes.append(_noise_note(test, channel, points, rows))
        declared = channel.std is not None
        source = "declared noise of a row, averaged over its bin" if declared else "scatter of the log's rows"
        freedom, sensor = points.degrees_of_freedom, channel.sensor
        moved = part if error.any() else None
        channels.append(
            Channel(channel.name, points.value, points.std, source, points.step, freedom, moved, sensor=sensor)
        )
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
        else _rates(test.time, abscissa.position if not held else test.spool_position, pieces, starts),
        lines=None if test.lines is None else test.lines[starts],
        rows_of_log=rows,
        table=None,
        notes=(*test.notes, *notes),
        input_error={name: mean(value) for name, value in test.input_error.items()}
        | ({sweep: error} if error.any() else {}),
        input_covariance={sweep: abscissa.covariance_of_means(pieces, starts) + np.diag(followed_by / rows)}
        if error.any()
        else {},
        nodes=nodes_of(abscissa.position, test.time, starts, sweep, shaken),
    )


def _along_the_sweep(
    test: TestRecord, abscissa: Abscissa, pieces: np.ndarray
) -> tuple[TestRecord, list[RowNoise], float, np.ndarray, np.ndarray]:
    """The test with readings as they would be on the smooth sweep, the noise of each, the variance [m^2 or Pa^2] of a row's position that
    all of them show, that (rows,) of a position's error, and that by which the spool itself left the smooth sweep.

    A spool that shakes takes its readings along, what a transducer scatters by they do not follow: readings are taken along their curve
    to the smooth sweep by the share of the position's scatter that they follow. What is left of it is seen in their own scatter, larger
    where the curve is steeper, in all channels alike: one transducer has one noise.
    """
    slopes = [curve_slopes(abscissa.position, channel.value, pieces, shrunk=True) for channel in test.channels]
    away = np.where(abscissa.staircase, 0.0, abscissa.position - sweep_axis(test))
    share = followed([c.value for c in test.channels], [-slope * away for slope in slopes], pieces)
    channels, shaken = test.channels, np.zeros(test.rows)
    if share > 0.0:
        for start, stop in piece_bounds(pieces):
            # What readings follow of the scatter is the spool's part of its variance.
            shaken[start:stop] = share * float(np.median(away[start:stop] ** 2)) / MEDIAN_OF_CHI2
        moves = [share * slope * away for slope in slopes]
        channels = tuple(replace(c, value=c.value + move, moved=move) for c, move in zip(channels, moves, strict=True))
    both = list(zip(channels, slopes, strict=True))
    steps = [local_steps(c.as_read) for c in channels]
    noises = [
        row_noise(c.value, pieces, slope, c.std, None, step) for (c, slope), step in zip(both, steps, strict=True)
    ]
    weight = np.array([n.position_error**-2.0 if 0.0 < n.position_error < np.inf else 0.0 for n in noises])
    shared = float(weight @ [n.position for n in noises]) / float(weight.sum()) if weight.any() else 0.0
    if len(noises) > 1:
        both = list(zip(channels, slopes, steps, strict=True))
        noises = [row_noise(c.value, pieces, slope, c.std, shared, step) for c, slope, step in both]
    noises = [
        n if c.std is not None or not step.any() else replace(n, coarse=coarse_scatter(c.value, pieces, step))
        for n, c, step in zip(noises, channels, steps, strict=True)
    ]
    # Of the scatter that readings do not follow they may show less than there is.
    return (
        replace(test, channels=channels),
        noises,
        shared,
        np.maximum(shared, (1.0 - share) * abscissa.scatter),
        shaken,
    )


def _moved_by_positions(
    points: list[Points], abscissa: Abscissa, pieces: np.ndarray, starts: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Standard error of each point's position, of whose rows each is read with its `variance` (rows,), and what it makes of each reading
    (SI).

    A smooth sweep moves that noise from row to row and takes none of it away: points of one window share what is left of it there, and
    all of them together place the sweep as well as their rows do. One by one they scatter by less.
    """
    rows = np.diff(np.append(starts, len(pieces)))
    mean = lambda values: np.add.reduceat(values, starts) / rows
    error = np.sqrt(mean(variance) / rows + mean(abscissa.error) ** 2)
    return error, [np.abs(curve_slopes(mean(abscissa.position), p.value, pieces[starts])) * error for p in points]


def is_raw_log(test: TestRecord, *, max_points: int = 600, log_rows: int = LOG_ROWS) -> bool:
    """Whether the rows are a logger's, not readings taken one by one: many, and many to each piece of the sweep.

    Below `log_rows` rows only where the position often stands still or steps back between rows, as a log's does.
    """
    if test.rows <= max_points or test.rows_of_log is not None:
        return False
    pieces, direction = monotone_pieces(test)
    per_piece = test.rows / (int(pieces[-1]) + 1)
    if float(np.mean(np.diff(sweep_axis(test)) * direction[1:] > 0)) < FORWARD:
        return per_piece >= ROWS_PER_PIECE
    return test.rows >= log_rows and per_piece >= (FORWARD_PER_PIECE if test.rows < ONE_BY_ONE else ROWS_PER_PIECE)


def _rates(time: np.ndarray, position: np.ndarray, pieces: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Speed of the sweep at each point, m/s, from the points' mean times and positions within the piece."""
    rows = np.diff(np.append(starts, len(time)))
    t, x = (np.add.reduceat(values, starts) / rows for values in (time, position))
    rate = np.zeros(len(starts))
    for start, stop in piece_bounds(pieces[starts]):
        if stop - start > 1 and np.all(np.diff(t[start:stop]) > 0):
            rate[start:stop] = np.gradient(x[start:stop], t[start:stop])
    return rate


def _what_was_done(test: TestRecord, pieces: np.ndarray, starts: np.ndarray) -> str:
    runs, count = len(np.unique(test.run)), int(pieces[-1]) + 1
    return (  # a user reads "leg", explained in the brackets
        f"{test.name}: {test.rows:,} rows -> {len(starts):,} points in bins along the sweep, separately for each of {count} "
        f"{'leg' if count == 1 else 'legs'} (run, direction and conditions) in {runs} {'run' if runs == 1 else 'runs'}; "
        "narrower bins where the curve is steep or bends"
    )


def _noise_note(test: TestRecord, channel: Channel, points: Points, rows: np.ndarray) -> str:
    unit = reading_unit(channel.name, channel.signal)
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
        if points.correlation.white:
            parts.append(f"{kept}; rows are independent of each other ({n:.0f} in a typical bin)")
        else:
            parts.append(
                f"{kept}; a bin of {n:.0f} rows counts as {worth:.1f} independent {'reading' if worth < 1.05 else 'readings'}"
            )
        pause = _memory(test, points)
        if pause:
            told = (
                "what neighbouring rows remember cannot be seen, taken for"
                if points.correlation.assumed
                else "neighbouring rows correlate over"
            )
            parts.append(f"{told} {pause}")
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
    if points.correlation.share < 0.1:
        return ""
    rows = points.correlation.memory
    if test.time is not None and (pace := float(np.median(np.diff(test.time)))) > 0:
        return f"{significant(rows * pace, 2)} s"
    return f"{rows:.0f} rows"


SHARE_OF_PIECE = 100  # rates are slopes over twice this share of a piece's rows, about as wide as a fit's bins


def smooth_sweep(test: TestRecord) -> TestRecord:
    """The test with direction and rate [m/s] of its smooth sweep, and of a raw log with the position (SI).

    A held position (load_flow with a load that sweeps) stays as logged; its load pressure is smoothed instead.
    """
    test = with_smooth_conditions(test)
    if test.in_motion or not is_raw_log(test):
        return as_measured(test)
    pieces, direction = monotone_pieces(test)
    axis = sweep_axis(test)
    abscissa = smooth_abscissa(axis, pieces)
    held = axis is not test.spool_position
    position = test.spool_position if held else abscissa.position
    rate = None if test.time is None else sweep_rates(test.time, position, pieces, abscissa.step)
    return replace(
        test,
        spool_position=position,
        load_pressure=abscissa.position if held else test.load_pressure,
        direction=direction.astype(test.direction.dtype),
        rate=rate,
    )


def sweep_rates(time: np.ndarray, position: np.ndarray, pieces: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Speed at each row (rows,), m/s: slopes of straight lines through position and time over a hundredth of the piece either
    side, or over as many rows as cross a few of the log's rounding `step`s (rows,)."""
    rate = np.zeros(len(time))
    for start, stop in piece_bounds(pieces):
        x, t, rows = position[start:stop], time[start:stop], stop - start
        if rows < 3 or np.ptp(x) == 0.0:
            continue
        pace = abs(float(x[-1] - x[0])) / rows
        across = STEPS_ACROSS * float(step[start:stop].max()) / (2.0 * pace) if pace > 0.0 else 0.0
        half = int(np.clip(max(across, rows / SHARE_OF_PIECE), 1, max(rows // 4, 1)))
        along, passed = local_line(x, half)[1], local_line(t, half)[1]
        rate[start:stop] = np.divide(along, passed, out=np.zeros(rows), where=passed > 0.0)
    return rate
