"""Recover the smooth course behind logged pressures and temperatures whose gauges scatter. NumPy only.

A supply of 70 bar that is logged with 0.05 bar of noise and in steps of 0.1 bar is not what the valve felt: a model that follows every
row of it misses every gauge that stands at the supply's pressure by that much, all readings of a row alike (docs/diagnosis.md section 2).
"""

from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.noise.correlation import Sums
from thermohyd.identify.noise.level import MEDIAN_OF_CHI2, divided_third

from .monotone_pieces import (
    condition_stretches,
    monotone_pieces,
    moving_mean,
    piece_bounds,
    running_medians,
    sweep_axis,
)
from .rounding import column_step, joined_steps
from .sweep_position import local_line


SMOOTHED = ("supply_pressure", "return_pressure", "temperature", "load_pressure")
SHOWN = {"supply_pressure": "supply pressure", "return_pressure": "return pressure", "load_pressure": "load pressure"}
FEWEST_ROWS = 12  # of a stretch: fewer do not show a course and a scatter about it
NARROWEST = 2  # rows either side
SMALLEST = 1e-9  # of the column's size: no scatter
# Of what goes with the pressure across the valve (a saturated port's pressure; of a flow half of it), and of an oil's flow per kelvin: a
# reading follows from this share on, where the share is known to so much.
WITH_TEMPERATURE = 0.02
FOLLOWED, KNOWN = 0.3, 0.15
CHANCE = 3.0  # standard errors of a share that is told from none
STRETCH, LEAST_SIZE = 50, 0.1  # rows of about one slope and bend; least scatter of such, in that of all
LAGS = 6  # of third differences, beyond which those of white noise have nothing in common
HEAVY = 4.0  # standard deviations, beyond which a third difference is a bend or a bad row
RARELY = 0.2  # share of the rows at which a column without noise passes from one step of its rounding to the next
# Turns of a course, and share of such passes, up to which it goes back: noise flickers between two steps.
TURNS, BACK_AND_FORTH = 4, 0.1


def with_smooth_conditions(test: TestRecord) -> TestRecord:
    """The test with each logged condition on its smooth course, run by run, where the readings do not follow its scatter.

    By straight lines over as many rows around as predict a row that is left out best; a course that only rounding has broken
    into steps is joined up through the middles of its risers. Where readings do follow (ripple of a pump) or would hardly show it, in a
    sweep's own axis and in motion, what was logged stays. `input_error` of the test says what is left of the scatter.
    """
    if test.in_motion:
        return test
    stretches, axis = condition_stretches(test), sweep_axis(test)
    pieces = None  # a log of 100,000 rows takes a while to cut
    changed, errors, notes = {}, dict(test.input_error), list(test.notes)
    for name in SMOOTHED:
        column = getattr(test, name)
        if column is None or column is axis or np.ptp(column) == 0.0:
            continue
        smooth, error, joined = _courses(column, test.time, stretches)
        away = column - smooth
        scatter = float(np.sqrt(np.mean(away**2)))
        if scatter <= SMALLEST * max(float(np.max(np.abs(column))), 1e-300):
            continue
        # What only rounding has made no reading can follow.
        noisy = np.where(joined, 0.0, away)
        if noisy.any() and pieces is None:
            pieces, _ = monotone_pieces(test)
        followed = False if pieces is None or not noisy.any() else _follows(test, name, noisy, pieces)
        if followed is not False:
            kept = (
                f"{test.name}: the readings follow the scatter of the {SHOWN.get(name, name)}, which is kept as logged"
            )
            notes += [kept] if followed else []
            continue
        changed[name], errors[name] = smooth, error
        unit = column_unit(name)
        size = f"{significant(scatter * unit.factor, 2)} {'K' if name == 'temperature' else unit.label}"
        notes.append(
            f"{test.name}: {SHOWN.get(name, name)} scatters by {size} about a smooth course, and the readings do not follow: taken "
            "for the gauge's noise"
        )
    return replace(test, **changed, input_error=errors, notes=tuple(notes)) if len(notes) > len(test.notes) else test


