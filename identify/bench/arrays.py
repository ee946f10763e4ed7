"""A bench record from NumPy arrays or DataFrames, without any file: the same checks, words and numbers as from CSV.

What a caller gives becomes what a file would hold, columns under headers and nested tables, and then goes the way of the
reader: the same rows give the same record to the last bit.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thermohyd.oil_definition import OilDefinition

from .cells import BadCellsError, BadCellsOfTest
from .errors import BenchInputError, quoted, suggestion
from .headers import plain_name, split_header
from .read import record_of
from .record import ActuatorData, BenchRecord, Provenance, RecordFile, StartValue, ValveData
from .sheets import SheetRows, headers_apart
from .shown_units import KINDS
from .test_file import BenchTable, bench_table
from .test_tables import CONTROLLER, StaticTest
from .toml_file import TableSource
from .valve_tables import BenchFile, read_description


Described = Mapping[str, Any]  # names with quantities, texts such as "70 bar", or numbers in SI
# Keys of [tests.<name>] that say nothing of a file.
OPTIONS = ("columns", "ignore", "missing", "output", "absolute", "meter", "command")


@dataclass(frozen=True)
class FrameRows(SheetRows):
    """The rows of a table in memory. numbers: the places of its rows from 0, as NumPy and `iloc` count."""

    noun = "table"

    def error(self, message: str, *, number: int | None = None, column: int | None = None) -> BenchInputError:
        header = None if column is None else self.header[column]
        return BenchInputError(message, file=self.path, row=number, column=header)


class Arguments(TableSource):
    """The tables of a bench.toml as a caller's arguments: numbers are SI."""

    si_numbers = True


def record_from_arrays(
    tests: Mapping[str, Mapping[str, Any]],
    *,
    valve: Described | ValveData,
    oil: str | Described | OilDefinition,
    conditions: Described | None = None,
    actuator: Described | ActuatorData | None = None,
    start: Mapping[str, Any] | None = None,
    noise: Mapping[str, Any] | None = None,
    options: Mapping[str, Described] | None = None,
    sensors: Mapping[str, Any] | None = None,
    readings_required: bool = True,
) -> BenchRecord:
    """See `BenchRecord.from_arrays`."""
    bench = _described(tests, valve, oil, conditions, actuator, start, noise, options, sensors)
    frames = {test.name: _frame(tests[test.name], test) for test in _all(bench)}
    return _record(bench, frames, readings_required)


def record_from_dataframe(
    tests: Mapping[str, pd.DataFrame],
    *,
    valve: Described | ValveData,
    oil: str | Described | OilDefinition,
    conditions: Described | None = None,
    actuator: Described | ActuatorData | None = None,
    start: Mapping[str, Any] | None = None,
    noise: Mapping[str, Any] | None = None,
    options: Mapping[str, Described] | None = None,
    sensors: Mapping[str, Any] | None = None,
    readings_required: bool = True,
) -> BenchRecord:
    """See `BenchRecord.from_dataframe`."""
    for name, frame in _tables(tests, "tests").items():
        if not isinstance(frame, pd.DataFrame):
            raise _of_test(name, f"is {_kind_of(frame)}; expected a pandas DataFrame")
    bench = _described(tests, valve, oil, conditions, actuator, start, noise, options, sensors)
    return _record(bench, {test.name: tests[test.name] for test in _all(bench)}, readings_required)


def _all(bench: BenchFile) -> tuple[StaticTest, ...]:
    return (*bench.tests.values(), *bench.dynamic.values())


