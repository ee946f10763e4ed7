"""The bench unit in which a quantity or an effect's amount is shown, how many of its digits mean something, and both as text.

No JAX and no units library: reports must not wait for either.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from thermohyd.effects.library import find_effect


@dataclass(frozen=True)
class DisplayUnit:
    """shown value = factor * SI value"""

    label: str
    factor: float


# A change of the SI unit on the left gives one of the bench unit on the right; what is not here is shown in SI.
_OF_SI = {
    "m": DisplayUnit("um", 1e6),
    "m/K": DisplayUnit("um/K", 1e6),
    "m/Pa": DisplayUnit("um/bar", 1e11),
    "Pa": DisplayUnit("bar", 1e-5),
    "m^3/s": DisplayUnit("l/min", 6e4),
    "m3/s": DisplayUnit("l/min", 6e4),
    "dimensionless": DisplayUnit("-", 1.0),
    "N*s/m": DisplayUnit("N s/m", 1.0),
}
_OF_READING = {
    "leakage_flow": _OF_SI["m^3/s"],
    "flow": _OF_SI["m^3/s"],
    "load_pressure": _OF_SI["Pa"],
    "pressure_a": _OF_SI["Pa"],
    "pressure_b": _OF_SI["Pa"],
    "spool_position": _OF_SI["m"],
    "piston_position": DisplayUnit("mm", 1e3),
    "piston_velocity": DisplayUnit("mm/s", 1e3),
    "amplitude_ratio": DisplayUnit("-", 1.0),
    "phase": DisplayUnit("deg", 180.0 / math.pi),
}


def display_unit(si_unit: str) -> DisplayUnit:
    """The bench unit for a parameter's SI unit (pint spelling)."""
    return _OF_SI.get(si_unit.replace(" ", "").replace("**", "^"), DisplayUnit(si_unit, 1.0))


def reading_unit(channel: str) -> DisplayUnit:
    """The bench unit of a test's reading: l/min for flows, bar for pressures."""
    return _OF_READING.get(channel, DisplayUnit("SI", 1.0))


def decimals_for(std: float) -> int:
    """Decimals that show an uncertainty with two significant digits, at most eight."""
    if not (math.isfinite(std) and std > 0.0):
        return 3
    return min(8, max(0, 1 - math.floor(math.log10(std))))


def significant(value: float, digits: int = 4) -> str:
    """A number to so many significant digits, as short as that allows; exponents only where they save space."""
    if not math.isfinite(value):
        return str(value)
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if -4 <= size < 7:
        return f"{value:.{max(0, digits - 1 - size)}f}"
    return f"{value:.{digits - 1}e}"


def beside(value: float, std: float | None) -> str:
    """A value to the decimals that its uncertainty allows; four significant digits where there is none."""
    if std is None or not math.isfinite(std) or std <= 0.0 or not 1e-7 < std < 1e7:
        return significant(value)
    return f"{value:.{decimals_for(std)}f}"


def decibel(ratio: ArrayLike) -> np.ndarray:
    """A ratio of amplitudes in dB."""
    return np.asarray(20.0 * np.log10(np.asarray(ratio)))


# What engineers write for the SI unit on the left; a unit that is not here is shown as `display_units` shows it.
_AMOUNTS_OF_SI = {
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


def effect_unit(name: str, si_unit: str) -> DisplayUnit:
    """The bench unit of an effect's amount: shown = factor * SI. An effect of a new unit is shown in that unit."""
    info = find_effect(name)
    if info is not None and info.shown is not None:
        return DisplayUnit(*info.shown)
    return _AMOUNTS_OF_SI.get(si_unit) or display_unit(si_unit)


def has_bench_unit(si_unit: str) -> bool:
    """Whether amounts in this SI unit are shown in a unit that was chosen for them."""
    return si_unit in _AMOUNTS_OF_SI


def amount(name: str, value: float, si_unit: str, std: float | None = None) -> str:
    """An effect's amount as a report writes it, "0.04510 +/- 0.00061 l/min/sqrt(bar)"; without std four digits."""
    unit = effect_unit(name, si_unit)
    shown = None if std is None else std * unit.factor
    words = beside(value * unit.factor, shown)
    if shown is not None and math.isfinite(shown) and shown > 0.0:
        words += f" +/- {beside(shown, shown)}"
    return words if unit.label == "-" else f"{words} {unit.label}"
