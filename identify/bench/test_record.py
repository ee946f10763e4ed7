"""One test of a bench record once it has been read, static or in motion: plain NumPy in SI units, no JAX."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from .sensors import Sensor


STATIC_TESTS = ("leakage", "pressure_gain", "flow_gain", "load_flow")
DYNAMIC_TESTS = ("step", "frequency")  # these, or several of a kind: step_slow, step_cold


def kind_of_test(name: str) -> str:
    """ "step" of "step" and of "step_slow", "frequency" likewise; of a static test its name, which is its kind.

    Names of tests become names of files and of figures, so those of one's own begin with their kind: no clash, and
    whoever holds only the name knows how to draw it.
    """
    return next((kind for kind in DYNAMIC_TESTS if name.startswith(f"{kind}_")), name)


def is_dynamic(name: str) -> bool:
    """Whether a test of this name is a step or a frequency test."""
    return kind_of_test(name) in DYNAMIC_TESTS


@dataclass(frozen=True)
class Channel:
    """One measured reading of a test, one value per row (SI).

    `std` is what the user declared (`noise` or `<reading>_std`), or what a reduction measured; None where nothing is known.
    `std_source` says where it came from, in words that a report can print.
    """

    name: str  # leakage_flow, load_pressure, pressure_a, pressure_b or flow
    value: np.ndarray
    std: np.ndarray | None = None
    std_source: str = ""
    # The step to which the log rounded each reading (0 where no rounding was seen).
    rounding: np.ndarray | None = None
    # Degrees of freedom from which `std` was estimated; infinite where it was stated.
    freedom: float = np.inf
    # Standard deviation that the position's noise adds to each reading, by the curve's slope; None: positions count as exact.
    position_part: np.ndarray | None = None
    # What was added to each reading as it was taken along its curve to the smooth sweep's position; None: they are as read.
    moved: np.ndarray | None = None
    # What made the signal behind it, where a fit estimates that; `value` and `std` are then signals if its gain is free.
    sensor: Sensor | None = None

    @property
    def as_read(self) -> np.ndarray:
        """The readings at the positions that were read, rounded as the file has them (rows,)."""
        return self.value if self.moved is None else self.value - self.moved

    @property
    def signal(self) -> str:
        """The unit of a signal, "V" or "count"; empty where the values are SI."""
        return "" if self.sensor is None else self.sensor.shown_as


@dataclass(frozen=True)
class Nodes:
    """Where within the rows of each reduced point the model is evaluated, so that means are compared with means.

    offset (points, nodes): from the point's mean position, or from its mean load pressure where that is swept (SI);
    time (points, nodes): from its mean time [s]; weight (points, nodes): of the model's readings there, summing to 1.
    """

    offset: np.ndarray
    time: np.ndarray
    weight: np.ndarray
    axis: str = "spool_position"  # or "load_pressure"

    @property
    def count(self) -> int:
        return self.weight.shape[1]


@dataclass(frozen=True)
class FaultyRow:
    """A row that is no reading of the valve: its file, line (None: of arrays) and run; sigma: how far beyond its neighbours."""

    file: str
    line: int | None
    run: str
    sigma: float | None = None

    @property
    def words(self) -> str:
        if self.line is None:
            return self.file
        return f"{self.file}, {'line' if '.' in self.file else 'row'} {self.line}"  # of arrays the name is the test's alone


@dataclass(frozen=True)
class Fault:
    """What was wrong with the bench in a test, and the rows that it spoiled; masked: they were left out.

    name: "outliers" (value: how many), "clipped" or "meter_dead_band" (value: the reading at which it stood, SI). Or what a
    diagnosis found: "position_zero", "reading_zero", "reading_drift", "wrong_temperature", "wrong_supply" (value: by how much
    what was read is too large, SI, with its standard error). test: "" where it is of several. run: the run or condition, "" where
    it is of a whole test. alternatives: names of effects and faults that would do as well. gap_closed: share of the gap that opens again
    without it.
    """

    name: str
    test: str
    channel: str
    value: float
    unit: str
    rows: tuple[FaultyRow, ...]
    sentence: str
    masked: bool = True
    run: str = ""
    std: float | None = None
    p_value: float | None = None
    alternatives: tuple[str, ...] = ()
    gap_closed: float | None = None


@dataclass(frozen=True)
class TestRecord:
    """One static test of a record; every array has one entry per row, in the order of the sweep, SI units."""

    __test__ = False  # not a pytest class

    name: str
    path: Path
    spool_position: np.ndarray  # m, as read: null bias and scale are the model's business
    supply_pressure: np.ndarray  # Pa, gauge
    return_pressure: np.ndarray  # Pa, gauge
    temperature: np.ndarray  # K
    channels: tuple[Channel, ...]
    run: np.ndarray  # int codes, 0 .. len(run_names) - 1
    run_names: tuple[str, ...]
    direction: np.ndarray  # +1, -1: sign of the last change of position within the run; a repeated position keeps it
    load_pressure: np.ndarray | None = None  # the imposed one, load_flow only
    time: np.ndarray | None = None  # s
    rate: np.ndarray | None = None  # m/s, dx/dt along the sweep, where there is time
    lines: np.ndarray | None = None  # line of each row in its file, for messages
    rows_of_log: np.ndarray | None = None  # how many rows of the log a point stands for (1 unless reduced)
    abscissa: str = "spool_position"  # or "current": what the file had
    table: pd.DataFrame | None = None  # the user's own columns, for `simulate` to write back
    notes: tuple[str, ...] = ()  # what a reader or a reduction did, for the report
    nodes: Nodes | None = None  # of a reduced log: its readings are means over bins
    meter: str = "return"  # where a leakage is read; or "supply"
    position_std: float | None = None  # m: the stated noise of the positions
    faults: tuple[Fault, ...] = ()  # of the bench, found so far
    # {position or condition: (rows,)}: standard error of what was logged as a reduction left it, SI; others count as exact.
    input_error: Mapping[str, np.ndarray] = field(default_factory=dict)
    # {position: (rows, rows)}: covariance of these errors, SI, where rows share them: `input_error` is then as of rows that share none.
    input_covariance: Mapping[str, np.ndarray] = field(default_factory=dict)
    # What bench.toml says of readings, made or not: {reading: standard deviation, SI}; tolerances of gain and zero (shares).
    stated_noise: Mapping[str, float] = field(default_factory=dict)
    stated_instrument: tuple[float | None, float | None] = (None, None)

    @property
    def rows(self) -> int:
        return len(self.spool_position)

    def channel(self, name: str) -> Channel:
        """The channel of this name; StopIteration without one."""
        return next(channel for channel in self.channels if channel.name == name)

    @property
    def runs(self) -> dict[str, np.ndarray]:
        """{what a run is called, its number where it has no name: its rows (rows,), True or False}."""
        codes = np.unique(self.run).tolist()
        return {self.run_names[code] if self.run_names else str(code + 1): self.run == code for code in codes}

    @property
    def axis(self) -> str:
        """What the readings run along: spool_position, or of a dynamic test time or frequency."""
        return "spool_position"

    @property
    def in_motion(self) -> bool:
        """Whether the spool moves during a reading."""
        return self.axis != "spool_position"

    @property
    def place(self) -> np.ndarray:
        """What the rows are drawn over (rows,), SI: the position here, time or frequency in a dynamic test."""
        return self.spool_position

    @property
    def conditions(self) -> dict[str, np.ndarray]:
        """{quantity: (rows,)}: the columns that say where the test was run, SI; the command of a dynamic test by its kind."""
        found = {name: getattr(self, name) for name in ("supply_pressure", "return_pressure", "temperature")}
        return found | {name: column for name, column in self._driven.items() if column is not None and len(column)}

    @property
    def _driven(self) -> dict[str, np.ndarray | None]:
        return {"spool_position": self.spool_position, "load_pressure": self.load_pressure}


@dataclass(frozen=True)
class DynamicTest(TestRecord):
    """A step or a frequency test. `spool_position` says nothing here (0); what is measured of it is a channel.

    command: setpoint [m], current [A] or spool position [m] by `command_kind`. external_force [N]: None, the actuator's own.
    frequency [Hz], output and absolute: of a frequency test only. Each run starts at equilibrium under its first row.
    """

    command: np.ndarray = field(default_factory=lambda: np.zeros(0))
    command_kind: str = "setpoint"  # or "current", "spool_position"
    external_force: np.ndarray | None = None
    frequency: np.ndarray | None = None
    output: str = "spool_position"
    absolute: bool = False
    # Of a command in volts or counts whose gain is estimated: `command` is command_reference * (signal - the sensor's zero).
    command_sensor: Sensor | None = None
    command_reference: float = 1.0

    @property
    def axis(self) -> str:
        return "time" if self.frequency is None else "frequency"

    @property
    def kind(self) -> str:
        """ "step" or "frequency" """
        return kind_of_test(self.name)

    @property
    def _driven(self) -> dict[str, np.ndarray | None]:
        command = {self.command_kind: self.command}
        if self.command_sensor is not None and self.command_sensor.gain is None:
            command = {"command_signal": self.command / self.command_reference}
        return {**command, "frequency": self.frequency, "external_force": self.external_force}

    @property
    def place(self) -> np.ndarray:
        found = self.time if self.frequency is None else self.frequency
        assert found is not None
        return found


def dynamic_among(tests: Mapping[str, TestRecord]) -> dict[str, DynamicTest]:
    """The step and frequency tests among these."""
    return {name: test for name, test in tests.items() if isinstance(test, DynamicTest)}
