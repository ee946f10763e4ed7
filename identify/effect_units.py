"""Which bench unit an effect's amount is shown in, and the amount in words. No JAX, no units library."""

import math

from .display_units import DisplayUnit, beside, display_unit


# What engineers write for the SI unit on the left; a unit that is not here is shown as `display_units` shows it.
_OF_SI = {
    "m": DisplayUnit("um", 1e6),
    "m/K": DisplayUnit("um/K", 1e6),
    "m/N": DisplayUnit("um/N", 1e6),
    "m/Pa": DisplayUnit("um/100 bar", 1e13),
    "K": DisplayUnit("K", 1.0),
    "s": DisplayUnit("s", 1.0),
    "Pa": DisplayUnit("bar", 1e-5),
    "1/Pa": DisplayUnit("1/GPa", 1e9),  # how tables of pressure-viscosity coefficients give it
    "m3/s": DisplayUnit("l/min", 6e4),
    "m3/(s Pa)": DisplayUnit("l/min/bar", 6e9),
    "m3/s/sqrt(Pa)": DisplayUnit("l/min/sqrt(bar)", 6e4 * math.sqrt(1e5)),
    "Pa/(m3/s)": DisplayUnit("bar/(l/min)", 1e-5 / 6e4),
    "Pa/(m3/s)^2": DisplayUnit("bar/(l/min)^2", 1e-5 / 6e4**2),
    "1": DisplayUnit("-", 1.0),
}
# Pure numbers that say by which share something changes.
_SHARES = frozenset({"viscosity_shift", "flowmeter_scale", "position_scale", "throttle_heating", "entrained_air"})
_DELAYS = frozenset({"spool_delay"})  # of milliseconds, where a lag takes seconds
_PERCENT = DisplayUnit("%", 100.0)
_MILLISECONDS = DisplayUnit("ms", 1e3)


def effect_unit(name: str, si_unit: str) -> DisplayUnit:
    """The bench unit of an effect's amount: shown = factor * SI. An effect of a new unit is shown in that unit."""
    if name in _SHARES:
        return _PERCENT
    if name in _DELAYS:
        return _MILLISECONDS
    return _OF_SI.get(si_unit) or display_unit(si_unit)


def has_bench_unit(si_unit: str) -> bool:
    """Whether amounts in this SI unit are shown in a unit that was chosen for them."""
    return si_unit in _OF_SI


def amount(name: str, value: float, si_unit: str, std: float | None = None) -> str:
    """An effect's amount as a report writes it, "0.04510 +/- 0.00061 l/min/sqrt(bar)"; without std four digits."""
    unit = effect_unit(name, si_unit)
    shown = None if std is None else std * unit.factor
    words = beside(value * unit.factor, shown)
    if shown is not None and math.isfinite(shown) and shown > 0.0:
        words += f" +/- {beside(shown, shown)}"
    return words if unit.label == "-" else f"{words} {unit.label}"
