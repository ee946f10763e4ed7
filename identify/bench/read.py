"""Read a bench record: a folder with bench.toml and one file per test, checked, in SI units. No JAX here.

Static and dynamic tests share the first part (file, conditions, readings, runs). Step and frequency tests are then checked
against what an actuator can be commanded and can do. `record_of` makes the record from tables that are already in memory.
"""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from .cells import BadCellsError, BadCellsOfTest
from .columns import CONDITIONS, READINGS, column_unit
from .errors import BenchInputError, listed, quoted, suggestion
from .headers import likely_header, mapping
from .plausibility import check_supply, condition_warnings, rating_warnings, static_warnings
from .provenance import provenance_of
from .record import BenchRecord, Channel, DynamicTest, TestRecord, at_first_row, kind_of_test
from .sensors import EACH_RUN, FREE, SIGNALS, Sensor
from .sweeps import first_step_back, sweep_direction, sweep_rate
from .test_file import BenchTable, read_bench_csv
from .test_tables import DynamicTestTable, StaticTest
from .units import to_si
from .valve_tables import BenchFile, read_bench_toml


NAME = "bench.toml"
# A full command as a signal, where nobody states its gain: only where a search begins.
FULL_SIGNAL = {"V": 10.0, "count": 2048.0}


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
    if not _is_file(test.file):
        endings = (".csv", ".csv.gz", ".xlsx", ".parquet")
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


def missing(table: BenchTable, test: StaticTest, what: str) -> BenchInputError:
    """An error: the test lacks a column. what: its name first, then what else there is to say of it."""
    has = listed([quoted(header) for header in table.source.header], 8)
    standard = what.split()[0]
    likely = likely_header(test, standard, table.unused)
    way = f"; if that is {quoted(likely)}, write {mapping(test, {standard: likely})}" if likely else ""
    return table.error(
        None, None, f"the {test.name} test needs a column {what}, but the {table.source.noun} has {has}{way}"
    )


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
        sensor = _by_data_sheet(test, table, reading) or _estimated(test.sensors.get(reading), table, reading)
        std, source = table.values.get(f"{reading}_std"), "declared per row"
        if std is None and reading in test.noise:
            std, source = np.full(table.rows, test.noise[reading]), f"declared in {test.table.source.words}"
        channels.append(Channel(reading, table.values[reading], std, "" if std is None else source, sensor=sensor))
    return tuple(channels)


def _estimated(sensor: Sensor | None, table: BenchTable, reading: str) -> Sensor | None:
    """The sensor of a column where a fit has something to find in it; None where its unit says all."""
    if sensor is None or not sensor.estimated:
        return None
    signal = table.signals.get(reading)
    if signal is None:
        return sensor if sensor.signal == "" else None
    return replace(sensor, signal=signal) if sensor.gain is None else sensor


def _by_data_sheet(test: StaticTest, table: BenchTable, reading: str) -> Sensor | None:
    """The instrument of a test whose gain and zero are known to a tolerance; None where they count as exact."""
    if test.gain is None and test.zero is None:
        return None
    if reading in test.sensors:
        key = "gain" if test.gain is not None else "zero"
        raise test.table.error(f"and [sensors] {reading} both speak of one instrument: say it in one place", key)
    size = float(np.max(np.abs(table.values[reading]), initial=0.0))
    zero = None if test.zero is None or size == 0.0 else test.zero * size
    return Sensor(reading, tolerance=test.gain, zero_tolerance=zero)


def check_sensors(table: BenchTable, test: StaticTest) -> None:
    """Raise BenchInputError where a sensor is to be estimated by what is no reading of the test."""
    allowed = (*READINGS[kind_of_test(test.name)], "command")
    for name, sensor in test.sensors.items():
        if name in table.values and name not in allowed and sensor.estimated:
            raise table.error(
                name, None,
                f"the {test.name} test runs along this column, which is no reading: state its gain and its zero in [sensors], "
                "without a tolerance",
            )  # fmt: skip


def runs(table: BenchTable) -> tuple[np.ndarray, tuple[str, ...]]:
    """(code of each row's run, names of the runs)"""
    if table.run is None:
        return np.zeros(table.rows, dtype=int), ("",)
    codes, names = pd.factorize(table.run)
    return codes.astype(int), tuple(str(name) for name in names)


