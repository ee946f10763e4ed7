"""Which columns each bench test has, of which kind of quantity and shown in which unit each is, and which sizes no bench has.

The second half judges a value by itself: sizes, readings and conditions that give away a wrong unit or a broken sensor, and the
unit that they betray. `plausibility` judges one column beside another.
"""

from .shown_units import KINDS, DisplayUnit
from .units import from_si, to_si


# Every column, what is worked out from it, and every size of the [valve] table, by its kind.
_NAMES = {
    "length": ("spool_position", "piston_position", "setpoint", "opening", "stroke", "slot_width", "land_diameter"),
    "velocity": ("piston_velocity", "rate"),
    "flow": ("leakage_flow", "flow", "rated_flow"),
    "pressure": ("supply_pressure", "return_pressure", "load_pressure", "pressure_a", "pressure_b",
                 "rated_pressure_drop"),
    "temperature": ("temperature", "oil_temperature"),
    "current": ("current", "rated_current"),
    "time": ("time", "elapsed"),
    "frequency": ("frequency",),
    "plain number": ("amplitude_ratio",),
    "angle": ("phase",),
}  # fmt: skip
KIND_OF = {name: kind for kind, names in _NAMES.items() for name in names}
_MM = DisplayUnit("mm", 1e3)
# Not shown in the unit of their kind: of another size than a spool's, or without a unit in words.
_OWN_UNIT = {name: _MM for name in ("piston_position", "setpoint", "slot_width", "land_diameter")} | {
    "rate": DisplayUnit("um/s", 1e6),
    "amplitude_ratio": DisplayUnit("-"),
}


def _kinds(*names: str) -> dict[str, str]:
    return {name: KIND_OF[name] for name in names}


POSITION = _kinds("spool_position", "current")
CONDITIONS = _kinds("supply_pressure", "return_pressure", "temperature")
READINGS = {
    "leakage": _kinds("leakage_flow"),
    "pressure_gain": _kinds("load_pressure", "pressure_a", "pressure_b"),
    "flow_gain": _kinds("flow"),
    "load_flow": _kinds("flow"),
    "step": _kinds("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity"),
    "frequency": _kinds("amplitude_ratio", "phase"),
}
# Columns of the dynamic tests that are no readings.
DRIVES = ("command", "frequency", "external_force")
# What an absolute amplitude ratio is, by its output and by whether the command is a current.
ABSOLUTE_RATIO = {
    ("spool_position", False): "plain number",
    ("piston_position", False): "plain number",
    ("piston_velocity", False): "frequency",
    ("spool_position", True): "length per current",
    ("piston_position", True): "length per current",
    ("piston_velocity", True): "velocity per current",
}


def column_unit(name: str) -> DisplayUnit:
    """The bench unit of a column, of what is worked out from one, of a size; no unit where the name is none of them."""
    return _OWN_UNIT.get(name) or KINDS.get(KIND_OF.get(name, ""), DisplayUnit(""))


def reading_unit(name: str, signal: str = "") -> DisplayUnit:
    """The bench unit of a reading; of one that is kept as a signal, "V" or "count", that of the signal."""
    return DisplayUnit(signal) if signal else column_unit(name)


def unit_of_test(test: str) -> DisplayUnit:
    """The bench unit of a static test's readings."""
    return column_unit(next(iter(READINGS[test])))


def columns_of_step(closed_loop: bool) -> dict[str, tuple[str, ...]]:
    """{column: kinds that it may have} of a step test. In open loop a command is a spool position or a current."""
    own_noise = {f"{reading}_std": (kind,) for reading, kind in READINGS["step"].items()}
    readings = {reading: (kind,) for reading, kind in READINGS["step"].items()}
    conditions = {name: (kind,) for name, kind in CONDITIONS.items()}
    return {
        "time": ("time",),
        **_command(closed_loop),
        "external_force": ("force",),
        **conditions,
        **readings,
        **own_noise,
    }


def columns_of_frequency(closed_loop: bool, ratio: str) -> dict[str, tuple[str, ...]]:
    """{column: kinds that it may have} of a frequency test whose amplitude ratio is of the kind `ratio`."""
    readings = {"amplitude_ratio": (ratio,), "phase": ("angle",)}
    own_noise = {f"{reading}_std": kind for reading, kind in readings.items()}
    conditions = {name: (kind,) for name, kind in CONDITIONS.items()}
    return {
        "frequency": ("frequency",), **_command(closed_loop), "external_force": ("force",), **conditions, **readings,
        **own_noise,
    }  # fmt: skip


def _command(closed_loop: bool) -> dict[str, tuple[str, ...]]:
    return {"command": ("length",) if closed_loop else ("length", "current")}


def columns_of(test: str) -> dict[str, str]:
    """{column: kind} that a static test uses, `run` (a text) excepted."""
    extra = {"load_pressure": "pressure"} if test == "load_flow" else {}
    own_noise = {f"{reading}_std": kind for reading, kind in READINGS[test].items()}
    return {"time": "time", **POSITION, **CONDITIONS, **extra, **READINGS[test], **own_noise}


