"""Read and check a record's bench.toml: everything but the CSV files."""

from dataclasses import dataclass, field
from pathlib import Path

from ..oil_definition import OilDefinition
from .actuator_table import read_actuator
from .bench_tests import DynamicTestTable, StaticTest, read_tests
from .columns_of_tests import CONDITIONS
from .errors import quoted
from .oil_table import read_oil
from .physical_limits import impossible, wrong_size
from .record import ActuatorData, StartValue, ValveData
from .start_table import read_start
from .toml_source import TomlSource, TomlTable
from .units import number_of


TABLES = ("valve", "oil", "conditions", "tests", "actuator", "start")
SIZED = {
    "stroke": "length",
    "slot_width": "length",
    "land_diameter": "length",
    "rated_flow": "flow",
    "rated_pressure_drop": "pressure",
    "rated_current": "current",
}
VALVE = ("name", *SIZED, "polarity")


@dataclass(frozen=True)
class BenchFile:
    """A bench.toml, SI units. actuator: None without dynamic tests; actuator_given: its table is in the file."""

    source: TomlSource
    valve: ValveData
    oil: OilDefinition
    conditions: dict[str, float]
    tests: dict[str, StaticTest]
    dynamic: dict[str, DynamicTestTable]
    actuator: ActuatorData | None
    actuator_given: bool
    start: dict[str, StartValue] = field(default_factory=dict)


def read_bench_toml(path: Path) -> BenchFile:
    """Raises BenchInputError with file, line and key."""
    root = TomlSource(path).root
    root.refuse_unknown(TABLES, "table")
    valve = _valve(_needed(root, "valve"), path)
    oil = read_oil(_needed(root, "oil"))
    conditions = _conditions(root.table("conditions"))
    table = root.table("actuator")
    actuator = read_actuator(TomlTable(root.source, ("actuator",), {}) if table is None else table, valve)
    tests, dynamic = read_tests(_needed(root, "tests"), actuator)
    start = root.table("start")
    used = actuator if dynamic else None
    starts = {} if start is None else read_start(start, valve, used)
    return BenchFile(root.source, valve, oil, conditions, tests, dynamic, used, table is not None, starts)


def _needed(root: TomlTable, name: str) -> TomlTable:
    table = root.table(name)
    if table is None:
        holds = {
            "valve": "stroke and slot_width",
            "oil": "a preset or viscosity points",
            "tests": "[tests.leakage]",
        }
        raise root.error(f"[{name}] is missing; it holds {holds[name]}")
    return table


def _valve(table: TomlTable, path: Path) -> ValveData:
    table.refuse_unknown(VALVE)
    sizes = {key: _size(table, key, kind) for key, kind in SIZED.items()}
    stroke, slot_width = sizes["stroke"], sizes["slot_width"]
    if stroke is None or slot_width is None:
        key, example = ("stroke", "213 um") if stroke is None else ("slot_width", "12 mm")
        raise table.error(f'{key} is missing; write for example {key} = "{example}"')
    polarity = table.data.get("polarity", 1)
    if isinstance(polarity, bool) or polarity not in (1, -1):
        raise table.error(
            f"{quoted(polarity)} must be 1, or -1 where a positive current gives a negative flow", "polarity"
        )
    return ValveData(
        name=table.text("name") or path.absolute().parent.name,
        stroke=stroke,
        slot_width=slot_width,
        land_diameter=sizes["land_diameter"],
        rated_flow=sizes["rated_flow"],
        rated_pressure_drop=sizes["rated_pressure_drop"],
        rated_current=sizes["rated_current"],
        polarity=int(polarity),
    )


def _size(table: TomlTable, key: str, kind: str) -> float | None:
    value = table.quantity(key, kind, sign="positive")
    if value is not None and (problem := wrong_size(key, value, number_of(table.data[key]))):
        raise table.error(f"{quoted(table.data[key])} {problem}", key)
    return value


def _conditions(table: TomlTable | None) -> dict[str, float]:
    found = {"return_pressure": 0.0}
    if table is None:
        return found
    table.refuse_unknown(tuple(CONDITIONS))
    for key, kind in CONDITIONS.items():
        value = table.quantity(key, kind)
        if value is None:
            continue
        if problem := impossible(kind, value, number_of(table.data[key])):
            raise table.error(f"{quoted(table.data[key])} {problem}", key)
        found[key] = value
    return found
