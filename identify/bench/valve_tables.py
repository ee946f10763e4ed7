"""Read and check a record's bench.toml except the tables of its tests: valve, oil, conditions and starting values, in SI.

The oil is a preset or viscosity points, with further properties; `[start]` says where each parameter starts, what is held, and
what is known beforehand (a prior).
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

from thermohyd.data import oil_preset
from thermohyd.identify.fitting.parameters import (
    IN_MOTION,
    STIFFEST_OIL,
    absent_parameters,
    heat_retention,
    identified_by_default,
    identified_in_motion,
)
from thermohyd.oil_definition import OilDefinition, kinematic_viscosity_of, walther_coefficients

from .columns import CONDITIONS, KIND_OF, SIZES, impossible, wrong_size
from .errors import quoted
from .record import EDGE_LAWS, ActuatorData, StartValue, ValveData
from .sensors import Sensor, read_sensors
from .service import OF_VALVE, Service, read_service
from .test_tables import DynamicTestTable, StaticTest, read_loop, read_tests
from .toml_file import TableSource, TomlSource, TomlTable
from .units import number_of


# Properties beside the viscosity, each with its kind of quantity; all at 15 degC and zero gauge pressure.
PROPERTIES = {
    "density": "density",
    "expansion": "thermal expansion",
    "bulk_modulus": "pressure",
    "specific_heat": "specific heat",
    "pressure_viscosity": "compressibility",
}
OIL_KEYS = ("preset", "viscosity", *PROPERTIES, "name")


def read_oil(table: TomlTable) -> OilDefinition:
    """The oil, SI; what the table lacks takes the preset's or the model's defaults. Raises BenchInputError."""
    table.refuse_unknown(OIL_KEYS)
    preset = table.text("preset")
    if preset is not None and "viscosity" in table:
        raise table.error("both a preset and viscosity points; keep one of them", "viscosity")
    if preset is not None:
        try:
            oil = oil_preset(preset)
        except ValueError as error:
            raise table.error(str(error), "preset") from None
    else:
        oil = _oil_of_points(table)
    # A pressure viscosity of zero is a value of its own: no rise with pressure.
    signs = {key: "not negative" if key == "pressure_viscosity" else "positive" for key in PROPERTIES}
    given = {key: table.quantity(key, kind, sign=signs[key]) for key, kind in PROPERTIES.items()}
    name = table.text("name")
    oil = replace(oil, **{key: value for key, value in given.items() if value is not None})
    return oil if name is None else replace(oil, name=name)


def _oil_of_points(table: TomlTable) -> OilDefinition:
    example = 'viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]'
    if "viscosity" not in table:
        raise table.error(f'the oil is missing; write preset = "mil-prf-5606", or points: {example}')
    points = table.data["viscosity"]
    if not isinstance(points, list) or not all(isinstance(p, list) and len(p) == 2 for p in points):
        raise table.error(f"must be a list of points, each a temperature and a viscosity: {example}", "viscosity")
    temperatures = [table.as_quantity("viscosity", p[0], "temperature") for p in points]
    viscosities = [table.as_quantity("viscosity", p[1], "kinematic viscosity") for p in points]
    try:
        law = walther_coefficients(temperatures, viscosities)
    except ValueError as error:
        raise table.error(str(error), "viscosity") from None
    return OilDefinition(
        *law, source="viscosity points of the record", coldest=min(temperatures), hottest=max(temperatures)
    )


START_KEYS = ("value", "fixed", "std", "min", "max")


@dataclass(frozen=True)
class _Limits:
    """What a parameter can be at all, whatever the user says (SI)."""

    kind: str
    lower: float
    upper: float
    words: str


def read_start(table: TomlTable, valve: ValveData, actuator: ActuatorData | None) -> dict[str, StartValue]:
    """{parameter: StartValue}, SI. A plain quantity is a starting value that stays free. Raises BenchInputError.

    actuator: None where the record has no dynamic test, whose parameters are then unknown here.
    """
    stroke = valve.stroke
    within = _Limits("length", -stroke, stroke, "within the stroke")
    limits = {
        "edge_radius": _Limits("length", 0.0, stroke, "from zero to the stroke"),
        "clearance": _Limits("length", 1e-9, stroke, "above zero, up to the stroke"),
        "underlap": within,
        "discharge_coefficient": _Limits("plain number", 1e-3, 10.0, "from 0.001 to 10"),
        "transition_number": _Limits("plain number", 1e-3, 1e6, "from 0.001 to 1000000"),
        "null_bias": within,
        "heat_retention": _Limits("plain number", 0.0, 1.0, "from 0 (isothermal) to 1 (adiabatic)"),
        "spool_frequency": _Limits("frequency", 0.01, 1e5, "from 0.01 to 100000 Hz"),
        "spool_damping": _Limits("plain number", 1e-3, 100.0, "from 0.001 to 100"),
        "bulk_modulus_factor": _Limits("plain number", 1e-3, STIFFEST_OIL, f"from 0.001 to {STIFFEST_OIL:g}"),
        "viscous_friction": _Limits("viscous friction", 0.0, 1e8, "from 0 to 100000000 N s/m"),
    }
    nominal = {info.name: info.nominal for info in (*identified_by_default(valve).values(), heat_retention())}
    if actuator is None:
        limits = {name: limit for name, limit in limits.items() if name not in IN_MOTION}
    else:
        nominal |= {info.name: info.nominal for info in identified_in_motion(actuator).values()}
    for name in absent_parameters(valve):
        if name in table:
            raise table.error(f'the edge law "{valve.edge_law}" has no such parameter; leave it out', name)
    table.refuse_unknown(tuple(limits), "parameter")
    start = {}
    for name in table.data:
        if isinstance(table.data[name], dict):
            entry = table.table(name)
            assert entry is not None
            start[name] = _read_entry(entry, limits[name], nominal[name], stroke)
        else:
            value = table.quantity(name, limits[name].kind, full_scale=stroke)
            assert value is not None
            _check(table, name, value, limits[name])
            start[name] = StartValue(value)
    return start


def _check(table: TomlTable, key: str, value: float, limits: _Limits) -> None:
    if not limits.lower <= value <= limits.upper:
        raise table.error(f"{quoted(table.data[key])} is out of range; it must be {limits.words}", key)


def _read_entry(entry: TomlTable, limits: _Limits, nominal: float, stroke: float) -> StartValue:
    entry.refuse_unknown(START_KEYS)
    found: dict[str, float | None] = {}
    for key in ("value", "min", "max"):
        number = found[key] = entry.quantity(key, limits.kind, full_scale=stroke)
        if number is not None:
            _check(entry, key, number, limits)
    value, lower, upper = found["value"], found["min"], found["max"]
    if lower is not None and upper is not None and not lower < upper:
        raise entry.error("min must be below max", "min")
    if value is None:
        value = min(max(nominal, -float("inf") if lower is None else lower), float("inf") if upper is None else upper)
    if (lower is not None and value < lower) or (upper is not None and value > upper):
        raise entry.error(f"the starting value {quoted(entry.data['value'])} lies outside min and max", "value")
    std = entry.quantity("std", limits.kind, full_scale=stroke, sign="positive")
    freed = "fixed" in entry and not entry.flag("fixed")
    return StartValue(value, fixed=entry.flag("fixed"), freed=freed, prior_std=std, lower=lower, upper=upper)


TABLES = ("valve", "oil", "conditions", "test", "tests", "actuator", "start", "sensors")
VALVE = ("name", *SIZES, "polarity", "edge_law", *OF_VALVE)


@dataclass(frozen=True)
class BenchFile:
    """What a bench.toml says, SI units. actuator: None without dynamic tests; actuator_given: its table is in the file."""

    source: TableSource
    valve: ValveData
    oil: OilDefinition
    conditions: dict[str, float]
    tests: dict[str, StaticTest]
    dynamic: dict[str, DynamicTestTable]
    actuator: ActuatorData | None
    actuator_given: bool
    start: dict[str, StartValue] = field(default_factory=dict)
    sensors: dict[str, Sensor] = field(default_factory=dict)
    piston_area_given: bool = True
    service: Service = field(default_factory=Service)


def read_bench_toml(path: Path) -> BenchFile:
    """Read a bench.toml. Raises BenchInputError with file, line and key."""
    return read_description(TomlSource(path), path.absolute().parent.name)


def read_description(source: TableSource, name: str, oil: OilDefinition | None = None) -> BenchFile:
    """The tables of a bench.toml. name: of a valve without one; oil: in the place of the table [oil].

    Raises BenchInputError with the place of what is wrong.
    """
    root = source.root
    root.refuse_unknown(TABLES, "table")
    valve = _valve(_needed(root, "valve"), name)
    oil = read_oil(_needed(root, "oil")) if oil is None else oil
    valve = _with_slot_width(root, valve, oil)
    conditions = _conditions(root.table("conditions"))
    sensors = read_sensors(root.table("sensors"), valve.stroke)
    table = root.table("actuator")
    actuator, sensors = read_loop(TomlTable(root.source, ("actuator",), {}) if table is None else table, valve, sensors)
    tests, dynamic = read_tests(_needed(root, "tests"), actuator, sensors)
    start = root.table("start")
    used = actuator if dynamic else None
    starts = {} if start is None else read_start(start, valve, used)
    area_given = table is not None and any(key in table for key in ("piston_area", "piston_area_a"))
    return BenchFile(
        root.source,
        valve,
        oil,
        conditions,
        tests,
        dynamic,
        used,
        table is not None,
        starts,
        sensors,
        area_given,
        read_service(root),
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


def _valve(table: TomlTable, name: str) -> ValveData:
    table.refuse_unknown(VALVE)
    sizes = {key: _size(table, key) for key in SIZES}
    stroke, slot_width = sizes["stroke"], sizes["slot_width"]
    rated = sizes["rated_flow"] is not None and sizes["rated_pressure_drop"] is not None
    if stroke is None and (slot_width is not None or not rated):
        raise table.error('stroke is missing; write for example stroke = "213 um"')
    if slot_width is None and not rated:
        raise table.error(
            'slot_width is missing; write for example slot_width = "12 mm", or both rated_flow and rated_pressure_drop'
        )
    polarity = table.data.get("polarity", 1)
    if isinstance(polarity, bool) or polarity not in (1, -1):
        raise table.error(
            f"{quoted(polarity)} must be 1, or -1 where a positive current gives a negative flow", "polarity"
        )
    law = table.text("edge_law") or EDGE_LAWS[0]
    if law not in EDGE_LAWS:
        allowed = " or ".join(f'"{word}"' for word in EDGE_LAWS)
        raise table.error(f"{quoted(law)} must be {allowed}", "edge_law")
    return ValveData(
        name=table.text("name") or name,
        stroke=STAND_IN_STROKE if stroke is None else stroke,
        slot_width=slot_width or 0.0,
        slot_width_stated=slot_width is not None,
        stroke_stated=stroke is not None,
        land_diameter=sizes["land_diameter"],
        rated_flow=sizes["rated_flow"],
        rated_pressure_drop=sizes["rated_pressure_drop"],
        rated_current=sizes["rated_current"],
        polarity=int(polarity),
        edge_law=law,
    )


# In the place of a stroke that nobody states: lengths of the spool are then relative to it.
STAND_IN_STROKE = 1e-3  # m
# Of a rated flow: what data sheets are measured at, and the nominal edge (docs/physics.md section 4.1).
RATED_TEMPERATURE = 313.15  # K
RATED_DISCHARGE, RATED_TRANSITION = 0.7, 100.0


def equivalent_slot_width(flow: float, drop: float, stroke: float, oil: OilDefinition) -> float:
    """w [m] of the edges that pass a rated flow [m3/s] at a rated drop [Pa] of the whole valve, fully open by stroke [m].

    Docs/physics.md section 3 with r = c = 0, half the drop on either edge: Q = C_q w X_n sqrt(drop/rho), C_q = C_qmax
    tanh(2 lambda/lambda_c), lambda = (2 X_n/nu) sqrt(drop/rho); the record's oil at 40 degC, the nominal C_qmax = 0.7 and
    lambda_c = 100.
    """
    density = oil.density * (1.0 - oil.expansion * (RATED_TEMPERATURE - 288.15))
    speed = math.sqrt(drop / density)
    number = 2.0 * stroke * speed / kinematic_viscosity_of(oil, RATED_TEMPERATURE)
    return flow / (RATED_DISCHARGE * math.tanh(2.0 * number / RATED_TRANSITION) * stroke * speed)


def _with_slot_width(root: TomlTable, valve: ValveData, oil: OilDefinition) -> ValveData:
    """The valve, its slots worked out from the rated flow where they are not stated."""
    if valve.slot_width_stated:
        return valve
    assert valve.rated_flow is not None
    assert valve.rated_pressure_drop is not None
    width = equivalent_slot_width(valve.rated_flow, valve.rated_pressure_drop, valve.stroke, oil)
    if wrong_size("slot_width", width, width):
        raise root.table_error(
            "valve",
            f"rated_flow at rated_pressure_drop over this stroke would need slots {width * 1e3:.3g} mm wide, but "
            f"{SIZES['slot_width'][2]}; is a unit wrong?",
        )
    return replace(valve, slot_width=width)


def _size(table: TomlTable, key: str) -> float | None:
    value = table.quantity(key, KIND_OF[key], sign="positive")
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
