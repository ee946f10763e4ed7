"""The columns that both kinds of tests share: conditions, readings with their noise and sensors, runs. No JAX here."""

from dataclasses import replace

import numpy as np
import pandas as pd

from .columns import READINGS
from .errors import listed, quoted
from .headers import lacking, likely_columns, mapping
from .sensors import Sensor
from .test_file import BenchTable
from .test_record import Channel, kind_of_test
from .test_tables import StaticTest
from .valve_tables import BenchFile


EXAMPLES = {"supply_pressure": "70 bar", "temperature": "40 degC"}


def check_columns(table: BenchTable, test: StaticTest, bench: BenchFile, readings: bool) -> None:
    """Raise BenchInputError, one about all of them, where a test lacks columns. readings: a fit's are needed, too."""
    lacks = lacking(test, table.values, bench.conditions, readings=readings)
    if not lacks:
        return
    source = table.source
    names = [name for lack in lacks for name in lack.names]
    unused = [place for place, header in enumerate(source.header) if header in table.unused]
    meant = {name: place for place, name in likely_columns(test, source, unused, names).items()}
    stated = {lack.names[0] for lack in lacks} & set(EXAMPLES)
    values = " and ".join(f'{name} = "{EXAMPLES[name]}"' for name in EXAMPLES if name in stated)
    they = "they are" if len(meant) > 1 else "it is"
    likely = " and ".join(quoted(source.header[place]) for place in meant.values())
    if len(stated) == len(lacks):
        many = len(stated) > 1
        raise bench.source.root.table_error(
            "conditions",
            f"{' and '.join(lack.names[0] for lack in lacks)} {'are' if many else 'is'} missing: {test.file.name} has no such "
            f"column{'s' if many else ''}; write {values} in [conditions]"
            + (f"; or, if {they} {likely}, {mapping(test, source, meant)}" if meant else ""),
        )
    has = listed([quoted(header) for header in source.header], 8)
    needs = "; ".join(lack.words for lack in lacks)
    if stated:
        needs += f" (or {values} in [conditions])"
    they = "those are" if len(meant) > 1 else "that is"
    raise table.error(
        None,
        None,
        f"the {test.name} test needs {'a column' if len(lacks) == 1 else 'columns'} {needs}, but the {source.noun} has {has}"
        + (f"; if {they} {likely}, write {mapping(test, source, meant)}" if meant else ""),
    )


def condition(table: BenchTable, bench: BenchFile, name: str) -> np.ndarray:
    """A condition per row: its column, or the value of `[conditions]`."""
    return table.values[name] if name in table.values else np.full(table.rows, bench.conditions[name])


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
    """(code of each row's run, names of the runs). Raises BenchInputError where a sweep or a step would have a single row."""
    if table.run is None:
        return np.zeros(table.rows, dtype=int), ("",)
    codes, names = pd.factorize(table.run)
    if "frequency" not in table.values:
        _check_runs(table, codes, [str(name) for name in names])
    return codes.astype(int), tuple(str(name) for name in names)


def _check_runs(table: BenchTable, codes: np.ndarray, names: list[str]) -> None:
    """Raise BenchInputError where a run has one row: it would be a sweep, or a step, without any course."""
    single = np.flatnonzero(np.bincount(codes) == 1)
    if len(single):
        sizes = table.run_sizes()
        single = [code for code in single.tolist() if sizes[names[code]] == 1]
    if len(single):
        row = int(np.flatnonzero(codes == single[0])[0])
        more = "" if len(single) == 1 else f" ({len(single):,} runs are such)"
        raise table.error(
            "run",
            row,
            f"run {quoted(names[single[0]])} has one row{more}; a run is a whole sweep, and each of its rows bears its name: "
            "correct it, or list the column in ignore",
        )
