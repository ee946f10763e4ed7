"""Read the step and frequency tests of a record: columns checked against what an actuator can be told and can do."""

import numpy as np

from .bench_csv import BenchTable
from .bench_tests import DynamicTestTable
from .bench_toml import BenchFile
from .columns_of_tests import CONDITIONS, READINGS
from .plausibility import check_supply
from .record import DynamicData, DynamicTest
from .table_parts import channels_of, condition, missing, runs


def read_dynamic(bench: BenchFile, tables: dict[str, BenchTable], *, readings_required: bool) -> DynamicData | None:
    """The dynamic tests with their actuator; None where the record has none. Raises BenchInputError."""
    if bench.actuator is None:
        return None
    tests = {name: _read(test, tables[name], bench, readings_required) for name, test in bench.dynamic.items()}
    return DynamicData(bench.actuator, tests, bench.actuator_given)


def _read(test: DynamicTestTable, table: BenchTable, bench: BenchFile, required: bool) -> DynamicTest:
    run, run_names = runs(table)
    step = test.name == "step"
    time = _time(table, test, run) if step else None
    frequency = None if step else _frequency(table, test)
    command, kind = _command(table, test, bench)
    found = tuple(reading for reading in READINGS[test.name] if reading in table.values)
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
    )


def _examples(test: DynamicTestTable) -> tuple[str, ...]:
    return (
        ("piston_position [mm]", "pressure_a [bar]") if test.name == "step" else ("amplitude_ratio [1]", "phase [deg]")
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


def _command(table: BenchTable, test: DynamicTestTable, bench: BenchFile) -> tuple[np.ndarray, str]:
    """(command per row, its kind). A frequency test without a command runs about 0."""
    assert bench.actuator is not None
    closed = bench.actuator.closed_loop
    if "command" not in table.values:
        if test.name == "step":
            example = "command [mm], a setpoint of the piston" if closed else "command [um] or command [mA]"
            raise missing(table, test, example)
        by_current = table.kinds.get("amplitude_ratio", "").endswith("per current")
        return np.zeros(table.rows), "setpoint" if closed else "current" if by_current else "spool_position"
    command = table.values["command"]
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
    _check_size(table, "command", command, limit, words)
    return command, kind


def _check_reading(table: BenchTable, bench: BenchFile, test: DynamicTestTable, reading: str) -> None:
    assert bench.actuator is not None
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
