"""What a bench record is once it has been read: plain NumPy in SI units, no JAX.

The reader (`read_record`) makes these, `reduction` shortens them, `fit` and `simulate` consume them.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from ..oil_definition import OilDefinition


STATIC_TESTS = ("leakage", "pressure_gain", "flow_gain", "load_flow")
DYNAMIC_TESTS = ("step", "frequency")


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

    @property
    def rows(self) -> int:
        return len(self.spool_position)


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
