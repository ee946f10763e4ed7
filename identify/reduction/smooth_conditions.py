"""Recover the smooth course behind logged pressures and temperatures whose gauges scatter. NumPy and SciPy's laws only.

A supply of 70 bar that is logged with 0.05 bar of noise and in steps of 0.1 bar is not what the valve felt: a model that follows every
row of it misses every gauge that stands at the supply's pressure by that much, all readings of a row alike (docs/diagnosis.md section 2).
"""

from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .monotone_pieces import condition_ids, monotone_pieces, piece_bounds, sweep_axis
from .rounding import column_step
from .sweep_position import local_line


SMOOTHED = ("supply_pressure", "return_pressure", "temperature", "load_pressure")
SHOWN = {"supply_pressure": "supply pressure", "return_pressure": "return pressure", "load_pressure": "load pressure"}
FEWEST_ROWS = 12  # of a stretch: fewer do not show a course and a scatter about it
NARROWEST = 2  # rows either side
SMALLEST = 1e-9  # of the column's size: no scatter
# Readings follow a scatter where they go with it further than chance takes them in one record of a thousand.
FOLLOWED = 1e-3
BLOCKS, BLOCK_ROWS = 8, 40  # of a piece of the sweep, in each of which a reading may follow by another slope
LAGS = 6  # of third differences, beyond which those of white noise have nothing in common
HEAVY = 4.0  # standard deviations, beyond which a third difference is a bend or a bad row
RARELY = 0.2  # share of the rows at which a column without noise passes from one step of its rounding to the next
BACK_AND_FORTH = 0.1  # share of such passes that go back: noise flickers between two steps


def with_smooth_conditions(test: TestRecord) -> TestRecord:
    """The test with each logged condition on its smooth course, run by run, where the readings do not follow its scatter.

    By straight lines over as many rows around as predict a row that is left out best; a course that only rounding has broken
    into steps is joined up through the middles of its risers. Where readings do follow (ripple of a pump), and in a sweep's own
    axis, what was logged stays. `input_error` of the test says what is left of the scatter.
    """
    stretches = _stretches(test)
    axis = None if test.in_motion else sweep_axis(test)
    changed, errors, notes = {}, dict(test.input_error), list(test.notes)
    for name in SMOOTHED:
        column = getattr(test, name)
        if column is None or column is axis or np.ptp(column) == 0.0 or (name == "load_pressure" and test.in_motion):
            continue
        smooth, error = _courses(column, test.time, stretches)
        away = column - smooth
        scatter = float(np.sqrt(np.mean(away**2)))
        if scatter <= SMALLEST * max(float(np.max(np.abs(column))), 1e-300):
            continue
        if not test.in_motion and _readings_follow(test, away):
            notes.append(
                f"{test.name}: the readings follow the scatter of the {SHOWN.get(name, name)}, which is kept as logged"
            )
            continue
        changed[name], errors[name] = smooth, error
        unit = column_unit(name)
        size = f"{significant(scatter * unit.factor, 2)} {'K' if name == 'temperature' else unit.label}"
        notes.append(
            f"{test.name}: {SHOWN.get(name, name)} scatters by {size} about a smooth course, and the readings do not follow: taken "
            "for the gauge's noise"
        )
    return replace(test, **changed, input_error=errors, notes=tuple(notes)) if len(notes) > len(test.notes) else test


def _stretches(test: TestRecord) -> np.ndarray:
    """Number (rows,) of the stretch of one run and one set of conditions that each row belongs to."""
    cut = np.zeros(test.rows, dtype=bool)
    ids = test.run if test.in_motion else condition_ids(test)
    for one in (test.run, ids):
        cut[1:] |= one[1:] != one[:-1]
    return np.cumsum(cut)


