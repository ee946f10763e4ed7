"""A test's file as standard columns in SI units: headers recognised, units converted, what cannot be refused."""

import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .cells import NUMBER, BadCellsError, Cells, Source, is_clock_time
from .columns import CONDITIONS, impossible, plausible_range
from .csv_file import CsvLines, csv_cells, read_csv_lines
from .errors import BenchInputError, listed, quoted
from .headers import mapping, recognise, split_header, units_of
from .mat_file import read_mat
from .record import ValveData
from .sensors import COLUMNS, OTHERS, SIGNALS, Sensor, of_signal
from .sheets import ENDINGS, SheetRows, read_sheet
from .tdms_file import read_tdms
from .test_tables import StaticTest
from .units import Unit, UnitError, expected, parse_unit


@dataclass(frozen=True)
class BenchTable:
    """The columns of one file: `values` in SI by standard name, `run` as text, `table` as the user had it."""

    values: dict[str, np.ndarray]
    run: np.ndarray | None
    rows: int
    lines: np.ndarray
    table: pd.DataFrame
    notes: tuple[str, ...]
    columns: dict[str, int]  # standard name -> place in the file
    kinds: dict[str, str]  # standard name -> kind of quantity that its unit turned out to be of
    units: dict[str, Unit]  # standard name -> its unit
    source: Source
    unused: tuple[str, ...]  # headers that give no standard column
    signals: dict[str, str]  # standard name -> "V" or "count", of the columns whose header has a signal's unit
    _cells: Cells
    _kept: np.ndarray  # rows of the file that are rows of the table

    def error(self, name: str | None, row: int | None, message: str) -> BenchInputError:
        """An error about a standard column (None: the file as a whole) and one of its rows."""
        number = None if row is None else int(self.lines[row])
        return self.source.error(message, number=number, column=self.columns.get(name or ""))

    def text(self, name: str, row: int) -> str:
        """A cell of a standard column as the user wrote it."""
        return str(self._cells.texts(self.columns[name])[self._kept[row]])

    def run_sizes(self) -> Counter[str]:
        """How many rows of the file have each name of a run, rows that were left out included."""
        return Counter(self._cells.texts(self.columns["run"]))


def read_bench_csv(test: StaticTest, valve: ValveData) -> BenchTable:
    """Raises BenchInputError with file, line and column, BadCellsError where that is all that is wrong."""
    return bench_table(test, valve, read_source(test))


def bench_table(test: StaticTest, valve: ValveData, source: Source) -> BenchTable:
    """The rows of a test as standard columns, wherever they come from. Raises as `read_bench_csv` does."""
    columns, spare = recognise(test, source)
    rows, units, kinds = _units(test, source, columns, valve)
    run = columns.get("run")
    texts = () if run is None else (run,)
    cells = csv_cells(rows, texts) if isinstance(rows, CsvLines) else _sheet_cells(rows)
    values = {}
    for name, place in columns.items():
        if name == "time" and cells.is_clock(place):
            values[name], units[name], kinds[name] = cells.seconds(place), Unit("s", 1.0, 0.0), "time"
        elif name in units:
            values[name] = units[name].to_si(cells.numbers(place))
        elif name != "run":
            raise _without_unit(test, source, columns, name)
    bad = cells.bad_cells(test.name, skip_missing=test.skip_missing)
    if bad is not None:
        raise BadCellsError((bad,), test.table.source.folder)
    missing = cells.missing()
    kept = np.flatnonzero(~missing)
    if not len(kept):
        raise source.error('no row is left: missing = "skip" leaves out every one of them')
    lines = np.asarray(cells.source.numbers)
    notes = _notes(test, source, lines[missing], spare)
    shown = [
        i for i, h in enumerate(source.header) if not split_header(h)[0].endswith(("_predicted", "_predicted_std"))
    ]
    user = pd.DataFrame({source.header[i]: cells.frame[i] for i in shown})
    if len(kept) < len(user):
        user = user.iloc[kept].reset_index(drop=True)
    values = {name: column[kept] for name, column in values.items()}
    table = BenchTable(
        values=values,
        run=None if run is None else cells.texts(run)[kept],
        rows=len(kept),
        lines=lines[kept],
        table=user,
        notes=notes,
        columns=columns,
        kinds=kinds,
        units=units,
        source=source,
        unused=tuple(header for i, header in enumerate(source.header) if i not in columns.values()),
        signals=_signals(test, units),
        _cells=cells,
        _kept=kept,
    )
    _check_values(table)
    return table


