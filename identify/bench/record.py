"""What a bench record is once it has been read: plain NumPy in SI units, no JAX.

The reader (`read_record`) makes these, `reduction` shortens them, `fit` and `simulate` consume them.
"""

from collections.abc import Container, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from thermohyd.oil_definition import OilDefinition

from .columns import reading_unit
from .sensors import Sensor
from .service import Service
from .shown_units import DisplayUnit
from .test_record import STATIC_TESTS, DynamicTest, TestRecord, dynamic_among


# The edge laws of `thermohyd.edge`, named here too for readers that do without JAX.
EDGE_LAWS = ("orifice", "lubrication")


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
    service: Service = field(default_factory=Service)  # whose test it was, and when

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
