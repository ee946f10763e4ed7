"""The `[start]` table: where each parameter starts, what is held, what is known beforehand."""

from dataclasses import dataclass

from .errors import quoted
from .parameters import IN_MOTION, heat_retention, identified_by_default, identified_in_motion
from .record import ActuatorData, StartValue, ValveData
from .toml_source import TomlTable


KEYS = ("value", "fixed", "std", "min", "max")


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
        "bulk_modulus_factor": _Limits("plain number", 1e-3, 10.0, "from 0.001 to 10"),
        "viscous_friction": _Limits("viscous friction", 0.0, 1e8, "from 0 to 100000000 N s/m"),
    }
    nominal = {info.name: info.nominal for info in (*identified_by_default(valve).values(), heat_retention())}
    if actuator is None:
        limits = {name: limit for name, limit in limits.items() if name not in IN_MOTION}
    else:
        nominal |= {info.name: info.nominal for info in identified_in_motion(actuator).values()}
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
    entry.refuse_unknown(KEYS)
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
