"""What a bench record is once it has been read: plain NumPy in SI units, no JAX.

The reader (`read_record`) makes these, `reduction` shortens them, `fit` and `simulate` consume them.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from thermohyd.oil_definition import OilDefinition


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
    """The `[valve]` table. Lengths in m, flow in m3/s, pressure in Pa, current in A."""

    name: str
    stroke: float
    slot_width: float
    land_diameter: float | None = None
    rated_flow: float | None = None
    rated_pressure_drop: float | None = None
    rated_current: float | None = None
    polarity: int = 1


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

    @property
    def rows(self) -> int:
        return len(self.spool_position)

    @property
    def place(self) -> np.ndarray:
        """What the rows are drawn over (rows,), SI: the position here, time or frequency in a dynamic test."""
        return self.spool_position


@dataclass(frozen=True)
class ActuatorData:
    """The `[actuator]` table, SI. Without a controller its two gains are None, and the command drives the valve."""

    piston_area: float = 12e-4
    chamber_volume: float = 60e-6
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

    @property
    def closed_loop(self) -> bool:
        return self.amplifier_gain is not None


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

    @property
    def kind(self) -> str:
        """ "step" or "frequency" """
        return kind_of_test(self.name)

    @property
    def place(self) -> np.ndarray:
        found = self.time if self.frequency is None else self.frequency
        assert found is not None
        return found


@dataclass(frozen=True)
class DynamicData:
    """The dynamic part of a record: its actuator and its step and frequency tests. given: [actuator] is in the file."""

    actuator: ActuatorData
    tests: dict[str, DynamicTest]
    given: bool = True


@dataclass(frozen=True)
class RecordFile:
    """A file of a record as it was read. rows: in the file; used: those that can take part; None: it is no table."""

    name: str
    sha256: str
    rows: int | None
    used: int | None


@dataclass(frozen=True)
class Provenance:
    """Where a record was read from, when (ISO 8601, local time with its offset), and by which version of the program."""

    path: str
    files: tuple[RecordFile, ...]
    date: str
    version: str


@dataclass(frozen=True)
class BenchRecord:
    """A folder with `bench.toml`, read and checked."""

    folder: Path
    name: str
    valve: ValveData
    oil: OilDefinition
    tests: dict[str, TestRecord]
    start: dict[str, StartValue] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    dynamic: DynamicData | None = None
    provenance: Provenance | None = None  # None: not read from files

    @property
    def all_tests(self) -> dict[str, TestRecord]:
        """Static tests, then dynamic ones."""
        return self.tests if self.dynamic is None else {**self.tests, **self.dynamic.tests}
