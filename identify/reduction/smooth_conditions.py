"""Recover the smooth course behind logged pressures, temperatures and commands whose gauges scatter. NumPy only.

A supply of 70 bar that is logged with 0.05 bar of noise and in steps of 0.1 bar is not what the valve felt: a model that follows every
row of it misses every gauge that stands at the supply's pressure by that much, all readings of a row alike (docs/diagnosis.md section 2).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.noise.correlation import Sums, recursion
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .monotone_pieces import (
    condition_stretches,
    monotone_pieces,
    moving_mean,
    piece_bounds,
    run_ids,
    running_medians,
    sweep_axis,
)
from .rounding import column_step, joined_steps
from .sweep_position import local_line


SMOOTHED = ("supply_pressure", "return_pressure", "temperature", "load_pressure", "external_force", "command")
SHOWN = {
    "supply_pressure": "supply pressure",
    "return_pressure": "return pressure",
    "load_pressure": "load pressure",
    "external_force": "external force",
}
FEWEST_ROWS = 12  # of a stretch: fewer do not show a course and a scatter about it
FEWEST_OF_HOLD = 6  # between two edges, where the scatter is known
NARROWEST = 2  # rows either side
SMALLEST = 1e-9  # of the column's size: no scatter
# Of what goes with the pressure across the valve (a saturated port's pressure; of a flow half of it), and of an oil's flow per kelvin: a
# reading follows from this share on, where the share is known to so much.
WITH_TEMPERATURE = 0.02
FOLLOWED, KNOWN = 0.3, 0.15
CHANCE = 3.0  # standard errors of a share that is told from none
STRETCH, LEAST_SIZE = 50, 0.1  # rows of about one slope and bend; least scatter of such, in that of all
LAGS = 6  # of differences from row to row, beyond which those of white noise have nothing in common
HEAVY = 4.0  # standard deviations, beyond which a third difference is a bend, an edge or a bad row
RARELY = 0.2  # share of the rows at which a column without noise passes from one step of its rounding to the next
# Turns of a course, and share of such passes, up to which it goes back: noise flickers between two steps.
TURNS, BACK_AND_FORTH = 4, 0.1
# What drives a machine in motion, which readings follow as they follow its edges, behind first-order lags of so many rows.
DRIVES, LAGGED, KNOWN_OF_DRIVES = ("command", "external_force"), (0, 1, 2, 4, 8, 16, 32), 0.2
WHITE = 2.0  # ratio of variances, about a course and of third differences, up to which a scatter is noise and no motion
SMALL = 0.01  # of a command's travel: noise; beyond it a command may well be meant so


def with_smooth_conditions[Test: TestRecord](test: Test) -> Test:
    """The test with each logged condition on its smooth course, run by run, where the readings do not follow its scatter.

    By straight lines over as many rows around as predict a row that is left out best; a course that only rounding has broken
    into steps is joined up through the middles of its risers. Where readings do follow (ripple of a pump) or would hardly show it, and in a
    sweep's own axis, what was logged stays. In motion so does every scatter that is not white, and every edge; a command goes to its
    course only where its scatter is small, too; and each run begins, in equilibrium, under the course. `input_error` of the test says what
    is left of the scatter.
    """
    if test.axis == "frequency":
        return test
    alike, axis = None if test.in_motion else condition_stretches(test), sweep_axis(test)
    pieces = run_ids(test) if test.in_motion else None  # a log of 100,000 rows takes a while to cut
    changed, errors, notes = {}, dict(test.input_error), list(test.notes)
    for name in SMOOTHED:
        column = getattr(test, name, None)
        if column is None or column is axis or np.ptp(column) == 0.0:
            continue
        stretches, calm, noise = (alike, None, None) if alike is not None else _between_edges(column, test.run)
        smooth, error, joined = _courses(column, test.time, stretches, calm)
        if name in DRIVES:
            smooth = np.where(joined, column, smooth)  # its steps are those of whoever made it
        away = column - smooth
        scatter = float(np.sqrt(np.mean(away**2)))
        if scatter <= SMALLEST * max(float(np.max(np.abs(column))), 1e-300):
            continue
        # What only rounding has made no reading can follow.
        noisy = np.where(joined, 0.0, away)
        if calm is not None and noise is not None and not _is_noise(name, noisy[calm], noise[calm], column):
            continue
        if noisy.any() and pieces is None:
            pieces, _ = monotone_pieces(test)
        followed = False if pieces is None or not noisy.any() else _follows(test, name, noisy, pieces)
        # Chambers hardly pass on what scatters from row to row, but a run that starts under it misses all of its rows.
        if followed or (followed is None and (not test.in_motion or name in DRIVES)):
            kept = (
                f"{test.name}: the readings follow the scatter of the {SHOWN.get(name, name)}, which is kept as logged"
            )
            notes += [kept] if followed else []
            if test.in_motion:
                changed[name] = np.where(np.append(True, test.run[1:] != test.run[:-1]), smooth, column)
            continue
        changed[name], errors[name] = smooth, error
        shown = "and the readings do not follow" if followed is False else "which readings in motion hardly show"
        notes.append(
            f"{test.name}: {SHOWN.get(name, name)} scatters by {_size(test, name, scatter)} about a smooth course, {shown}: taken for "
            "the gauge's noise"
        )
    return (
        replace(test, **changed, input_error=errors, notes=tuple(notes))
        if changed or len(notes) > len(test.notes)
        else test
    )


def _size(test: TestRecord, name: str, scatter: float) -> str:
    unit = column_unit(getattr(test, "command_kind", name) if name == "command" else name)
    return f"{significant(scatter * unit.factor, 2)} {'K' if name == 'temperature' else unit.label}"


def _between_edges(column: np.ndarray, run: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(number of the stretch between two edges, whether none is left inside it, noise by third differences), each (rows,), of a column in
    motion. Four rows beside each other that lie apart by more than noise and rounding have an edge where they jump."""
    ids, calm, noise = np.zeros(len(column), dtype=int), np.zeros(len(column), dtype=bool), np.zeros(len(column))
    step, last = column_step(column - column[0]), 0
    bent = lambda values: np.abs(divided_third(np.arange(float(len(values))), values))
    for start, stop in piece_bounds(run):
        values = column[start:stop]
        cut = np.zeros(stop - start, dtype=bool)
        if stop - start >= FEWEST_ROWS:
            e = bent(values)
            size = np.hypot(np.sqrt(np.median(e**2) / MEDIAN_OF_CHI2), step / np.sqrt(12.0))
            near, noise[start:stop] = np.convolve(e > HEAVY * size + step, np.ones(4)) > 0.0, size
            cut[1:] = near[1:] & near[:-1] & (np.abs(np.diff(values)) > HEAVY * np.sqrt(2.0) * size)
        ids[start:stop] = last + 1 + np.cumsum(cut)
        last = int(ids[stop - 1])
    for start, stop in piece_bounds(ids):
        if stop - start >= FEWEST_OF_HOLD:
            calm[start:stop] = bool(np.all(bent(column[start:stop]) <= HEAVY * noise[start] + step))
    return ids, calm, noise