def _signals(test: StaticTest, units: dict[str, Unit]) -> dict[str, str]:
    """{column with a sensor: the signal that its header's unit is of}"""
    found = {}
    for name in units:
        for signal, kind in SIGNALS.items():
            if name in test.sensors and kind in test.sensors[name].kinds:
                with suppress(UnitError):
                    parse_unit(units[name].text, kind)
                    found[name] = signal
    return found


def read_source(test: StaticTest) -> Source:
    """The headers and rows of a test's file, whatever its format. Raises BenchInputError."""
    ending = test.file.suffix.lower()
    if ending in ENDINGS:
        return read_sheet(test.file, test.skip_rows, test.part)
    if ending in (".mat", ".tdms"):
        if test.skip_rows:
            raise BenchInputError(f"a {ending} file has no lines above its headers; remove skip_rows", file=test.file)
        return read_mat(test.file, test.part) if ending == ".mat" else read_tdms(test.file, test.part)
    if ending == ".xls":
        raise BenchInputError("has the format of Excel before 2007; save it as .xlsx or CSV", file=test.file)
    return read_csv_lines(test.file, test.skip_rows)


def _sheet_cells(source: Source) -> Cells:
    assert isinstance(source, SheetRows)
    return source.table()


def _notes(test: StaticTest, source: Source, left_out: np.ndarray, spare: list[int]) -> tuple[str, ...]:
    notes = []
    if spare:
        unused = [split_header(source.header[i])[0] for i in spare]
        notes.append(f"columns that this test does not use: {', '.join(unused)}")
    if len(left_out):
        places = listed(_ranges(left_out), 6)
        rows = f"{len(left_out):,} {'row' if len(left_out) == 1 else 'rows'}"
        where = f"{source.word}{'' if len(left_out) == 1 else 's'} {places}"
        notes.append(f'{test.file.name}: {rows} with a missing reading left out, as missing = "skip" asks: {where}')
    return tuple(notes)


def _ranges(numbers: np.ndarray) -> list[str]:
    """[3, 4, 5, 9] as "3-5", "9"."""
    pieces = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    return [str(piece[0]) if len(piece) == 1 else f"{piece[0]}-{piece[-1]}" for piece in pieces]


def _units(
    test: StaticTest, source: Source, columns: dict[str, int], valve: ValveData
) -> tuple[Source, dict[str, Unit], dict[str, str]]:
    """(the source without its row of units, unit and kind of each column that has a unit)"""
    texts = {name: _written_unit(test, name, source.header[i], valve) for name, i in columns.items() if name != "run"}
    below: dict[str, str] = {}
    if any(text is None for text in texts.values()):
        below = _row_of_units(test, source, {name: columns[name] for name, t in texts.items() if t is None}, valve)
    units, kinds = {}, {}
    for name, text in texts.items():
        stated = _written_unit(test, name, test.columns[name], valve) if name in test.columns else None
        try:
            if stated is not None:
                units[name], kinds[name] = _unit(test, name, stated, valve)
            elif text is not None and not (name == "time" and _is_clock_column(source, columns[name])):
                units[name], kinds[name] = _unit(test, name, text, valve)
            if name in below:
                unit, kind = _unit(test, name, below[name], valve)
                if name in units and unit.to_si(np.ones(1)) != units[name].to_si(np.ones(1)):
                    raise UnitError(
                        f"{quoted(below[name])} stands below the header, but bench.toml says {quoted(stated)}"
                    )
                units[name], kinds[name] = unit, kind
        except UnitError as error:
            number = source.numbers[0] if name in below else None
            raise source.error(str(error), number=number, column=columns[name]) from None
    return (source.after_first_row() if below else source), units, kinds


def _written_unit(test: StaticTest, name: str, header: str, valve: ValveData) -> str | None:
    """What a header gives as its unit. In a user's own header, parentheses may hold something else: "LVDT (left)"."""
    text = split_header(header)[1]
    if text is not None and name in test.columns and header.endswith(")"):
        try:
            _unit(test, name, text, valve)
        except UnitError:
            return None
    return text


