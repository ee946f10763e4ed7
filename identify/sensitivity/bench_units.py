"""The bench units in which a study shows its figures, and its numbers in words."""

import math

from ..display_units import DisplayUnit, significant
from .factors import Factor


_UNITS = {
    "m": DisplayUnit("um", 1e6),
    "Pa": DisplayUnit("bar", 1e-5),
    "K": DisplayUnit("K", 1.0),
    "dimensionless": DisplayUnit("", 1.0),
    "m3/s": DisplayUnit("l/min", 6e4),
    "Pa/m": DisplayUnit("bar/um", 1e-11),
    "m2/s": DisplayUnit("l/min/um", 6e-2),
    "s": DisplayUnit("s", 1.0),
    "m3/(s Pa)": DisplayUnit("l/min/bar", 6e9),
}
OF_TEST = {"leakage": _UNITS["m3/s"], "pressure_gain": _UNITS["Pa"], "flow_gain": _UNITS["m3/s"]}


def bench_unit(si_unit: str) -> DisplayUnit:
    """shown = factor * SI; a unit that is not known here is shown as it is."""
    return _UNITS.get(si_unit, DisplayUnit(si_unit, 1.0))


def with_unit(value: float, si_unit: str, digits: int = 4) -> str:
    unit = bench_unit(si_unit)
    return f"{significant(value * unit.factor, digits)} {unit.label}".rstrip()


def factor_value(factor: Factor) -> str:
    """ "15.00 um", "40.0 degC", "table"."""
    if factor.name == "temperature":
        return f"{factor.value - 273.15:.1f} degC"
    if factor.name in ("viscosity", "density"):
        return "table" if factor.value == 1.0 else f"{significant(factor.value)} x table"
    return with_unit(factor.value, factor.unit)


def factor_tolerance(factor: Factor) -> str:
    """ "+/- 3 um"; "0 to 1" where the interval is cut at a limit."""
    unit = bench_unit(factor.unit)
    if not math.isclose(factor.high - factor.value, factor.value - factor.low) and factor.name != "temperature":
        low, high = (f"{value * unit.factor:.4g}" for value in (factor.low, factor.high))
        return f"{low} to {high} {unit.label}".rstrip()
    if factor.relative or factor.name in ("viscosity", "density"):
        return f"+/- {100 * factor.tolerance / abs(factor.value):.3g} %"
    return f"+/- {factor.tolerance * unit.factor:.3g} {unit.label}".rstrip()
