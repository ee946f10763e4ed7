"""Read a step or a frequency test, checked against what an actuator can be commanded and can do. No JAX here."""

import numpy as np

from .columns import CONDITIONS, READINGS
from .plausibility import check_supply
from .read_columns import _estimated, channels_of, check_columns, check_sensors, condition, runs
from .sensors import EACH_RUN, FREE, SIGNALS, Sensor
from .test_file import BenchTable
from .test_record import DynamicTest
from .test_tables import DynamicTestTable
from .valve_tables import BenchFile


# A full command as a signal, where nobody states its gain: only where a search begins.
FULL_SIGNAL = {"V": 10.0, "count": 2048.0}


def dynamic_test_of(test: DynamicTestTable, table: BenchTable, bench: BenchFile, required: bool) -> DynamicTest:
    """The test in a table's columns, SI. required: readings must be there. Raises BenchInputError."""
    check_sensors(table, test)
    check_columns(table, test, bench, required)
    run, run_names = runs(table)
    step = test.kind == "step"
    time = _time(table, run) if step else None
    frequency = None if step else _frequency(table)
    command, kind, sensor, reference = _command(table, test, bench)
    found = tuple(reading for reading in READINGS[test.kind] if reading in table.values)
    for reading in found:
        _check_reading(table, bench, test, reading)
    given = {name: condition(table, bench, name) for name in CONDITIONS}
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


def _time(table: BenchTable, run: np.ndarray) -> np.ndarray:
    """Time strictly rising within each run of at least two rows."""
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


def _frequency(table: BenchTable) -> np.ndarray:
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
