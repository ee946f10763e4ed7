"""Columns of typed terms in tests in motion: of a term that is in the machine, and of a whole table of laws beside it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from thermohyd.identify.bench.test_record import DynamicTest
from thermohyd.identify.model.places import place_of
from thermohyd.identify.model.term_variables import (
    DELAYED,
    IMPLICIT,
    REMEMBERED,
    SIGNALS,
    VARIABLES,
    asked_with,
    laws_in_motion,
    signal_of,
)
from thermohyd.identify.model.typed_terms import TypedTerm, basis, coefficients_of

from .motion_readings import DynamicSimulator, Weighing, readings_of
from .motion_term_runs import TermReadings, read_with_terms
from .motion_terms import COEFFICIENTS, Directions, acting, terms_in
from .uncertainty import Key


AT_ONCE = 128  # directions of one run of the table's program


@dataclass(frozen=True)
class Law:
    """One law of a variable at a place."""

    place: str
    variable: str
    law: str


# {signal: (least, greatest)} of what the runs went through, SI.
Ranges = Mapping[str, tuple[float, float]]


def rows_with_terms(
    simulator: DynamicSimulator,
    names: tuple[str, ...],
    effects: tuple[str, ...],
    weighing: Weighing,
    vector: np.ndarray,
    terms: tuple[TypedTerm, ...],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (m,), columns (entries, m) and columns of the terms' coefficients (4 per term, m), whitened, channel after channel."""
    found = read_with_terms(simulator, names, effects, vector, terms_in(terms), False)
    parts = []
    for key, test, reading in readings_of(simulator.tests):
        value, slopes = found.values[key] - reading, found.slopes[key]
        for number, term in enumerate(terms):
            shapes = _read_by(term.place, term.variable, term.law, key, found, test.rows, term.low, term.high)
            if shapes is None:
                continue
            value = value + shapes @ np.asarray(term.coefficients)
            first = len(vector) + COEFFICIENTS * number
            slopes[first : first + shapes.shape[1]] = shapes.T
        parts.append(_weighed(np.concatenate([value[None], slopes]), key, weighing))
    rows = np.concatenate(parts, axis=1)
    return rows[0], rows[1 : 1 + len(vector)], rows[1 + len(vector) :]


def predicted_with_terms(
    simulator: DynamicSimulator,
    names: tuple[str, ...],
    effects: tuple[str, ...],
    vector: np.ndarray,
    terms: tuple[TypedTerm, ...],
) -> tuple[TermReadings, dict[Key, list[np.ndarray]]]:
    """(readings with derivatives to the vector; of each channel and term the derivatives (coefficients, rows)), SI, every channel."""
    found = read_with_terms(simulator, names, effects, vector, terms_in(terms), False)
    values, slopes, of_terms = {}, {}, {}
    for key, value in found.values.items():
        test, own = simulator.tests[key[0]], []
        for number, term in enumerate(terms):
            first, count = len(vector) + COEFFICIENTS * number, len(term.coefficients)
            of_term = found.slopes[key][first : first + count]
            shapes = _read_by(term.place, term.variable, term.law, key, found, test.rows, term.low, term.high)
            if shapes is not None:
                value = value + shapes @ np.asarray(term.coefficients)
                of_term = shapes.T
            own.append(of_term)
        values[key], slopes[key], of_terms[key] = value, found.slopes[key][: len(vector)], own
    return TermReadings(values, slopes, found.signals, found.failure), of_terms


def _weighed(rows: np.ndarray, key: Key, weighing: Weighing) -> np.ndarray:
    weight = weighing.weight[key]
    rows = np.where(weight > 0.0, rows * weight, 0.0)  # a masked row may hold NaN
    return rows if weighing.whiten is None else weighing.whiten(key, rows)


def _read_by(
    place: str, variable: str, law: str, key: Key, found: TermReadings, rows: int, low: float, high: float
) -> np.ndarray | None:
    """(rows, coefficients): what a law of a reading adds to a channel's rows; None of other places and channels."""
    where = place_of(place, moving=True)
    if key[1] not in where.readings or key[0] not in found.signals:
        return None
    values = found.signals[key[0]][:, SIGNALS.index(signal_of(where, "", variable))]
    return basis(law, values, low, high)


