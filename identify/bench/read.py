"""Read a bench record: a folder with bench.toml and one file per test, checked, in SI units. No JAX here.

What both kinds of tests share is in `read_columns`, step and frequency tests in `read_dynamic`. `record_of` makes the record from
tables that are already in memory.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .cells import BadCellsError, BadCellsOfTest
from .columns import CONDITIONS, READINGS, column_unit
from .errors import BenchInputError, quoted, suggestion
from .planned_sweeps import planned_rows
from .plausibility import check_supply, condition_warnings, rating_warnings, static_warnings
from .provenance import provenance_of
from .read_columns import channels_of, check_columns, check_sensors, condition, runs
from .read_dynamic import dynamic_test_of
from .record import BenchRecord, at_first_row
from .sensors import Sensor
from .sweeps import first_step_back, sweep_direction, sweep_rate
from .test_file import BenchTable, bench_table, read_bench_csv
from .test_record import TestRecord
from .test_tables import StaticTest
from .units import to_si
from .valve_tables import BenchFile, read_bench_toml


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
        raise BadCellsError(bad, bench.source.folder)
    return tables


def _read_table(test: StaticTest, bench: BenchFile) -> BenchTable:
    if test.planned:
        return bench_table(test, bench.valve, planned_rows(test, bench.valve))
    if not _is_file(test.file):
        endings = (".csv", ".csv.gz", ".xlsx", ".xlsm", ".parquet", ".mat", ".tdms")
        folder = bench.source.folder or Path()
        found = sorted(p.name for p in folder.iterdir() if p.name.lower().endswith(endings))
        hint = suggestion(test.file.name, found) if found else "the folder holds no CSV file"
        raise test.table.error(f"there is no file {quoted(test.table.data['file'])}; {hint}", "file")
    return read_bench_csv(test, bench.valve)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def record_folder(path: str | Path) -> Path:
    """The folder of a record that is named by itself or by its bench.toml."""
    path = Path(path)
    return path.parent if path.name == NAME and not os.path.isdir(path) else path


def described_record(folder: str | Path) -> tuple[Path, BenchFile]:
    """(the folder of a record, what its bench.toml says). Raises BenchInputError, and nothing else."""
    folder = record_folder(folder)
    try:
        if not folder.is_dir():
            what = f"is a file; give the folder of the record or its {NAME}" if folder.exists() else "no such folder"
            raise BenchInputError(what, file=folder)
        if not (folder / NAME).is_file():
            raise BenchInputError(f"holds no {NAME}; `thermohyd new` writes a template", file=folder)
    except (OSError, ValueError) as error:  # a name that no file system takes
        raise BenchInputError(f"cannot be read ({error})", file=folder) from None
    return folder, read_bench_toml(folder / NAME)


def read_record(folder: str | Path, *, readings_required: bool = True) -> BenchRecord:
    """The record in a folder (docs/bench_format.md), or the one whose bench.toml is named. With `readings_required=False`
    (predictions) readings may be missing: a test without any then has no channels.

    Raises BenchInputError, and nothing else, for whatever is wrong with the folder or its files.
    """
    folder, bench = described_record(folder)
    record = record_of(bench, read_tables(bench), folder, readings_required=readings_required)
    try:
        provenance = provenance_of(folder, folder / NAME, record.tests.values())
    except OSError as error:  # gone since it was read
        raise BenchInputError(f"cannot be read ({error.strerror})", file=error.filename) from None
    return replace(record, provenance=provenance)


@dataclass(frozen=True)
class EachTest:
    """The tests of a record read one by one. refused: {test: why a fit would not take it}; record: of all others, None without
    any. without_readings: of the refused those that predictions would take.
    """

    tables: dict[str, BenchTable]
    refused: dict[str, BenchInputError]
    without_readings: tuple[str, ...]
    record: BenchRecord | None


def read_each_test(bench: BenchFile, folder: Path) -> EachTest:
    """Read every test by itself, so that a mistake in one hides none in another. Raises BenchInputError about the whole alone."""
    tables: dict[str, BenchTable] = {}
    refused: dict[str, BenchInputError] = {}
    bare: list[str] = []
    for test in (*bench.tests.values(), *bench.dynamic.values()):
        try:
            table = _read_table(test, bench)
            record_of(_only(bench, [test.name]), {test.name: table}, folder, readings_required=False)
        except BenchInputError as error:
            refused[test.name] = error
            continue
        tables[test.name] = table
        try:
            record_of(_only(bench, [test.name]), {test.name: table}, folder)
        except BenchInputError as error:
            refused[test.name] = error
            bare.append(test.name)
    if not tables:
        return EachTest({}, refused, (), None)
    record = record_of(_only(bench, list(tables)), tables, folder, readings_required=False)
    return EachTest(tables, refused, tuple(bare), record)


def _only(bench: BenchFile, names: list[str]) -> BenchFile:
    """The description with some of its tests."""
    return replace(
        bench,
        tests={name: test for name, test in bench.tests.items() if name in names},
        dynamic={name: test for name, test in bench.dynamic.items() if name in names},
    )


def record_of(
    bench: BenchFile, tables: dict[str, BenchTable], folder: Path, *, readings_required: bool = True
) -> BenchRecord:
    """The record that a description and the tables of its tests make, wherever both come from. Raises BenchInputError."""
    tests = {test.name: _read_test(test, tables[test.name], bench, readings_required) for test in bench.tests.values()}
    moving = {
        name: dynamic_test_of(test, tables[name], bench, readings_required) for name, test in bench.dynamic.items()
    }
    warnings = [w for name, test in tests.items() for w in static_warnings(test, tables[name], bench)]
    warnings = [*rating_warnings(bench), *warnings]
    for name, test in moving.items():
        warnings += condition_warnings(test, tables[name], bench)
    return BenchRecord(
        folder,
        bench.valve.name,
        at_first_row(bench.valve, tests),
        bench.oil,
        {**tests, **moving},
        bench.start,
        warnings=tuple(warnings),
        actuator=bench.actuator,
        actuator_given=bench.actuator_given,
        sensors=_sensors(bench, tables),
        piston_area_given=bench.piston_area_given,
        service=bench.service,
    )


def _sensors(bench: BenchFile, tables: dict[str, BenchTable]) -> dict[str, Sensor]:
    """The sensors, those of free gain with the signal that the files have."""
    seen = [(column, name, table) for name, table in tables.items() for column in table.signals]
    found = dict(bench.sensors)
    for column, _, table in seen:
        own = "piston_position" if column == "command" and column not in found else column
        sensor, signal = found.get(own), table.signals[column]
        if sensor is None or sensor.gain is not None:
            continue
        if sensor.signal not in (None, signal):
            raise table.error(
                column, None, f"is in {signal}, but elsewhere in {sensor.signal}: one sensor gives one kind of signal"
            )
        found[own] = replace(sensor, signal=signal)
    return found


def _read_test(test: StaticTest, table: BenchTable, bench: BenchFile, readings_required: bool) -> TestRecord:
    check_sensors(table, test)
    check_columns(table, test, bench, readings_required)
    position, abscissa = _position(table, bench, test)
    given = {name: condition(table, bench, name) for name in CONDITIONS}
    check_supply(table, bench, given["supply_pressure"], given["return_pressure"])
    load_pressure = table.values["load_pressure"] if test.name == "load_flow" else None
    channels = channels_of(table, test, tuple(reading for reading in READINGS[test.name] if reading in table.values))
    run, run_names = runs(table)
    time = table.values.get("time")
    if time is not None and (back := first_step_back(time, run)) is not None:
        raise table.error(
            "time",
            back,
            "time runs backwards within one run; keep the order of the sweep, and give each sweep its own run",
        )
    return TestRecord(
        name=test.name,
        path=test.file,
        spool_position=position,
        supply_pressure=given["supply_pressure"],
        return_pressure=given["return_pressure"],
        temperature=given["temperature"],
        channels=channels,
        run=run,
        run_names=run_names,
        direction=sweep_direction(position, run),
        load_pressure=load_pressure,
        time=time,
        rate=None if time is None else sweep_rate(position, time, run),
        lines=table.lines,
        abscissa=abscissa,
        table=table.table,
        notes=table.notes,
        meter=test.meter,
        position_std=test.noise.get("spool_position"),
        stated_noise=test.noise,
        stated_instrument=(test.gain, test.zero),
    )


def _position(table: BenchTable, bench: BenchFile, test: StaticTest) -> tuple[np.ndarray, str]:
    valve = bench.valve
    if "spool_position" in table.values:
        name, position = "spool_position", table.values["spool_position"]
    else:
        name = "current"
        if valve.rated_current is None:
            raise bench.source.root.table_error(
                "valve", f'rated_current is missing, but {test.file.name} has a current; write rated_current = "25 mA"'
            )
        position = valve.stroke * table.values["current"] / valve.rated_current * valve.polarity
    far = np.flatnonzero(np.abs(position) > 2.0 * valve.stroke)
    if len(far):
        row = int(far[0])
        cell = table.text(name, row)
        limit, full = "the stroke", column_unit("stroke").words(valve.stroke, 6)
        if name == "current" and valve.rated_current is not None:
            limit, full = "the rated current", column_unit("rated_current").words(valve.rated_current, 6)
        number = float(np.abs(position[far[0]]) / table.units[name].scale) if name == "spool_position" else 0.0
        fitting = (u for u in ("um", "mm", "inch") if 0.02 * valve.stroke <= to_si(number, u) <= 2.0 * valve.stroke)
        hint = next((f" In {unit} it would fit" for unit in fitting), "")
        raise table.error(name, row, f"{cell} is beyond twice {limit} ({full}); is the unit right?{hint}")
    return position, name
