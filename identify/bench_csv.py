"""A test's CSV file as standard columns in SI units: headers recognised, units converted, what cannot be refused."""

import re
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .bench_tests import StaticTest
from .columns_of_tests import CONDITIONS, standard_columns
from .csv_cells import CsvCells
from .csv_lines import CsvLines, read_csv_lines
from .errors import BenchInputError, quoted, suggestion
from .physical_limits import impossible, plausible_range
from .record import ValveData
from .units import Unit, UnitError, expected, parse_unit


HEADER = re.compile(r"(.*?)\s*\[([^\[\]]*)\]")


@dataclass(frozen=True)
class BenchTable:
    """The columns of one file: `values` in SI by standard name, `run` as text, `table` as the user had it."""

    values: dict[str, np.ndarray]
    run: np.ndarray | None
    rows: int
    lines: np.ndarray
    table: pd.DataFrame
    notes: tuple[str, ...]
    cells: CsvCells
    columns: dict[str, int]  # standard name -> place in the file
    kinds: dict[str, str]  # standard name -> kind of quantity that its unit turned out to be of

    def error(self, name: str | None, row: int | None, message: str) -> BenchInputError:
        """An error about a standard column (None: the file as a whole) and one of its rows."""
        if name in self.columns:
            return self.cells.error(self.columns[name], row, message)
        line = self.cells.source.header_line if row is None else int(self.lines[row])
        return BenchInputError(message, file=self.cells.source.path, line=line)


def read_bench_csv(test: StaticTest, valve: ValveData) -> BenchTable:
    """Raises BenchInputError with file, line and column."""
    source = read_csv_lines(test.file)
    names = [_split_header(header) for header in source.header]
    columns, spare = _recognise(test, source, names)
    found = {n: _unit(test, source, n, names[i], i, valve) for n, i in columns.items() if n != "run"}
    units, kinds = {n: unit for n, (unit, _) in found.items()}, {n: kind for n, (_, kind) in found.items()}
    run = columns.get("run")
    cells = CsvCells(source, () if run is None else (run,))
    values = {name: unit.to_si(cells.numbers(columns[name])) for name, unit in units.items()}
    for name in CONDITIONS:
        if name in values:
            _check_range(cells, columns[name], values[name], kinds[name])
    for name in values:
        if name.endswith("_std") and not (values[name] > 0.0).all():
            row = int(np.flatnonzero(~(values[name] > 0.0))[0])
            raise cells.error(columns[name], row, "a standard deviation must be above zero")
    kept = [i for i, (name, _) in enumerate(names) if not name.endswith(("_predicted", "_predicted_std"))]
    table = pd.DataFrame({source.header[i]: cells.frame[i] for i in kept})
    unused = [names[i][0] for i in spare]
    notes = (f"columns that this test does not use: {', '.join(unused)}",) if unused else ()
    lines = np.asarray(source.numbers)
    return BenchTable(
        values, None if run is None else cells.texts(run), len(lines), lines, table, notes, cells, columns, kinds
    )


def _split_header(header: str) -> tuple[str, str | None]:
    match = HEADER.fullmatch(header)
    return (header, None) if match is None else (match[1], match[2].strip())


def _recognise(
    test: StaticTest, source: CsvLines, names: list[tuple[str, str | None]]
) -> tuple[dict[str, int], list[int]]:
    """({standard column: place}, places of standard columns that belong to other tests)."""

    def error(i: int | None, message: str) -> BenchInputError:
        column = None if i is None else source.header[i]
        return BenchInputError(message, file=source.path, line=source.header_line, column=column)

    columns: dict[str, int] = {}
    for standard, header in test.columns.items():
        places = _places(header, source.header, names)
        if not places:
            raise test.table.error(
                f"{standard} is to be {quoted(header)}, but {source.path.name} has no such header; "
                + suggestion(header, source.header),
                "columns",
            )
        if len(places) > 1:
            raise error(places[1], "duplicate header; each column needs a name of its own")
        columns[standard] = places[0]
    taken = set(columns.values())
    used, known = ("run", *test.kinds), standard_columns()
    spare = []
    seen: set[str] = set()
    for i, (name, _) in enumerate(names):
        if not source.header[i]:
            raise error(None, f"column {i + 1} has no header; name it, or start its name with _ to leave it out")
        if source.header[i] in seen:
            raise error(i, "duplicate header; each column needs a name of its own")
        seen.add(source.header[i])
        if i in taken or _left_out(name, source.header[i], test.ignore):
            continue
        if name in columns:
            first = quoted(source.header[columns[name]])
            raise error(i, f"duplicate header: {first} already gives {name}; remove one, or list it in ignore")
        if name in used:
            columns[name] = i
        elif name in known:
            spare.append(i)
        else:
            extra = "(extra columns: start the name with _ or list it in ignore)"
            raise error(i, f"unknown column {quoted(name)}; {suggestion(name, used)} {extra}")
    if "spool_position" in columns and "current" in columns:
        spare.append(columns.pop("current"))
    return columns, spare


def _places(header: str, headers: list[str], names: list[tuple[str, str | None]]) -> list[int]:
    """Where a user's header stands: written in full, or without the unit on either side."""
    exact = [i for i, found in enumerate(headers) if found == header]
    if exact:
        return exact
    name, unit = _split_header(header)
    return [i for i, (n, u) in enumerate(names) if n == name and (u is None or unit is None)]


def _left_out(name: str, header: str, ignore: tuple[str, ...]) -> bool:
    predicted = name.endswith(("_predicted", "_predicted_std"))
    return predicted or name.startswith("_") or name in ignore or header in ignore


def _unit(
    test: StaticTest,
    source: CsvLines,
    name: str,
    header: tuple[str, str | None],
    place: int,
    valve: ValveData,
) -> tuple[Unit, str]:
    """The unit of a column, and which of the kinds that the column may be of it is."""
    kinds = test.kinds[name]
    text = header[1]
    if text is None and name in test.columns:
        text = _split_header(test.columns[name])[1]
    full_scale = valve.stroke if name in test.percent_of_stroke else None
    try:
        if text is None:
            raise UnitError(f"the unit is missing; write for example {name} [{_example(kinds[0])}]")
        for kind in kinds[1:]:
            with suppress(UnitError):
                return parse_unit(text, kind), kind
        return parse_unit(text, kinds[0], full_scale), kinds[0]
    except UnitError as error:
        also = "".join(f", or {expected(kind)}" for kind in kinds[1:])
        raise BenchInputError(
            f"{error}{also}", file=source.path, line=source.header_line, column=source.header[place]
        ) from None


def _example(kind: str) -> str:
    return expected(kind).split(" such as ")[1]


def _check_range(cells: CsvCells, column: int, values: np.ndarray, kind: str) -> None:
    lowest, highest = plausible_range(kind)
    bad = np.flatnonzero((values < lowest) | (values > highest))
    if len(bad):
        row = int(bad[0])
        raise cells.error(column, row, f"{cells.texts(column)[row]} {impossible(kind, float(values[row]))}")