def _described(
    tests: Mapping[str, Any],
    valve: Described | ValveData,
    oil: str | Described | OilDefinition,
    conditions: Described | None,
    actuator: Described | ActuatorData | None,
    start: Mapping[str, Any] | None,
    noise: Mapping[str, Any] | None,
    options: Mapping[str, Described] | None,
    sensors: Mapping[str, Any] | None = None,
) -> BenchFile:
    """What a bench.toml with these values says. Raises BenchInputError."""
    tables: dict[str, dict[str, Any]] = {name: {"file": str(name)} for name in _tables(tests, "tests")}
    for what, given in (("noise", noise), ("options", options)):
        for name, entry in _tables(given or {}, what).items():
            if name not in tables:
                raise BenchInputError(f"unknown test {quoted(name)}; {suggestion(str(name), tables)}", key=what)
            if what == "noise":
                tables[name]["noise"] = entry
                continue
            for key, value in _tables(entry, f"options {name}").items():
                if key not in OPTIONS:
                    raise BenchInputError(f"unknown key {quoted(key)}; {suggestion(str(key), OPTIONS)}", key=what)
                tables[name][key] = value
    root = {
        "valve": _valve(valve),
        "tests": tables,
        "conditions": conditions,
        "start": _start(start),
        "sensors": sensors,
    }
    if not isinstance(oil, OilDefinition):
        root["oil"] = {"preset": oil} if isinstance(oil, str) else oil
    if actuator is not None:
        root["actuator"] = _actuator(actuator)
    plain = {key: _plain(value, key) for key, value in root.items() if value is not None}
    return read_description(Arguments(plain), "valve", oil if isinstance(oil, OilDefinition) else None)