def _courses(
    column: np.ndarray, time: np.ndarray | None, stretches: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(smooth column, standard error of it, whether it was only joined up), each (rows,), in the column's unit."""
    smooth, error, joined = column.astype(float).copy(), np.zeros(len(column)), np.zeros(len(column), dtype=bool)
    step = column_step(column)
    for start, stop in piece_bounds(stretches):
        part = slice(start, stop)
        values = column[part]
        if stop - start < FEWEST_ROWS or np.ptp(values) == 0.0:
            error[part] = step / np.sqrt(12.0)
            continue
        if _only_rounded(values):
            smooth[part], error[part], joined[part] = joined_steps(values), 0.5 * step / np.sqrt(12.0), True
            continue
        along = None if time is None or not np.all(np.diff(time[part]) > 0.0) else time[part]
        smooth[part], error[part] = _best_lines(values, along)
    return smooth, error, joined


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
    return int(np.sum(passes[1:] * passes[:-1] < 0.0)) <= max(TURNS, BACK_AND_FORTH * len(passes))


def _follows(test: TestRecord, name: str, away: np.ndarray, pieces: np.ndarray) -> bool | None:
    """Whether the readings go with a condition's scatter `away` (rows,) about its course, as much as such readings do; None: where they
    would hardly show it."""
    supply = np.maximum(test.supply_pressure - test.return_pressure, 1.0)
    per_unit = np.full(test.rows, WITH_TEMPERATURE) if name == "temperature" else 1.0 / supply
    driven = []
    for channel in test.channels:
        level = np.zeros(test.rows)
        for start, stop in piece_bounds(pieces):
            level[start:stop] = running_medians(channel.value[start:stop])
        driven.append(level * per_unit * away)
    share, error = _share_followed([channel.value for channel in test.channels], driven, pieces)
    return None if error > KNOWN else share > FOLLOWED


def followed(values: list[np.ndarray], driven: list[np.ndarray], pieces: np.ndarray) -> float:
    """Share, 0..1, of what a shaken input would make of readings (rows,) each, `driven`, that they follow; 0 where they do not show it."""
    share, error = _share_followed(values, driven, pieces)
    return min(share, 1.0) if share > CHANCE * error else 0.0


def _share_followed(values: list[np.ndarray], driven: list[np.ndarray], pieces: np.ndarray) -> tuple[float, float]:
    """By how much of `driven` readings go from row to row, and the standard error of it; by third differences of both.

    Products of two series scatter by their autocorrelations.
    """
    product, power, spread = 0.0, 0.0, 0.0
    for value, drive in zip(values, driven, strict=True):
        cuts = []
        for start, stop in piece_bounds(pieces):
            if stop - start < FEWEST_ROWS:
                continue
            rows = np.arange(float(stop - start))
            e, d = divided_third(rows, value[start:stop]), divided_third(rows, drive[start:stop])
            # A bend of the curve is no noise: each stretch has a size of its own.
            for cut in np.array_split(np.arange(len(e)), max(3, len(e) // STRETCH)):
                size = float(np.sqrt(np.median(e[cut] ** 2) / MEDIAN_OF_CHI2))
                cuts.append((size, e[cut], d[cut], np.sqrt(np.maximum(moving_mean(d[cut] ** 2, LAGS), 0.0))))
        # Readings that stand still between steps of their rounding scatter by nothing, most of the time.
        least = LEAST_SIZE * float(np.sqrt(np.mean([np.mean(e**2) for _, e, *_ in cuts]))) if cuts else 0.0
        # Of a steep place among flat ones, what the input would make of it is part of its size.
        cuts = [(np.hypot(max(size, least), own), e, d) for size, e, d, own in cuts if len(e) > LAGS]
        cuts = [(size, e, d) for size, e, d in cuts if np.all(size > 0.0)]
        seen = [np.clip(e / size, -HEAVY, HEAVY) for size, e, _ in cuts]
        shaken = [d / size for size, _, d in cuts]
        sums = Sums.of(seen, LAGS).products
        rho = sums / max(float(sums[0]), 1e-300) * np.append(1.0, np.full(LAGS, 2.0))  # a lag counts both ways
        for e, d in zip(seen, shaken, strict=True):
            product += float(e @ d)
            power += float(d @ d)
            alike = float(rho @ Sums.of([d], LAGS).products)
            spread += max(alike, 0.0) * float(np.mean(e**2))
    return (product / power, float(np.sqrt(spread)) / power) if power > 0.0 else (0.0, np.inf)
