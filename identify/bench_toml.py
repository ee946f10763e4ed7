"""Read and check a record's bench.toml: everything but the CSV files."""

from dataclasses import dataclass, field
from pathlib import Path

from ..oil_definition import OilDefinition
from .actuator_table import check_actuator, check_dynamic_test
from .columns_of_tests import CONDITIONS, columns_of
from .errors import BenchInputError, quoted
from .noise_table import read_noise
from .oil_table import read_oil
from .physical_limits import impossible
from .record import DYNAMIC_TESTS, STATIC_TESTS, StartValue, ValveData
from .start_table import read_start
from .toml_source import TomlSource, TomlTable


TABLES = ("valve", "oil", "conditions", "tests", "actuator", "start")
RATED = ("rated_flow", "rated_pressure_drop", "rated_current")
VALVE = ("name", "stroke", "slot_width", "land_diameter", *RATED, "polarity")
STATIC_KEYS = ("file", "noise", "columns", "ignore")


@dataclass(frozen=True)
class StaticTest:
    """A `[tests.<name>]` table: where its rows are, and what the user says about its columns."""

    name: str
    file: Path
    noise: dict[str, float]  # {reading: standard deviation, SI}
    columns: dict[str, str]  # {standard column: the user's header}
    ignore: tuple[str, ...]
    table: TomlTable  # for messages


@dataclass(frozen=True)
class BenchFile:
    """A bench.toml, SI units."""

    source: TomlSource
    valve: ValveData
    oil: OilDefinition
    conditions: dict[str, float]
    tests: dict[str, StaticTest]
    start: dict[str, StartValue] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


def read_bench_toml(path: Path) -> BenchFile:
    """Raises BenchInputError with file, line and key."""
    root = TomlSource(path).root
    root.refuse_unknown(TABLES, "table")
    valve = _valve(_needed(root, "valve"), path)
    oil = read_oil(_needed(root, "oil"))
    conditions = _conditions(root.table("conditions"))
    tests, dynamic = _tests(_needed(root, "tests"))
    if (actuator := root.table("actuator")) is not None:
        check_actuator(actuator, valve)
    start = root.table("start")
    if not tests:
        raise BenchInputError(
            f"holds only dynamic tests ({', '.join(dynamic)}), which this version does not fit; "
            f"add one of {', '.join(STATIC_TESTS)}",
            file=path,
            line=root.source.line_of(("tests",)),
            key="[tests]",
        )
    warnings = tuple(f"{name}: dynamic tests are not fitted in this version; left out" for name in dynamic)
    return BenchFile(
        root.source, valve, oil, conditions, tests, {} if start is None else read_start(start, valve), warnings
    )


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
    lengths = {key: table.quantity(key, "length", sign="positive") for key in ("stroke", "slot_width", "land_diameter")}
    stroke, slot_width = lengths["stroke"], lengths["slot_width"]
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
        land_diameter=lengths["land_diameter"],
        rated_flow=table.quantity("rated_flow", "flow", sign="positive"),
        rated_pressure_drop=table.quantity("rated_pressure_drop", "pressure", sign="positive"),
        rated_current=table.quantity("rated_current", "current", sign="positive"),
        polarity=int(polarity),
    )


def _conditions(table: TomlTable | None) -> dict[str, float]:
    found = {"return_pressure": 0.0}
    if table is None:
        return found
    table.refuse_unknown(tuple(CONDITIONS))
    for key, kind in CONDITIONS.items():
        value = table.quantity(key, kind)
        if value is None:
            continue
        if problem := impossible(kind, value):
            raise table.error(f"{quoted(table.data[key])} {problem}", key)
        found[key] = value
    return found


def _tests(table: TomlTable) -> tuple[dict[str, StaticTest], list[str]]:
    names = (*STATIC_TESTS, *DYNAMIC_TESTS)
    table.refuse_unknown(names, "test")
    if not table.data:
        raise table.error(f"is empty; add one of {', '.join(f'[tests.{name}]' for name in names)}")
    static, dynamic = {}, []
    for name in table.data:
        test = table.table(name)
        assert test is not None
        test.refuse_unknown((*STATIC_KEYS, "output", "absolute") if name == "frequency" else STATIC_KEYS)
        file = test.text("file")
        if file is None:
            raise test.error(f'file is missing; write for example file = "{name}.csv"')
        if name in DYNAMIC_TESTS:
            check_dynamic_test(test)
            dynamic.append(name)
            continue
        path = test.source.path.parent / file
        static[name] = StaticTest(name, path, read_noise(test), _mapping(test), _ignored(test), test)
    return static, dynamic


def _mapping(test: TomlTable) -> dict[str, str]:
    table = test.table("columns")
    if table is None:
        return {}
    known = ("run", *columns_of(test.path[-1]))
    table.refuse_unknown(known, "standard column")
    found = {}
    for column in table.data:
        header = table.text(column)
        assert header is not None
        if header in found.values():
            raise table.error(f"{quoted(header)} stands for two columns", column)
        found[column] = header
    return found


def _ignored(test: TomlTable) -> tuple[str, ...]:
    names = test.data.get("ignore", [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise test.error('must be a list of headers, such as ignore = ["remarks"]', "ignore")
    return tuple(name.strip() for name in names)
