"""What a bench record is once it has been read: plain NumPy in SI units, no JAX.

The reader (`read_record`) makes these, `reduction` shortens them, `fit` and `simulate` consume them.
"""

from collections.abc import Container, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thermohyd.oil_definition import OilDefinition

from .columns import reading_unit
from .sensors import Sensor
from .shown_units import DisplayUnit


# The edge laws of `thermohyd.edge`, named here too for readers that do without JAX.
EDGE_LAWS = ("orifice", "lubrication")
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
class ValveData:
    """The `[valve]` table. Lengths in m, flow in m3/s, pressure in Pa, current in A.

    null_pressure: supply pressure at which the null bias holds; that of a record's first row.
    """

    name: str
    stroke: float
    slot_width: float
    land_diameter: float | None = None
    rated_flow: float | None = None
    rated_pressure_drop: float | None = None
    rated_current: float | None = None
    polarity: int = 1
    null_pressure: float | None = None
    edge_law: str = "orifice"  # one of EDGE_LAWS
    # Whether the record states them; else slot_width is worked out from the rated flow, and the stroke is a stand-in.
    slot_width_stated: bool = True
    stroke_stated: bool = True


@dataclass(frozen=True)
class StartValue:
    """One entry of `[start]`: where a parameter starts, whether it is held, and what is known of it beforehand (SI)."""

    value: float
    fixed: bool = False
    freed: bool = False  # `fixed = false` in so many words: a dynamic fit then frees what it holds by default
    prior_std: float | None = None  # a Gaussian prior around `value`
    lower: float | None = None
    upper: float | None = None


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
    # What made the signal behind it, where a fit estimates that; `value` and `std` are then signals if its gain is free.
    sensor: Sensor | None = None

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
    it is of a whole test. alternatives: names of effects and faults that would do as well.
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


def at_first_row(valve: ValveData, tests: Mapping[str, TestRecord]) -> ValveData:
    """The valve with its null bias counted from the supply pressure of the first row, unless it says from which one.

    The first row of leakage, pressure_gain, flow_gain, load_flow, in this order; without any of them the valve as it is.
    """
    if valve.null_pressure is not None:
        return valve
    first = next((tests[name] for name in STATIC_TESTS if name in tests and tests[name].rows), None)
    return valve if first is None else replace(valve, null_pressure=float(first.supply_pressure[0]))


# What both sides of a jack share, SI, where nothing is said; an unequal jack has a pair instead, with _a and _b behind the name.
OF_BOTH_SIDES = {"piston_area": 12e-4, "chamber_volume": 60e-6}


def misgiven_side(given: Container[str]) -> tuple[str, str] | None:
    """(key, what is wrong with it) where an area or a volume is given as half a pair, or as a pair and for both sides at once."""
    for shared in OF_BOTH_SIDES:
        a, b = f"{shared}_a", f"{shared}_b"
        if shared in given and (a in given or b in given):
            return shared, f"holds for both sides: give either {shared} or the pair {a}, {b}"
        if (a in given) != (b in given):
            one, other = (a, b) if a in given else (b, a)
            return (
                one,
                f"is of one side only and {other} is missing: give both of them, or {shared} for a jack of equal sides",
            )
    return None


@dataclass(frozen=True)
class ActuatorData:
    """The `[actuator]` table, SI. Without a controller its two gains are None, and the command drives the valve.

    piston_area, chamber_volume: of both sides, 12 cm2 and 60 cm3 where nothing is said; None where there is a pair of them.
    """

    piston_area: float | None = None
    chamber_volume: float | None = None
    piston_stroke: float = 50e-3
    moving_mass: float = 50.0
    viscous_friction: float = 2000.0
    coulomb_friction: float = 0.0
    jack_leakage: float = 0.0
    spool_frequency: float = 100.0
    spool_damping: float = 0.7
    external_force: float = 0.0
    amplifier_gain: float | None = None
    sensor_gain: float | None = None
    heat: str = "adiabatic"  # or "isothermal"
    piston_area_a: float | None = None
    piston_area_b: float | None = None
    chamber_volume_a: float | None = None
    chamber_volume_b: float | None = None

    def __post_init__(self) -> None:
        for shared, default in OF_BOTH_SIDES.items():
            if all(getattr(self, f"{shared}{side}") is None for side in ("", "_a", "_b")):
                object.__setattr__(self, shared, default)

    @property
    def closed_loop(self) -> bool:
        return self.amplifier_gain is not None

    def to_dict(self) -> dict[str, Any]:
        """The table for a JSON: of areas and volumes what was given, and null for a gain where there is no controller."""
        return {key: v for key, v in asdict(self).items() if v is not None or not key.startswith(tuple(OF_BOTH_SIDES))}


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


@dataclass(frozen=True)
class RecordFile:
    """A file of a record as it was read. rows: in the file; used: those that can take part; None: it is no table."""

    name: str
    sha256: str
    rows: int | None
    used: int | None


@dataclass(frozen=True)
class Provenance:
    """Where a record was read from, when (ISO 8601, local time with its offset), and by which version of the program.

    path: of one made from arrays, its name and a word; its files are then those arrays.
    """

    path: str
    files: tuple[RecordFile, ...]
    date: str
    version: str