def columns_of_laws(
    simulator: DynamicSimulator,
    names: tuple[str, ...],
    effects: tuple[str, ...],
    weighing: Weighing,
    vector: np.ndarray,
    laws: tuple[Law, ...],
) -> tuple[list[np.ndarray], Ranges]:
    """Of each law its columns (rows, coefficients), whitened, at coefficients of 0; and the signals' ranges.

    A constant, and what is one law's only up to a sum, is integrated once: every direction that any law needs.
    """
    # The program of the fits that follow, with a term that does nothing.
    nothing = TypedTerm("force_on_piston", "constant", "constant", (0.0,), 1.0, 1.0, moving=True)
    seen = read_with_terms(simulator, names, effects, vector, terms_in((nothing,)), False)
    ranges = _ranges(simulator, seen)
    if not ranges:
        return [np.zeros((sum(len(reading) for _, _, reading in readings_of(simulator.tests)), 0)) for _ in laws], {}
    low, high = (np.array([ranges[name][i] for name in SIGNALS]) for i in (0, 1))
    rows = [acting(one.place, one.variable, one.law) for one in laws]
    flat = np.concatenate(rows)
    directions, of = np.unique(flat, axis=0, return_inverse=True)
    of = of.reshape(-1)
    slopes: dict[Key, list[np.ndarray]] = {}
    for part in _chunks(directions):
        terms = Directions(jnp.zeros(AT_ONCE), jnp.asarray(part), jnp.asarray(low), jnp.asarray(high))
        found = read_with_terms(simulator, names, effects, vector, terms, True)
        for key, _, _ in readings_of(simulator.tests):
            slopes.setdefault(key, []).append(found.slopes[key])
    columns, first = [], 0
    whole = {key: np.concatenate(parts) for key, parts in slopes.items()}
    for one in laws:
        count = coefficients_of(one.law)
        own, parts = of[first : first + count], []
        first += count
        where = place_of(one.place, moving=True)
        ends = ranges_of(one.place, one.variable, ranges)
        for key, test, _ in readings_of(simulator.tests):
            if where.moving:
                block = whole[key][own]
            else:
                shapes = _read_by(one.place, one.variable, one.law, key, seen, test.rows, *ends)
                block = np.zeros((count, test.rows)) if shapes is None else shapes.T
            parts.append(_weighed(block, key, weighing))
        columns.append(np.concatenate(parts, axis=1).T)
    return columns, ranges


def _ranges(simulator: DynamicSimulator, seen: TermReadings) -> Ranges:
    """Of all signals, and of how fast the pressures and the command change; both chambers share theirs. Empty without a step test."""
    every = [signals[np.isfinite(signals).all(axis=1)] for signals in seen.signals.values()]
    every = np.concatenate(every) if every else np.zeros((0, len(SIGNALS)))
    if not len(every):
        return {}
    found: dict[str, tuple[float, float]] = dict(
        zip(SIGNALS, zip(every.min(axis=0).tolist(), every.max(axis=0).tolist(), strict=True), strict=True)
    )
    for a, b in (("pressure_a", "pressure_b"), ("drop_a", "drop_b"), ("warming_a", "warming_b")):
        found[a] = found[b] = (min(found[a][0], found[b][0]), max(found[a][1], found[b][1]))
    # The run that was seen keeps no memory.
    found[REMEMBERED] = (-1.0, 1.0) if found["rate"][0] < found["rate"][1] else (0.0, 0.0)
    rates: dict[str, list[float]] = {IMPLICIT: [0.0], DELAYED: [0.0]}
    for name, test in simulator.tests.items():
        travel = _in_metres(simulator, test)
        for run in np.unique(test.run) if name in seen.signals else ():
            rows = np.flatnonzero(test.run == run)
            assert test.time is not None
            passing = np.diff(test.time[rows])
            rates[DELAYED] += [*(np.diff(travel[rows]) / passing)]
            for port in ("pressure_a", "pressure_b"):
                rates[IMPLICIT] += [*(np.diff(seen.values[name, port][rows]) / passing)]
    ends = {name: [rate for rate in own if np.isfinite(rate)] for name, own in rates.items()}
    return {**found, **{name: (float(min(own)), float(max(own))) for name, own in ends.items()}}


def _in_metres(simulator: DynamicSimulator, test: DynamicTest) -> np.ndarray:
    """(rows,): a test's command as a setpoint or a position, a current as the travel that it asks for."""
    if test.command_kind != "current":
        return test.command
    return simulator.polarity * test.command * float(simulator.valve.stroke) / float(simulator.actuator.rated_current)


def ranges_of(place: str, variable: str, ranges: Ranges) -> tuple[float, float]:
    """Where a variable was: of a place with several parts, over all of them."""
    if variable in (IMPLICIT, DELAYED):
        return ranges[variable]
    where = place_of(place, moving=True)
    ends = [ranges[signal_of(where, moved, variable)] for moved in where.moving or ("",)]
    return min(low for low, _ in ends), max(high for _, high in ends)


def laws_of(place: str) -> Iterator[Law]:
    """Every law that a place is asked with in motion."""
    where = place_of(place, moving=True)
    for variable in VARIABLES.values():
        for law in laws_in_motion(variable) if asked_with(where, variable, moving=True) else ():
            yield Law(place, variable.name, law)


def _chunks(directions: np.ndarray) -> Iterator[np.ndarray]:
    for first in range(0, len(directions), AT_ONCE):
        part = directions[first : first + AT_ONCE]
        yield np.concatenate([part, np.zeros((AT_ONCE - len(part), part.shape[1]))])
