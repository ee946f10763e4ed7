"""Which rows of a record lie outside what a model was fitted to, beyond the stroke, or beyond what is known of the oil. No JAX."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import DisplayUnit, significant
from thermohyd.identify.bench.test_record import TestRecord, is_dynamic
from thermohyd.identify.reduction.monotone_pieces import PRESSURE_STEP, TEMPERATURE_STEP

from .model import Model, Ranges


COLUMN = "outside_fitted_range"
STANDS_FOR = (
    "the standard deviations are those of the parameters only: they do not grow where the model was never fitted"
)
SAME = 0.01  # of the stroke, of the supply pressure: as far outside as a sweep that was set alike
MOST_STRETCHES = 4  # listed in a sentence
OIL, STROKE = "oil_temperature", "stroke"
QUANTITIES = (
    "spool_position", "supply_pressure", "return_pressure", "load_pressure", "temperature", "setpoint", "current",
    "frequency",
)  # fmt: skip


@dataclass(frozen=True)
class Outside:
    """Rows of one test that lie outside, by one quantity (SI).

    quantity: a column, "stroke" (a position beyond it) or "oil_temperature" (beyond what is known of the oil's viscosity).
    rows: (rows,) True where outside. lines: of the rows in their file, else counted from 1. found, allowed: [least,
    greatest] of those rows, and what would be inside.
    """

    test: str
    quantity: str
    rows: np.ndarray
    lines: np.ndarray
    found: tuple[float, float]
    allowed: tuple[float, float]

    @property
    def unit(self) -> DisplayUnit:
        return column_unit(self.quantity)

    @property
    def stretches(self) -> list[tuple[int, int]]:
        """First and last line of each stretch of neighbouring rows."""
        edges = np.flatnonzero(np.diff(np.concatenate([[0], self.rows.astype(int), [0]])))
        return [(int(self.lines[a]), int(self.lines[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def ranges_of(tests: Mapping[str, TestRecord]) -> Ranges:
    """{test: {quantity: (least, greatest)}} over the rows of each test, SI."""
    return {
        test.name: {
            name: (float(np.min(a)), float(np.max(a))) for name, a in test.conditions.items() if name in QUANTITIES
        }
        for test in tests.values()
        if test.rows
    }


def outside(model: Model, record: BenchRecord) -> list[Outside]:
    """What lies outside, test by test; ranges only where the model holds those of its fit. `model`: as in the record."""
    return [entry for test in record.tests.values() for entry in _of_test(model, test)]


def _of_test(model: Model, test: TestRecord) -> Iterator[Outside]:
    lines = np.arange(1, test.rows + 1) if test.lines is None else test.lines
    columns = test.conditions
    ranges = fitted_ranges(model, test)
    size = max(abs(end) for end in ranges.get("supply_pressure", (0.0, 0.0)))
    for name, column in columns.items():
        if name not in ranges:
            continue
        low, high = ranges[name]
        reach = {"temperature": TEMPERATURE_STEP, "spool_position": SAME * model.valve.stroke}
        slack = reach.get(name, PRESSURE_STEP * size if name.endswith("pressure") else SAME * max(abs(low), abs(high)))
        yield from _beyond(test, name, column, (low, high), slack, lines)
    if "spool_position" in columns:
        far = (-model.valve.stroke, model.valve.stroke)
        yield from _beyond(test, STROKE, columns["spool_position"], far, SAME * far[1], lines)
    if model.oil.coldest is not None and model.oil.hottest is not None:
        known = (model.oil.coldest, model.oil.hottest)
        yield from _beyond(test, OIL, test.temperature, known, TEMPERATURE_STEP, lines)


def fitted_ranges(model: Model, test: TestRecord) -> dict[str, tuple[float, float]]:
    """Of the same test; of all tests of its kind together where none of its name was fitted."""
    if test.name in model.fitted:
        return model.fitted[test.name]
    alike = [model.fitted[name] for name in tests_alike(model, test)]
    names = {name for ranges in alike for name in ranges} - {"frequency"}
    joined = {name: [ranges[name] for ranges in alike if name in ranges] for name in names}
    return {name: (min(low for low, _ in ends), max(high for _, high in ends)) for name, ends in joined.items()}


def static_range(model: Model, quantity: str) -> tuple[float, float] | None:
    """(least, greatest) of a condition over the static tests that a model was fitted to, SI; None where nobody says."""
    ends = [ranges[quantity] for test, ranges in model.fitted.items() if quantity in ranges and not is_dynamic(test)]
    return (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None


def tests_alike(model: Model, test: TestRecord) -> list[str]:
    """Fitted tests that are static like this one, or dynamic like it."""
    dynamic = test.in_motion
    return [name for name in model.fitted if is_dynamic(name) == dynamic]


def _beyond(
    test: TestRecord,
    quantity: str,
    column: np.ndarray,
    allowed: tuple[float, float],
    slack: float,
    lines: np.ndarray,
) -> Iterator[Outside]:
    rows = (column < allowed[0] - slack) | (column > allowed[1] + slack)
    if rows.any():
        found = float(np.min(column[rows])), float(np.max(column[rows]))
        yield Outside(test.name, quantity, rows, lines, found, allowed)


def names_of_rows(entries: list[Outside], test: str, rows: int) -> list[str]:
    """For each row of a test the quantities by which it lies outside, such as "temperature; stroke"; "" inside."""
    own = [entry for entry in entries if entry.test == test]
    names = [""] * rows
    for entry in own:
        for row in np.flatnonzero(entry.rows).tolist():
            names[row] += f"; {entry.quantity}" if names[row] else entry.quantity
    return names


def sentences(entries: list[Outside], record: BenchRecord, model: Model) -> list[str]:
    """What the user is told: one sentence per test and quantity, and what the standard deviations stand for."""
    told = [_sentence(entry, record.tests[entry.test]) for entry in entries]
    if told:
        told.append(STANDS_FOR)
    if model.covariance is not None and not model.fitted:
        told.append(
            'the model does not say what it was fitted to (no "fitted_range"): rows outside of that cannot be pointed out'
        )
    for test in record.tests.values():
        if model.fitted and test.name not in model.fitted:
            alike = tests_alike(model, test)
            than = (
                f"the ranges of {', '.join(alike)} stand in"
                if alike
                else "nothing says how far it may be believed there"
            )
            told.append(f"{test.name}: the model was not fitted to such a test; {than}")
    return told


def _sentence(entry: Outside, test: TestRecord) -> str:
    what = {
        OIL: "are at temperatures at which nothing is stated of the oil",
        STROKE: "lie beyond the stroke",
    }.get(entry.quantity, f"lie outside what the model was fitted to: {entry.quantity}")
    limits = {OIL: "known", STROKE: "stroke"}.get(entry.quantity, "fitted")
    stretches = [f"{a} to {b}" if b > a else f"{a}" for a, b in entry.stretches]
    shown = ", ".join(stretches[:MOST_STRETCHES])
    if len(stretches) > MOST_STRETCHES:
        shown += f" and {len(stretches) - MOST_STRETCHES} more stretches"
    where = "rows" if test.lines is None else f"{test.path.name} lines"
    label = entry.unit.label
    return (
        f"{entry.test}: {int(entry.rows.sum()):,} of {test.rows:,} rows {what} {_ends(entry, entry.found)} {label}, "
        f"{limits} {_ends(entry, entry.allowed)} {label} ({where} {shown})"
    )


def _ends(entry: Outside, ends: tuple[float, float]) -> str:
    low, high = (significant(entry.unit.of(value), 4) for value in ends)
    return low if low == high else f"{low} to {high}"


def outside_json(entries: list[Outside]) -> dict[str, Any]:
    """{test: [{"quantity", "unit", "found", "allowed", "rows", "lines"}]}; lines: first and last of every stretch."""
    found: dict[str, Any] = {}
    for entry in entries:
        found.setdefault(entry.test, []).append(
            {
                "quantity": entry.quantity,
                "unit": entry.unit.label,
                "found": [entry.unit.of(value) for value in entry.found],
                "allowed": [entry.unit.of(value) for value in entry.allowed],
                "rows": int(entry.rows.sum()),
                "lines": [list(stretch) for stretch in entry.stretches],
            }
        )
    return found