def _is_noise(name: str, away: np.ndarray, noise: np.ndarray, column: np.ndarray) -> bool:
    """Whether what lies about the course is as white as noise is, and of a command small beside its travel."""
    ratio = float(np.mean(away**2) / max(float(np.mean(noise**2)), 1e-300)) if len(away) else np.inf
    small = name != "command" or bool(np.all(noise <= SMALL * np.ptp(column)))
    return small and (not away.any() or 1.0 / WHITE < ratio < WHITE)


def _courses(
    column: np.ndarray, time: np.ndarray | None, stretches: np.ndarray, calm: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(smooth column, standard error of it, whether it was only joined up), each (rows,), in the column's unit."""
    smooth, error, joined = column.astype(float).copy(), np.zeros(len(column)), np.zeros(len(column), dtype=bool)
    step = column_step(column - column[0])
    for start, stop in piece_bounds(stretches):
        part = slice(start, stop)
        values = column[part]
        if not (stop - start >= FEWEST_ROWS if calm is None else calm[start]) or np.ptp(values) == 0.0:
            error[part] = step / np.sqrt(12.0)
            continue
        if _only_rounded(values):
            smooth[part], error[part], joined[part] = joined_steps(values), 0.5 * step / np.sqrt(12.0), True
            continue
        along = None if time is None or not np.all(np.diff(time[part]) > 0.0) else time[part]
        smooth[part], error[part] = _best_lines(values, along)
    return smooth, error, joined


def _best_lines(values: np.ndarray, along: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The mean or local lines that predict a row left out best, of windows that double up to the whole stretch; and their errors.

    The widest that is worse by no more than one standard error: of ten rows chance would choose."""
    n = len(values)
    halves = [NARROWEST]
    while halves[-1] < n:
        halves.append(2 * halves[-1])

    def lines(half: int | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Line, share of a row's noise that is left in its distance, and squared error of its prediction; half: None, the mean."""
        line, kept = np.full(n, values.mean()), np.full(n, 1.0 - 1.0 / n)
        if half is not None:
            line, _, kept = local_line(values, half, along)
        return line, kept, ((values - line) / np.maximum(kept, 1e-3)) ** 2

    widths = [*halves, None]  # of a log of 100,000 rows no two are kept
    least = lines(min(widths, key=lambda half: float(np.mean(lines(half)[2]))))[2]
    worse = (lines(half)[2] - least for half in reversed(widths))
    chosen = next(i for i, w in enumerate(worse) if np.mean(w) <= np.std(w) / np.sqrt(n))
    line, kept, _ = lines(widths[-1 - chosen])
    variance = float(np.sum((values - line) ** 2) / max(np.sum(kept), 1.0))
    return line, np.sqrt(variance * np.clip(1.0 - kept, 0.0, 1.0))


def _only_rounded(values: np.ndarray) -> bool:
    """Whether a column stands still between steps and hardly ever goes back: no noise flickers between two of them."""
    change = np.diff(values)
    passes = change[change != 0.0]
    if not 0 < len(passes) < RARELY * len(change):
        return False
    return int(np.sum(passes[1:] * passes[:-1] < 0.0)) <= max(TURNS, BACK_AND_FORTH * len(passes))


def _follows(test: TestRecord, name: str, away: np.ndarray, pieces: np.ndarray) -> bool | None:
    """Whether the readings go with a condition's scatter `away` (rows,) about its course, as much as such readings do; None: where they
    would hardly show it."""
    if name in DRIVES:
        return _answer(_as_to_edges(test, name, away, pieces), KNOWN_OF_DRIVES)
    return _answer(_in_proportion(test, name, away, pieces), KNOWN)


Differences = tuple[list[np.ndarray], list[np.ndarray]]


def followed(values: list[np.ndarray], driven: list[np.ndarray], pieces: np.ndarray) -> float:
    """Share, 0..1, of what a shaken input would make of readings (rows,) each, `driven`, that they follow; 0 where they do not show it."""
    share, error = _share(_third_differences(v, d, pieces) for v, d in zip(values, driven, strict=True))
    return min(share, 1.0) if share > CHANCE * error else 0.0


def _answer(channels: Iterator[Differences], known: float) -> bool | None:
    """Whether what is seen of each channel goes with what drives it; None: where they would hardly show it."""
    share, error = _share(channels)
    return None if error > known else share > FOLLOWED


def _share(channels: Iterator[Differences]) -> tuple[float, float]:
    """By how much what is seen of each channel goes with what drives it, piece by piece, in units of its scatter, and the standard error
    of it; products of two series scatter by their autocorrelations."""
    product, power, spread = 0.0, 0.0, 0.0
    for seen, driven in channels:
        sums = Sums.of(seen, LAGS).products
        rho = sums / max(float(sums[0]), 1e-300) * np.append(1.0, np.full(LAGS, 2.0))  # a lag counts both ways
        for e, d in zip(seen, driven, strict=True):
            product += float(e @ d)
            power += float(d @ d)
            alike = float(rho @ Sums.of([d], LAGS).products)
            spread += max(alike, 0.0) * float(np.mean(e**2))
    return (product / power, float(np.sqrt(spread)) / power) if power > 0.0 else (0.0, np.inf)


def _in_proportion(test: TestRecord, name: str, away: np.ndarray, pieces: np.ndarray) -> Iterator[Differences]:
    """Third differences of each reading, and of what it would be if it went with the pressure across the valve, or with the oil."""
    supply = np.maximum(test.supply_pressure - test.return_pressure, 1.0)
    per_unit = np.full(test.rows, WITH_TEMPERATURE) if name == "temperature" else 1.0 / supply
    for channel in test.channels:
        if test.in_motion and "pressure" not in channel.name:
            continue
        level = np.zeros(test.rows)
        for start, stop in piece_bounds(pieces):
            level[start:stop] = running_medians(channel.value[start:stop])
        yield _third_differences(channel.value, level * per_unit * away, pieces)


def _third_differences(value: np.ndarray, drive: np.ndarray, pieces: np.ndarray) -> Differences:
    """Those of a reading, and of what an input's scatter would make of it, stretch by stretch, in units of their own scatter."""
    cuts = []
    for start, stop in piece_bounds(pieces):
        if stop - start < FEWEST_ROWS:
            continue
        rows = np.arange(float(stop - start))
        e, d = divided_third(rows, value[start:stop]), divided_third(rows, drive[start:stop])
        # A bend of the curve is no noise: each stretch has a size of its own.
        for cut in np.array_split(np.arange(len(e)), max(3, len(e) // STRETCH)):
            if len(cut) > LAGS:
                size = float(np.sqrt(np.median(e[cut] ** 2) / MEDIAN_OF_CHI2))
                cuts.append((size, e[cut], d[cut], np.sqrt(np.maximum(moving_mean(d[cut] ** 2, LAGS), 0.0))))
    # Readings that stand still between steps of their rounding scatter by nothing, most of the time.
    least = LEAST_SIZE * float(np.sqrt(np.mean([np.mean(e**2) for _, e, *_ in cuts]))) if cuts else 0.0
    # Of a steep place among flat ones, what the input would make of it is part of its size.
    sized = [(np.hypot(max(size, least), own), e, d) for size, e, d, own in cuts]
    sized = [(size, e, d) for size, e, d in sized if np.all(size > 0.0)]
    return [np.clip(e / size, -HEAVY, HEAVY) for size, e, _ in sized], [d / size for size, _, d in sized]


def _as_to_edges(test: TestRecord, name: str, away: np.ndarray, pieces: np.ndarray) -> Iterator[Differences]:
    """Differences of each reading from what lags of the smooth column make of it, by least squares over its edges, and what the same
    would make of the scatter."""
    course = getattr(test, name) - away
    runs = [slice(*bounds) for bounds in piece_bounds(pieces) if bounds[1] - bounds[0] >= FEWEST_ROWS]
    behind = lambda values: [np.stack([np.diff(_lagged(values[run], lag)) for lag in LAGGED], axis=1) for run in runs]
    made_of, noise = behind(course), behind(away)
    for channel in test.channels if runs else ():
        seen = [np.diff(channel.value[run]) for run in runs]
        weights = np.linalg.lstsq(np.concatenate(made_of), np.concatenate(seen), rcond=None)[0]
        rest = [e - columns @ weights for e, columns in zip(seen, made_of, strict=True)]
        size = np.sqrt(np.median(np.concatenate(rest) ** 2) / MEDIAN_OF_CHI2)
        if size > 0.0:
            yield [np.clip(e / size, -HEAVY, HEAVY) for e in rest], [columns @ weights / size for columns in noise]


def _lagged(values: np.ndarray, rows: int) -> np.ndarray:
    """A column behind a first-order lag of so many rows, at rest where it starts."""
    keep = np.exp(-1.0 / rows) if rows else 0.0
    return recursion(keep, (1.0 - keep) * (values - values[0])) + values[0]
