"""Parts of a test's table that static and dynamic tests share: file, conditions, readings, runs."""

from pathlib import Path

import numpy as np
import pandas as pd

from .bad_cells import BadCellsError, BadCellsOfTest
from .bench_csv import BenchTable, read_bench_csv
from .bench_tests import StaticTest
from .bench_toml import BenchFile
from .errors import BenchInputError, listed, quoted, suggestion
from .headers import likely_header, mapping
from .record import Channel


NAME = "bench.toml"


def read_tables(bench: BenchFile) -> dict[str, BenchTable]:
    """The files of all tests as columns, by test. Raises BenchInputError; about bad cells one for all files."""
    tables: dict[str, BenchTable] = {}
    bad: list[BadCellsOfTest] = []
    for test in (*bench.tests.values(), *bench.dynamic.values()):
        try:
            tables[test.name] = _read_table(test, bench)
        except BadCellsError as error:
            bad += error.tests
    if bad:
        raise BadCellsError(bad, bench.source.path.parent)
    return tables


def _read_table(test: StaticTest, bench: BenchFile) -> BenchTable:
    if not _is_file(test.file):
        endings = (".csv", ".csv.gz", ".xlsx", ".parquet")
        found = sorted(p.name for p in bench.source.path.parent.iterdir() if p.name.lower().endswith(endings))
        hint = suggestion(test.file.name, found) if found else "the folder holds no CSV file"
        raise test.table.error(f"there is no file {quoted(test.table.data['file'])}; {hint}", "file")
    return read_bench_csv(test, bench.valve)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def missing(table: BenchTable, test: StaticTest, what: str) -> BenchInputError:
    """An error: the test lacks a column. what: its name first, then what else there is to say of it."""
    has = listed([quoted(header) for header in table.source.header], 8)
    standard = what.split()[0]
    likely = likely_header(test, standard, table.unused)
    way = f"; if that is {quoted(likely)}, write {mapping(test, {standard: likely})}" if likely else ""
    return table.error(None, None, f"the {test.name} test needs a column {what}, but the file has {has}{way}")


def condition(table: BenchTable, bench: BenchFile, test: StaticTest, name: str) -> np.ndarray:
    """A condition per row: its column, or the value of `[conditions]`. Raises BenchInputError."""
    if name in table.values:
        return table.values[name]
    if name in bench.conditions:
        return np.full(table.rows, bench.conditions[name])
    example = {"supply_pressure": "70 bar", "temperature": "40 degC"}[name]
    likely = likely_header(test, name, table.unused)
    way = f"; or, if it is {quoted(likely)}, {mapping(test, {name: likely})}" if likely else ""
    raise bench.source.root.table_error(
        "conditions",
        f'{name} is missing: {test.file.name} has no such column; write {name} = "{example}" in [conditions]{way}',
    )


def channels_of(table: BenchTable, test: StaticTest, found: tuple[str, ...]) -> tuple[Channel, ...]:
    """The readings with what the user says of their noise."""
    channels = []
    for reading in found:
        std, source = table.values.get(f"{reading}_std"), "declared per row"
        if std is None and reading in test.noise:
            std, source = np.full(table.rows, test.noise[reading]), f"declared in {NAME}"
        channels.append(Channel(reading, table.values[reading], std, "" if std is None else source))
    return tuple(channels)


def runs(table: BenchTable) -> tuple[np.ndarray, tuple[str, ...]]:
    """(code of each row's run, names of the runs)"""
    if table.run is None:
        return np.zeros(table.rows, dtype=int), ("",)
    codes, names = pd.factorize(table.run)
    return codes.astype(int), tuple(str(name) for name in names)
