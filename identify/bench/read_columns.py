"""The columns that both kinds of tests share: conditions, readings with their noise and sensors, runs. No JAX here."""

from dataclasses import replace

import numpy as np
import pandas as pd

from .columns import READINGS
from .errors import BenchInputError, listed, quoted
from .headers import likely_header, mapping
from .sensors import Sensor
from .test_file import BenchTable
from .test_record import Channel, kind_of_test
from .test_tables import StaticTest
from .valve_tables import BenchFile


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