def standard_columns() -> set[str]:
    """Every column name of docs/bench_format.md sections 4 and 5, of all tests: a log may hold more than one test needs."""
    names = {"run", "time", *POSITION, *CONDITIONS, *DRIVES}
    for readings in READINGS.values():
        names |= {*readings, *(f"{reading}_std" for reading in readings)}
    return names


ABSOLUTE_VACUUM = -101325.0  # Pa gauge
HIGHEST_PRESSURE = 5e8  # Pa: ten times any valve's
HIGHEST_SUPPLY = 7e7  # Pa: twice that of the strongest servovalves
HIGHEST_FLOW = 1.0  # m3/s: ten times the largest servovalve's
TEMPERATURES = (193.15, 523.15)  # K, -80 to 250 degC: outside it no hydraulic oil flows, or it burns
# Sizes of the [valve] table, SI: from half of the smallest to twice the largest that are made, generously.
SIZES = {
    "stroke": (1e-6, 0.05, "a spool's stroke lies between 1 um and 50 mm"),
    "slot_width": (1e-5, 1.0, "the slots of an edge are 0.01 mm to 1 m wide"),
    "land_diameter": (2e-4, 0.3, "a spool's diameter lies between 0.2 and 300 mm"),
    "rated_flow": (1e-8, 0.5, "a rated flow lies between 0.0006 and 30,000 l/min"),
    "rated_pressure_drop": (1e4, 7e7, "a rated pressure drop lies between 0.1 and 700 bar"),
    "rated_current": (1e-4, 100.0, "a rated current lies between 0.1 mA and 100 A"),
}
# Units in which a number may have been meant, the likeliest first, and the values of a usual bench.
USUAL = {
    "length": (("um", "mm", "m", "inch"), 20e-6, 5e-3),
    "pressure": (("bar", "psi", "MPa", "kPa"), 20e5, 400e5),
    "temperature": (("degC", "K", "degF"), 233.15, 403.15),
}


def impossible(kind: str, value: float, number: float | None = None) -> str:
    """What is wrong with a condition (pressure [Pa gauge], temperature [K]) or a reading, as the end of a sentence; empty
    where nothing is.

    kind: "pressure" and "temperature" are conditions, "pressure reading" and so on what a test measures.
    number: the value as the user wrote it, for a word on the unit that it betrays.
    """
    if kind == "temperature" and value <= 0.0:
        return "is at or below absolute zero (-273.15 degC, 0 K)"
    if kind == "temperature" and not TEMPERATURES[0] <= value <= TEMPERATURES[1]:
        return f"lies outside -80 to 250 degC; is the unit right?{meant(kind, number)}"
    if kind == "pressure" and value < ABSOLUTE_VACUUM:
        return "is below absolute zero pressure (-1.01325 bar gauge); pressures are gauge"
    if kind == "pressure" and value > HIGHEST_SUPPLY:
        return f"is above 700 bar, more than a servovalve bears; is the unit right?{meant(kind, number)}"
    if kind == "pressure reading" and abs(value) > HIGHEST_PRESSURE:
        return "is above 5000 bar; is the unit right?"
    if kind == "flow reading" and abs(value) > HIGHEST_FLOW:
        return "is above 60,000 l/min; is the unit right?"
    return ""


def plausible_range(kind: str) -> tuple[float, float]:
    """The values of a kind in which `impossible` finds nothing (SI)."""
    return {
        "temperature": TEMPERATURES,
        "pressure": (ABSOLUTE_VACUUM, HIGHEST_SUPPLY),
        "pressure reading": (-HIGHEST_PRESSURE, HIGHEST_PRESSURE),
        "flow reading": (-HIGHEST_FLOW, HIGHEST_FLOW),
    }.get(kind, (-float("inf"), float("inf")))


def likely_unit(kind: str, number: float) -> str | None:
    """The unit in which a number would be a usual value of its kind; None where there is none."""
    units, low, high = USUAL.get(kind, ((), 0.0, 0.0))
    return next(
        (unit for unit in units if low <= to_si(abs(number) if kind == "length" else number, unit) <= high), None
    )


def meant(kind: str, number: float | None) -> str:
    """ " 1015 psi would be 70 bar": what a number would be in its likely unit; empty where none is likely."""
    unit = None if number is None else likely_unit(kind, number)
    if unit is None or number is None:
        return ""
    bench = KINDS[kind].label
    if unit == bench:
        return f" {number:.4g} {unit} would be usual"
    return f" {number:.4g} {unit} would be {from_si(to_si(number, unit), bench):.3g} {bench}"


def wrong_size(key: str, value: float, number: float) -> str:
    """What is wrong with a size of the [valve] table (SI), as a sentence's end; empty where nothing is.

    number: the value as the user wrote it.
    """
    low, high, words = SIZES[key]
    if low <= value <= high:
        return ""
    better = likely_unit("length", number) if key == "stroke" else None
    return f"is none: {words}; " + (f'did you mean "{number:.6g} {better}"?' if better else "is the unit right?")