def _row_of_units(test: StaticTest, source: Source, columns: dict[str, int], valve: ValveData) -> dict[str, str]:
    """{column: unit} where the row below the headers holds the units of the columns without one; empty where it does not."""
    row = source.first_row()
    if len(row) != len(source.header):
        return {}
    cells = {name: re.sub(r"^[\[(](.*)[\])]$", r"\1", row[i]).strip() for name, i in columns.items()}
    if not any(cell and re.fullmatch(NUMBER, cell.replace(",", ".")) is None for cell in cells.values()):
        return {}
    if any(is_clock_time(cell) for cell in cells.values()):
        return {}
    units = {}
    for name, cell in cells.items():
        try:
            _unit(test, name, cell, valve)
            units[name] = cell
        except UnitError:
            continue
    # A word in place of a number makes no row of units; most of its cells must be some.
    readable = len(units) + ("time" in cells and "time" not in units)  # "hh:mm:ss" above times of day
    if not units or 2 * readable < len(cells):
        return {}
    return units if readable == len(cells) else {n: cell for n, cell in cells.items() if n != "time" or n in units}


def _is_clock_column(source: Source, place: int) -> bool:
    row = source.first_row()
    return place < len(row) and is_clock_time(row[place])


def _without_unit(test: StaticTest, source: Source, columns: dict[str, int], first: str) -> BenchInputError:
    units = units_of(source)
    lacking = {
        name: i for name, i in columns.items() if name != "run" and units[i] is None and name not in test.columns
    }
    lacking |= {first: columns[first]}
    more = f"; {len(lacking) - 1} more have none" if len(lacking) > 1 else ""
    example = expected(test.kinds[first][0]).split(" such as ")[1]
    return source.error(
        f"the unit is missing; write for example {first} [{example}], or {mapping(test, source, lacking)}{more}",
        column=columns[first],
    )


def _unit(test: StaticTest, name: str, text: str, valve: ValveData) -> tuple[Unit, str]:
    """The unit of a column, and which of the kinds that the column may be of it is. Raises UnitError."""
    kinds = test.kinds[name]
    full_scale = valve.stroke if name in test.percent_of_stroke else None
    reading = name.removesuffix("_std")
    sensor = test.sensors.get(reading)
    for kind in kinds[1:]:
        try:
            unit = parse_unit(text, kind)
        except UnitError:
            continue
        return (unit, kind) if sensor is None else of_signal(sensor, unit, kind, spread=reading != name)
    try:
        unit = parse_unit(text, kinds[0], full_scale)
    except UnitError as error:
        also = "".join(f", or {expected(kind)}" for kind in kinds[1:])
        raise UnitError(f"{error}{also}{_of_no_sensor(text, reading, sensor)}") from None
    return (unit, kinds[0]) if sensor is None else of_signal(sensor, unit, kinds[0], spread=reading != name)


def _of_no_sensor(text: str, name: str, sensor: Sensor | None) -> str:
    """What to say of a signal whose gain nobody states; empty of anything else."""
    if sensor is None and name in (*COLUMNS, *OTHERS):
        for kind in SIGNALS.values():
            with suppress(UnitError):
                if kind == "voltage" or text.strip() not in ("1", "-", "%"):
                    parse_unit(text, kind)
                    return (
                        f'; of a reading in volts or counts, [sensors] says what it means: {name} = {{ gain = "free" }}'
                    )
    return ""


def _check_values(table: BenchTable) -> None:
    """Raise BenchInputError where a column holds what no bench has."""
    for name, values in table.values.items():
        kind = table.kinds[name] if name in CONDITIONS else f"{table.kinds[name]} reading"
        lowest, highest = plausible_range(kind)
        bad = np.flatnonzero((values < lowest) | (values > highest))
        if len(bad):
            row = int(bad[0])
            value, unit = float(values[row]), table.units[name]
            number = (value - unit.offset) / unit.scale
            raise table.error(name, row, f"{table.text(name, row)} {impossible(kind, value, number)}")
        if name.endswith("_std") and not (values > 0.0).all():
            row = int(np.flatnonzero(~(values > 0.0))[0])
            raise table.error(name, row, "a standard deviation must be above zero")
