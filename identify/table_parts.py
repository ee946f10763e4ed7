"""Parts of a test's table that static and dynamic tests share: file, conditions, readings, runs."""

from pathlib import Path

import numpy as np
import pandas as pd

from .bench_csv import BenchTable, read_bench_csv
from .bench_tests import StaticTest
from .bench_toml import BenchFile
from .errors import BenchInputError, quoted, suggestion
from .record import Channel


NAME = "bench.toml"


def read_table(test: StaticTest, bench: BenchFile) -> BenchTable:
    """The test's file as columns. Raises BenchInputError."""
    if not _is_file(test.file):
        found = sorted(path.name for path in bench.source.path.parent.iterdir() if ".csv" in path.name)
        hint = suggestion(test.file.name, found) if found else "the folder holds no CSV file"
        raise test.table.error(f"there is no file {quoted(test.table.data['file'])}; {hint}", "file")
    return read_bench_csv(test, bench.valve)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def missing(table: BenchTable, test: StaticTest, what: str) -> BenchInputError:
    """An error: the test lacks a column, `what` says which in words."""
    has = ", ".join(quoted(header) for header in table.cells.source.header)
    return table.error(None, None, f"the {test.name} test needs a column {what} but the file has {has}")


def condition(table: BenchTable, bench: BenchFile, test: StaticTest, name: str) -> np.ndarray:
    """A condition per row: its column, or the value of `[conditions]`. Raises BenchInputError."""
    if name in table.values:
        return table.values[name]
    if name in bench.conditions:
        return np.full(table.rows, bench.conditions[name])
    example = {"supply_pressure": "70 bar", "temperature": "40 degC"}[name]
    raise bench.source.root.table_error(
        "conditions",
        f'{name} is missing: {test.file.name} has no such column; write {name} = "{example}" in [conditions]',
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