def _courses(column: np.ndarray, time: np.ndarray | None, stretches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(smooth column, standard error of it), each (rows,), in the column's unit."""
    smooth, error = column.astype(float).copy(), np.zeros(len(column))
    step = column_step(column)
    for start, stop in piece_bounds(stretches):
        part = slice(start, stop)
        values = column[part]
        if stop - start < FEWEST_ROWS or np.ptp(values) == 0.0:
            error[part] = step / np.sqrt(12.0)
            continue
        if _only_rounded(values):
            smooth[part], error[part] = _joined(values), 0.5 * step / np.sqrt(12.0)
            continue
        along = None if time is None or not np.all(np.diff(time[part]) > 0.0) else time[part]
        smooth[part], error[part] = _best_lines(values, along)
    return smooth, error


def _best_lines(values: np.ndarray, along: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """The local lines that predict a row left out best, of windows that double up to the whole stretch; and their errors."""
    best, least = (values.astype(float), np.zeros(len(values))), np.inf
    half = NARROWEST
    while True:
        line, _, kept = local_line(values, half, along)
        away = values - line
        predicted = float(np.mean((away / np.maximum(kept, 1e-3)) ** 2))
        if predicted < least:
            variance = float(np.sum(away**2) / max(np.sum(kept), 1.0))
            best, least = (line, np.sqrt(variance * np.clip(1.0 - kept, 0.0, 1.0))), predicted
        if half >= len(values):
            return best
        half *= 2


def _only_rounded(values: np.ndarray) -> bool:
    """Whether a column stands still between steps and hardly ever goes back: no noise flickers between two of them."""
    change = np.diff(values)
    passes = change[change != 0.0]
    if not 0 < len(passes) < RARELY * len(change):
        return False
    return len(passes) < 2 or float(np.mean(passes[1:] * passes[:-1] < 0.0)) < BACK_AND_FORTH


def _joined(values: np.ndarray) -> np.ndarray:
    """A staircase joined up through the middles of its risers; before the first and behind the last one it stands still."""
    row = np.flatnonzero(np.diff(values))
    return np.interp(np.arange(len(values)), row + 0.5, 0.5 * (values[row] + values[row + 1]))


def _readings_follow(test: TestRecord, away: np.ndarray) -> bool:
    """Whether any reading goes with a condition's scatter `away` (rows,) about its course, by a slope that may differ along the sweep.

    Third differences from row to row of both, in blocks of rows; products of two series scatter by their autocorrelations.
    """
    pieces, _ = monotone_pieces(test)
    total, count = 0.0, 0
    for channel in test.channels:
        seen, moved = [], []
        for start, stop in piece_bounds(pieces):
            if stop - start < BLOCK_ROWS:
                continue
            rows = np.arange(float(stop - start))
            e, d = (divided_third(rows, values[start:stop]) for values in (channel.value, away))
            cuts = np.array_split(np.arange(len(e)), int(np.clip(len(e) // BLOCK_ROWS, 1, BLOCKS)))
            seen += [e[cut] for cut in cuts]
            moved += [d[cut] for cut in cuts]
        if not seen:
            continue
        size = np.array([np.sqrt(np.median(e**2) / MEDIAN_OF_CHI2) for e in seen])
        alike = [np.clip(e / s, -HEAVY, HEAVY) for e, s in zip(seen, size, strict=True) if s > 0.0]
        driven = [d for d, s in zip(moved, size, strict=True) if s > 0.0]
        rho = _autocorrelation(alike)
        for e, d in zip(alike, driven, strict=True):
            spread = sum(
                (2.0 if lag else 1.0) * rho[lag] * float(d[lag:] @ d[: len(d) - lag]) for lag in range(LAGS + 1)
            )
            if spread > 0.0:
                total, count = total + float(e @ d) ** 2 / spread / max(float(np.mean(e**2)), 1e-300), count + 1
    return count > 0 and float(chdtrc(count, total)) < FOLLOWED


def _autocorrelation(series: list[np.ndarray]) -> np.ndarray:
    """(LAGS + 1,) over all series together."""
    power = sum(float(e @ e) for e in series) or 1.0
    return np.array([sum(float(e[lag:] @ e[: len(e) - lag]) for e in series) / power for lag in range(LAGS + 1)])