def _read(test: DynamicTestTable, table: BenchTable, bench: BenchFile, required: bool) -> DynamicTest:
    check_sensors(table, test)
    run, run_names = runs(table)
    step = test.kind == "step"
    time = _time(table, test, run) if step else None
    frequency = None if step else _frequency(table, test)
    command, kind, sensor, reference = _command(table, test, bench)
    found = tuple(reading for reading in READINGS[test.kind] if reading in table.values)
    if required and not found:
        raise missing(table, test, f"{' or '.join(_examples(test))}, a reading")
    for reading in found:
        _check_reading(table, bench, test, reading)
    given = {name: condition(table, bench, test, name) for name in CONDITIONS}
    check_supply(table, bench, given["supply_pressure"], given["return_pressure"])
    zeros = np.zeros(table.rows)
    return DynamicTest(
        name=test.name,
        path=test.file,
        spool_position=zeros,
        supply_pressure=given["supply_pressure"],
        return_pressure=given["return_pressure"],
        temperature=given["temperature"],
        channels=channels_of(table, test, found),
        run=run,
        run_names=run_names,
        direction=zeros,
        time=time,
        lines=table.lines,
        table=table.table,
        notes=table.notes,
        command=command,
        command_kind=kind,
        external_force=table.values.get("external_force"),
        frequency=frequency,
        output=test.output,
        absolute=test.absolute,
        command_sensor=sensor,
        command_reference=reference,
    )


def _examples(test: DynamicTestTable) -> tuple[str, ...]:
    return (
        ("piston_position [mm]", "pressure_a [bar]") if test.kind == "step" else ("amplitude_ratio [1]", "phase [deg]")
    )


def _time(table: BenchTable, test: DynamicTestTable, run: np.ndarray) -> np.ndarray:
    """Time strictly rising within each run of at least two rows."""
    if "time" not in table.values:
        raise missing(table, test, "time [s]")
    time = table.values["time"]
    for code in np.unique(run):
        rows = np.flatnonzero(run == code)
        if len(rows) < 2:
            raise table.error("time", int(rows[0]), "a run of a step test needs at least two rows")
        back = np.flatnonzero(np.diff(time[rows]) <= 0.0)
        if len(back):
            raise table.error(
                "time",
                int(rows[back[0] + 1]),
                "time must rise from row to row within a run; give each run of the test its own name in a column run",
            )
    return time


def _frequency(table: BenchTable, test: DynamicTestTable) -> np.ndarray:
    if "frequency" not in table.values:
        raise missing(table, test, "frequency [Hz]")
    found = table.values["frequency"]
    wrong = np.flatnonzero(found <= 0.0)
    if len(wrong):
        raise table.error("frequency", int(wrong[0]), "a frequency must be above zero")
    return found


def _command(
    table: BenchTable, test: DynamicTestTable, bench: BenchFile
) -> tuple[np.ndarray, str, Sensor | None, float]:
    """(command per row, its kind, its sensor where a fit estimates that, by which gain it is kept). A frequency test without a
    command runs about 0."""
    assert bench.actuator is not None
    closed = test.closed_loop
    if "command" not in table.values:
        if test.kind == "step":
            example = "command [mm], a setpoint of the piston" if closed else "command [um] or command [mA]"
            raise missing(table, test, example)
        by_current = table.kinds.get("amplitude_ratio", "").endswith("per current")
        return np.zeros(table.rows), "setpoint" if closed else "current" if by_current else "spool_position", None, 1.0
    command = table.values["command"]
    sensor = _estimated(test.sensors.get("command"), table, "command")
    if sensor is not None and not sensor.signal:
        sensor = None  # a setpoint in millimetres has no zero to be found
    if sensor is not None and sensor.free_zero == EACH_RUN:
        raise table.error("command", None, f'a command has one zero: write zero = "{FREE}" in [sensors]')
    reference = 1.0 if sensor is None else sensor.reference
    if sensor is not None and sensor.gain is None:
        if closed and not sensor.in_loop:
            raise table.error(
                "command", None,
                "in closed loop the setpoint is compared with the piston's sensor: give [sensors] piston_position, and the "
                "controller no sensor_gain",
            )  # fmt: skip
        # A stand-in, by which a search begins: ten volts are the whole stroke.
        full = 0.5 * bench.actuator.piston_stroke if closed else bench.valve.stroke
        reference = full / (FULL_SIGNAL[sensor.signal or "V"])
        command = reference * (command - sensor.zero)
    kind = "setpoint" if closed else "current" if table.kinds["command"] == "current" else "spool_position"
    rated = bench.valve.rated_current
    if kind == "current" and rated is None:
        raise bench.source.root.table_error(
            "valve", f'rated_current is missing, but {test.file.name} has a current; write rated_current = "25 mA"'
        )
    limit, words = {
        "setpoint": (0.5 * bench.actuator.piston_stroke, "half the piston's stroke"),
        "current": (2.0 * (rated or np.inf), "twice the rated current"),
        "spool_position": (2.0 * bench.valve.stroke, "twice the stroke"),
    }[kind]
    if sensor is None or sensor.gain is not None:
        _check_size(table, "command", command, limit, words)
    return command, kind, sensor, reference


