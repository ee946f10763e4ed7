"""A check in a terminal and as JSON: each test with its columns, how it is reduced, its noise; then what is missing."""

from typing import Any

from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.columns import reading_unit
from thermohyd.identify.bench.provenance import record_json, record_line
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.report.terminal import grid, heading, indented, table

from .result import CheckedColumn, CheckedTest, CheckResult


SCHEMA = "thermohyd-check/1"
DIGITS = 5


def print_check(result: CheckResult, console: Console) -> None:
    """The answer first; then every test, what is missing, and what to type next."""
    line = lambda words, style="": console.print(Text(words, style=style))
    line(answer(result), "bold red" if result.trouble else "bold")
    if result.record is not None:
        line(record_line(result.record), "dim")
    for name, sentence in result.refused.items():
        if name not in result.without_readings or not result.for_predictions_only:
            console.print(heading(f"{name or 'record'}: would be refused"))
            console.print(indented(Text(sentence, style="red")))
    for test in result.tests.values():
        _print_test(test, result, console)
    if result.missing:
        console.print(heading("What is missing"))
        for lacking in result.missing:
            console.print(indented(Text(f"- {lacking.sentence}")))
    if result.warnings:
        console.print(heading("Warnings"))
        for warning in result.warnings:
            console.print(indented(Text(f"- {warning}", style="yellow")))
    if result.free:
        console.print(heading("A fit will look for"))
        console.print(indented(Text(", ".join(result.free))))
    if result.next_command:
        console.print(heading("Next"))
        console.print(indented(Text(result.next_command)), soft_wrap=True)


def answer(result: CheckResult) -> str:
    """The first sentence."""
    if result.trouble:
        return f"{result.name}: {result.trouble}."
    rows = sum(test.read.rows for test in result.tests.values())
    points = sum(test.seen.rows for test in result.tests.values())
    tests = f"{len(result.tests)} {'test' if len(result.tests) == 1 else 'tests'}"
    if result.for_predictions_only:
        return f"{result.name}: {tests}, {rows:,} rows without readings: a record for simulate and plan, not for a fit."
    seen = "" if points == rows else f", of which a fit sees {points:,} points"
    return f"{result.name}: {tests}, {rows:,} rows can be read{seen}."


def _print_test(test: CheckedTest, result: CheckResult, console: Console) -> None:
    console.print(heading(f"{test.name}: {size_words(test)}"))
    if test.name in result.without_readings and result.for_predictions_only:
        console.print(indented(Text("without readings: for simulate and plan only")))
    console.print(indented(table(("header", "~read as", ">from", ">to", "unit"), column_rows(test))))
    rows = [(name, words) for name, words in test.conditions.items()]
    rows += [(noise.channel, noise_words(test, noise.channel)) for noise in test.noise]
    if rows:
        console.print(indented(grid(rows)))
    for note in (*test.read.notes, *test.notes):
        console.print(indented(Text(note)))
    for fault in test.faults:
        console.print(indented(Text(fault.sentence, style="yellow")))


def size_words(test: CheckedTest) -> str:
    """Rows, runs and legs of a test, and what a fit sees of them."""
    runs = len(test.read.runs)
    parts = [f"{test.read.rows:,} rows in {runs} {'run' if runs == 1 else 'runs'}"]
    if test.planned:
        parts.append("planned, not yet run")
    if not test.read.in_motion:
        parts.append(f"{test.legs} {'leg' if test.legs == 1 else 'legs'} of the sweep")
    out = sum(len(fault.rows) for fault in test.faults if fault.masked)
    if test.reduced:
        parts.append(f"reduced to {test.seen.rows:,} points")
    else:
        parts.append("taken row by row" + (f" without {out} of them" if out else ""))
    return "; ".join(parts)


def column_rows(test: CheckedTest) -> list[tuple[str, str, str, str, str]]:
    """Header, what it is read as, from, to, unit: a row per column of the file."""
    return [(c.header, _meaning(c), *_range(c)) for c in test.columns]


def _meaning(column: CheckedColumn) -> str:
    return column.standard or "not used"


def _range(column: CheckedColumn) -> tuple[str, str, str]:
    shown = lambda value: "" if value is None else significant(value, DIGITS)
    return shown(column.least), shown(column.greatest), column.unit


def noise_words(test: CheckedTest, channel: str) -> str:
    """What is known of the noise of a reading before any fit."""
    noise = next(found for found in test.noise if found.channel == channel)
    own = test.seen.channel(channel)
    unit = reading_unit(channel, own.signal)
    size = f"{significant(noise.std * unit.factor, 2)} {unit.label}"
    of = "a point" if test.reduced else "a row"
    if noise.known:
        return f"noise of {of} {size}: {noise.source}"
    return f"noise not known, about {size} by neighbouring rows; {noise.source}"


def check_json(result: CheckResult) -> dict[str, Any]:
    """The content of check.json."""
    record = {} if result.record is None else record_json(result.record)
    return {
        "schema": SCHEMA,
        "name": result.name,
        **record,
        "usable": not result.trouble,
        "headline": answer(result),
        "refused": dict(result.refused),
        "without_readings": list(result.without_readings),
        "tests": {name: _test_json(test) for name, test in result.tests.items()},
        "free_parameters": list(result.free),
        "missing": [{"key": lacking.key, "sentence": lacking.sentence} for lacking in result.missing],
        "warnings": list(result.warnings),
        "next_command": result.next_command or None,
        "units": "SI",
    }


def _test_json(test: CheckedTest) -> dict[str, Any]:
    return {
        "file": test.read.path.name,
        "rows": test.read.rows,
        "points": test.seen.rows,
        "runs": list(test.read.runs),
        "legs": test.legs,
        "planned": test.planned,
        "reduced": test.reduced,
        "columns": [
            {
                "header": c.header,
                "column": c.standard or None,
                "unit": c.unit or None,
                "least": c.least,
                "greatest": c.greatest,
            }
            for c in test.columns
        ],
        "conditions": dict(test.conditions),
        "noise": {n.channel: {"std": n.std, "known": n.known, "source": n.source} for n in test.noise},
        "notes": [*test.read.notes, *test.notes],
        "faults": [fault.sentence for fault in test.faults],
    }