@dataclass(frozen=True)
class BenchRecord:
    """A bench record, read and checked: from a folder with `bench.toml` by `read_record`, or from arrays or DataFrames.

    folder: of a record from arrays, its name alone. tests: static ones, then dynamic ones. actuator: of the dynamic tests,
    None where there are none; actuator_given: described in the file, and not the example that stands in.
    """

    folder: Path
    name: str
    valve: ValveData
    oil: OilDefinition
    tests: dict[str, TestRecord]
    start: dict[str, StartValue] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    actuator: ActuatorData | None = None
    actuator_given: bool = True
    provenance: Provenance | None = None  # None: not read from files
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # by column
    piston_area_given: bool = True  # in the file: the scale of every length of the piston

    @property
    def static_tests(self) -> dict[str, TestRecord]:
        """The tests whose rows are each at equilibrium."""
        return {name: test for name, test in self.tests.items() if not test.in_motion}

    @property
    def dynamic_tests(self) -> dict[str, DynamicTest]:
        """The step and frequency tests."""
        return dynamic_among(self.tests)

    def unit_of(self, test: str, channel: str) -> DisplayUnit:
        """In which a reading is shown: the bench unit, or its signal's where the gain of its sensor is free."""
        found = self.tests[test].channels if test in self.tests else ()
        return reading_unit(channel, next((c.signal for c in found if c.name == channel), ""))

    @property
    def source(self) -> str:
        """The folder that it was read from, in full; else a word for the arrays."""
        return str(self.folder.resolve()) if self.provenance is None else self.provenance.path

    @classmethod
    def from_arrays(
        cls,
        tests: Mapping[str, Mapping[str, Any]],
        *,
        valve: Mapping[str, Any] | ValveData,
        oil: str | Mapping[str, Any] | OilDefinition,
        conditions: Mapping[str, Any] | None = None,
        actuator: Mapping[str, Any] | ActuatorData | None = None,
        start: Mapping[str, Any] | None = None,
        noise: Mapping[str, Any] | None = None,
        options: Mapping[str, Mapping[str, Any]] | None = None,
        sensors: Mapping[str, Any] | None = None,
        readings_required: bool = True,
    ) -> "BenchRecord":
        """A record from NumPy arrays: what `read_record` makes of the same rows in CSV files, to the last bit.

        Every value is a pint quantity, a text such as "70 bar", or a number in SI: m, m3/s, Pa (gauge), K, A, s, N, rad;
        frequencies in Hz.

        tests: {"leakage", "pressure_gain", "flow_gain", "load_flow", "step" or "frequency": {column: (rows,), or one value
        for all rows}}, with the columns of a CSV: spool_position or current, time, run (texts), the conditions, the readings
        and <reading>_std; in the order of the sweep. A number for the command of a loop that is open is a spool position.
        valve: name, stroke, slot_width, rated_current ... as in the table [valve]. oil: the name of a preset, a table as
        [oil], or an OilDefinition. conditions: for columns that a test does not have. actuator: as [actuator], for dynamic
        tests. start: as [start], such as {"clearance": 2e-6, "discharge_coefficient": {"value": 0.7, "fixed": True}}.
        noise: {test: standard deviation, or {reading: standard deviation}}. options: {test: columns, ignore, missing="skip",
        output, absolute, meter, command as in [tests.<name>]}. sensors: as [sensors], {"flow": {"gain": "free"}}; a number
        for a column of free gain is then a voltage.

        Raises BenchInputError: `file` is then the test's name, `column` the column, `row` counts from 0; its sentence calls
        arguments by their tables in a bench.toml, such as [valve] stroke.

        >>> record = BenchRecord.from_arrays(
        ...     {"leakage": {"spool_position": [-1e-5, 0.0, 1e-5], "leakage_flow": [1.1e-6, 2.3e-6, 1.2e-6]}},
        ...     valve={"stroke": 213e-6, "slot_width": "12 mm"},
        ...     oil="mil-prf-5606",
        ...     conditions={"supply_pressure": 70e5, "temperature": "40 degC"},
        ... )
        >>> print(record.tests["leakage"].temperature)
        [313.15 313.15 313.15]
        """
        from .arrays import record_from_arrays

        return record_from_arrays(
            tests,
            valve=valve,
            oil=oil,
            conditions=conditions,
            actuator=actuator,
            start=start,
            noise=noise,
            options=options,
            sensors=sensors,
            readings_required=readings_required,
        )

    @classmethod
    def from_dataframe(
        cls,
        tests: "Mapping[str, pd.DataFrame]",
        *,
        valve: Mapping[str, Any] | ValveData,
        oil: str | Mapping[str, Any] | OilDefinition,
        conditions: Mapping[str, Any] | None = None,
        actuator: Mapping[str, Any] | ActuatorData | None = None,
        start: Mapping[str, Any] | None = None,
        noise: Mapping[str, Any] | None = None,
        options: Mapping[str, Mapping[str, Any]] | None = None,
        sensors: Mapping[str, Any] | None = None,
        readings_required: bool = True,
    ) -> "BenchRecord":
        """A record from one DataFrame per test, whose columns have the headers of a CSV: "spool_position [um]", "run".

        An index with a name is a column. Everything else, the errors too, is as in `from_arrays`: other headers are named
        by options={"leakage": {"columns": {"spool_position": "LVDT [um]"}, "ignore": ["remarks"]}}.

        >>> table = pd.DataFrame({"spool_position [um]": [-10.0, 0.0, 10.0], "leakage_flow [l/min]": [0.066, 0.138, 0.072]})
        >>> record = BenchRecord.from_dataframe(
        ...     {"leakage": table},
        ...     valve={"stroke": "213 um", "slot_width": "12 mm"},
        ...     oil="mil-prf-5606",
        ...     conditions={"supply_pressure": "70 bar", "temperature": "40 degC"},
        ... )
        >>> print(record.tests["leakage"].spool_position)
        [-1.e-05  0.e+00  1.e-05]
        """
        from .arrays import record_from_dataframe

        return record_from_dataframe(
            tests,
            valve=valve,
            oil=oil,
            conditions=conditions,
            actuator=actuator,
            start=start,
            noise=noise,
            options=options,
            sensors=sensors,
            readings_required=readings_required,
        )