def _check_reading(table: BenchTable, bench: BenchFile, test: DynamicTestTable, reading: str) -> None:
    assert bench.actuator is not None
    if table.kinds[reading] in SIGNALS.values():
        return
    if reading == "spool_position":
        _check_size(table, reading, table.values[reading], 2.0 * bench.valve.stroke, "twice the stroke")
    if reading == "piston_position":
        _check_size(table, reading, table.values[reading], bench.actuator.piston_stroke, "the piston's stroke")
    if reading == "amplitude_ratio":
        wrong = np.flatnonzero(table.values[reading] <= 0.0)
        if len(wrong):
            raise table.error(reading, int(wrong[0]), "an amplitude ratio must be above zero; it is a ratio, not dB")


def _check_size(table: BenchTable, name: str, values: np.ndarray, limit: float, words: str) -> None:
    far = np.flatnonzero(np.abs(values) > limit * (1.0 + 1e-9))
    if len(far):
        row = int(far[0])
        cell = table.text(name, row)
        shown = f"{limit * 1e3:.6g} {'mA' if 'current' in words else 'mm'}"
        raise table.error(name, row, f"{cell} is beyond {words} ({shown}); is the unit right?")


def record_folder(path: str | Path) -> Path:
    """The folder of a record that is named by itself or by its bench.toml."""
    path = Path(path)
    return path.parent if path.name == NAME and not os.path.isdir(path) else path


def read_record(folder: str | Path, *, readings_required: bool = True) -> BenchRecord:
    """The record in a folder (docs/bench_format.md), or the one whose bench.toml is named. With `readings_required=False`
    (predictions) readings may be missing: a test without any then has no channels.

    Raises BenchInputError, and nothing else, for whatever is wrong with the folder or its files.
    """
    folder = record_folder(folder)
    try:
        if not folder.is_dir():
            what = f"is a file; give the folder of the record or its {NAME}" if folder.exists() else "no such folder"
            raise BenchInputError(what, file=folder)
        if not (folder / NAME).is_file():
            raise BenchInputError(f"holds no {NAME}; `thermohyd new` writes a template", file=folder)
    except (OSError, ValueError) as error:  # a name that no file system takes
        raise BenchInputError(f"cannot be read ({error})", file=folder) from None
    bench = read_bench_toml(folder / NAME)
    record = record_of(bench, read_tables(bench), folder, readings_required=readings_required)
    try:
        provenance = provenance_of(folder, folder / NAME, record.tests.values())
    except OSError as error:  # gone since it was read
        raise BenchInputError(f"cannot be read ({error.strerror})", file=error.filename) from None
    return replace(record, provenance=provenance)


def record_of(
    bench: BenchFile, tables: dict[str, BenchTable], folder: Path, *, readings_required: bool = True
) -> BenchRecord:
    """The record that a description and the tables of its tests make, wherever both come from. Raises BenchInputError."""
    tests = {test.name: _read_test(test, tables[test.name], bench, readings_required) for test in bench.tests.values()}
    moving = {name: _read(test, tables[name], bench, readings_required) for name, test in bench.dynamic.items()}
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
    position, abscissa = _position(table, bench, test)
    given = {name: condition(table, bench, test, name) for name in CONDITIONS}
    check_supply(table, bench, given["supply_pressure"], given["return_pressure"])
    load_pressure = None
    if test.name == "load_flow":
        load_pressure = table.values.get("load_pressure")
        if load_pressure is None:
            raise missing(table, test, "load_pressure [bar], the imposed load pressure")
    channels = _channels(table, test, readings_required)
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
    )


def _position(table: BenchTable, bench: BenchFile, test: StaticTest) -> tuple[np.ndarray, str]:
    valve = bench.valve
    if "spool_position" in table.values:
        name, position = "spool_position", table.values["spool_position"]
    elif "current" in table.values:
        name = "current"
        if valve.rated_current is None:
            raise bench.source.root.table_error(
                "valve", f'rated_current is missing, but {test.file.name} has a current; write rated_current = "25 mA"'
            )
        position = valve.stroke * table.values["current"] / valve.rated_current * valve.polarity
    else:
        raise missing(table, test, "spool_position [um] or current [mA]")
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


def _channels(table: BenchTable, test: StaticTest, required: bool) -> tuple[Channel, ...]:
    found = [reading for reading in READINGS[test.name] if reading in table.values]
    if required:
        if not found:
            what = {"pressure_gain": "load_pressure [bar], or pressure_a and pressure_b"}
            reading = next(iter(READINGS[test.name]))
            raise missing(table, test, what.get(test.name, f"{reading} [{column_unit(reading).label}]"))
        if len(found) == 1 and found[0] in ("pressure_a", "pressure_b"):
            other = {"pressure_a": "pressure_b", "pressure_b": "pressure_a"}[found[0]]
            raise missing(table, test, f"{other} [bar] beside {found[0]}")
    return channels_of(table, test, tuple(found))