def _tables(value: object, what: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise BenchInputError(f"is {_kind_of(value)}; expected a dictionary", key=what)
    return dict(value)


def _kind_of(value: object) -> str:
    return f"of type {type(value).__name__}"


def _without_none(value: Any) -> Any:
    """A record's own class (SI) as a table; a table as it is."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    return {k: v for k, v in value.items() if v is not None} if isinstance(value, Mapping) else value


def _valve(value: Any) -> Any:
    """Of a ValveData only what its record stated."""
    table = _without_none(value)
    if isinstance(value, ValveData):
        for size in ("slot_width", "stroke"):
            if not table.pop(f"{size}_stated"):
                del table[size]
    return table


def _actuator(value: Any) -> Any:
    """The gains of an ActuatorData stand in a table of their own, as in a file."""
    table = _without_none(value)
    if isinstance(value, ActuatorData):
        gains = {key: table.pop(key) for key in CONTROLLER if key in table}
        return {**table, **({"controller": gains} if gains else {})}
    return table


def _start(start: Mapping[str, Any] | None) -> Any:
    if not isinstance(start, Mapping):
        return start
    return {name: _entry(value) if isinstance(value, StartValue) else value for name, value in start.items()}


def _entry(value: StartValue) -> dict[str, Any]:
    named = {"value": value.value, "std": value.prior_std, "min": value.lower, "max": value.upper}
    held = {"fixed": value.fixed} if value.fixed or value.freed else {}
    return {key: v for key, v in named.items() if v is not None} | held


def _plain(value: Any, key: str) -> Any:
    """The value as TOML has it: a quantity becomes the text that a bench.toml would hold, digit by digit."""
    if _is_quantity(value):
        number = np.asarray(value.magnitude)
        if number.ndim:
            raise BenchInputError(f"{quoted(value)} has the shape {number.shape}; expected one number", key=key)
        return f"{number.item()!r} {_unit(value)}"
    if isinstance(value, Mapping):
        return {str(name): _plain(entry, f"{key} {name}") for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry, key) for entry in value]
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return value.item()
    return value


def _is_quantity(value: object) -> bool:
    """Whether it is pint's, of any registry, or has its attributes."""
    return hasattr(value, "magnitude") and hasattr(value, "units")


def _unit(quantity: Any) -> str:
    """The unit of a quantity as a header has it: "um", "l / min", "°C"; "1" where it has none."""
    try:
        return format(quantity.units, "~D") or "1"
    except (TypeError, ValueError):  # units of another package
        return str(quantity.units) or "1"


def _frame(columns: Mapping[str, Any], test: StaticTest) -> pd.DataFrame:
    """The columns of one test under headers with units, as a file has them. Raises BenchInputError."""
    if isinstance(columns, pd.DataFrame):
        raise _of_test(test.name, "is a DataFrame; BenchRecord.from_dataframe takes those")
    given = {str(name): _column(value, test, str(name)) for name, value in _tables(columns, test.name).items()}
    lengths = {name: len(values) for name, values in given.items() if values.ndim}
    rows = next(iter(lengths.values()), None)
    if rows is None:
        raise _of_test(test.name, "holds no array; expected one value per row in one column at least")
    first = next(iter(lengths))
    for name, length in lengths.items():
        if length != rows:
            words = (
                f"has {length:,} values, but {first} has {rows:,}; every column has one value per row, or one for all"
            )
            raise _of_test(test.name, words, name)
    headers = {name: _header(name, columns[name], given[name], test) for name in given}
    return pd.DataFrame({headers[n]: v if v.ndim else np.full(rows, v[()]) for n, v in given.items()})


def _column(value: Any, test: StaticTest, name: str) -> np.ndarray:
    values = value.magnitude if _is_quantity(value) else value
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    try:
        array = np.asarray(values)
    except Exception:  # lists of lists of different lengths, objects of other packages
        raise _of_test(test.name, "is no array; expected one value per row", name) from None
    if array.ndim > 1 or array.dtype.kind in "cV":
        what = "complex numbers" if array.dtype.kind == "c" else f"the shape {array.shape}"
        raise _of_test(test.name, f"has {what}; expected one number per row", name)
    if array.dtype.kind == "U":
        array = array.astype(object)
    return array


def _header(name: str, value: Any, values: np.ndarray, test: StaticTest) -> str:
    """The header that a CSV would have: the unit is that of the quantity, else the one in the name, else the SI one."""
    unit_in_name = split_header(name)[1]
    if _is_quantity(value):
        if unit_in_name is not None:
            raise _of_test(test.name, "has a unit in its name and one of its own; keep one of them", name)
        return f"{name} [{_unit(value)}]"
    kinds = test.kinds.get(plain_name(name))
    if unit_in_name is not None or kinds is None or values.dtype.kind in "mM":
        return name
    unit = KINDS[kinds[0]]
    return f"{name} [{unit.si or unit.label}]"


def _of_test(name: str, message: str, column: str | None = None) -> BenchInputError:
    return BenchInputError(message, file=Path(name), column=column)


def _record(bench: BenchFile, frames: Mapping[str, pd.DataFrame], readings_required: bool) -> BenchRecord:
    tables: dict[str, BenchTable] = {}
    bad: list[BadCellsOfTest] = []
    used: dict[str, FrameRows] = {}
    for test in _all(bench):
        used[test.name] = rows = _rows(test.file, frames[test.name])
        try:
            tables[test.name] = bench_table(test, bench.valve, rows)
        except BadCellsError as error:
            bad += error.tests
    if bad:
        raise BadCellsError(bad, None)
    record = record_of(bench, tables, Path(bench.valve.name), readings_required=readings_required)
    files = [
        RecordFile(name, _hash(used[name]), len(used[name].frame), test.rows if test.channels else 0)
        for name, test in record.tests.items()
    ]
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    made = Provenance(f"{record.name} (arrays)", tuple(files), now, version("thermohyd"))
    return replace(record, provenance=made)


def _rows(path: Path, frame: pd.DataFrame) -> FrameRows:
    header, numbered = headers_apart(frame, path)
    plain = pd.DataFrame({i: _as_read(numbered[i]) for i in numbered.columns})
    return FrameRows(path, header, 0, np.arange(len(plain)), plain)


def _as_read(column: Any) -> pd.Series:
    """The column with the types that a reader of files gives: numbers as NumPy's, with NaN for what is missing."""
    if pd.api.types.is_bool_dtype(column):
        return column.astype(str).astype(object)  # "True" is no number
    if pd.api.types.is_numeric_dtype(column):
        return column.astype("float64") if pd.api.types.is_extension_array_dtype(column.dtype) else column
    return column.infer_objects() if column.dtype == object else column


def _hash(rows: FrameRows) -> str:
    """SHA-256 of the headers and the columns, so that a result says which arrays it was made from."""
    digest = hashlib.sha256()
    for header, (_, column) in zip(rows.header, rows.frame.items(), strict=True):
        digest.update(header.encode() + b"\0")
        numbers = column.dtype.kind in "iuf"
        digest.update(column.to_numpy(dtype=float).tobytes() if numbers else "\0".join(map(str, column)).encode())
    return digest.hexdigest()
