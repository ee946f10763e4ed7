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
    """shown value = factor * SI value + offset; differences take the factor alone. si: the SI unit, where it is another."""

    label: str
    factor: float = 1.0
    offset: float = 0.0
    si: str = ""

    def of[T: (float, np.ndarray)](self, value: T) -> T:
        return value * self.factor + self.offset

    def words(self, value: float, digits: int) -> str:
        """ "213 um": to at most so many significant digits."""
        return f"{self.of(value):.{digits}g} {self.label}"


# The one table: each kind of quantity in a file, with the unit that reports show and that messages propose.
KINDS = {
    "length": DisplayUnit("um", 1e6, si="m"),
    "flow": DisplayUnit("l/min", 6e4, si="m^3/s"),
    "pressure": DisplayUnit("bar", 1e-5, si="Pa"),
    "temperature": DisplayUnit("degC", 1.0, -273.15, si="K"),
    "current": DisplayUnit("mA", 1e3, si="A"),
    "time": DisplayUnit("s"),
    "kinematic viscosity": DisplayUnit("cSt", 1e6, si="m^2/s"),
    "density": DisplayUnit("kg/m^3"),
    "specific heat": DisplayUnit("J/(kg K)"),
    "compressibility": DisplayUnit("1/Pa"),
    "thermal expansion": DisplayUnit("1/K"),
    "area": DisplayUnit("cm^2", 1e4, si="m^2"),
    "volume": DisplayUnit("cm^3", 1e6, si="m^3"),
    "mass": DisplayUnit("kg"),
    "force": DisplayUnit("N"),
    "velocity": DisplayUnit("mm/s", 1e3, si="m/s"),
    "viscous friction": DisplayUnit("N s/m"),
    "leakage conductance": DisplayUnit("m^3/s/Pa"),
    "frequency": DisplayUnit("Hz"),
    "amplifier gain": DisplayUnit("A/V"),
    "sensor gain": DisplayUnit("V/m"),
    "length per current": DisplayUnit("um/mA", 1e3, si="m/A"),
    "velocity per current": DisplayUnit("mm/s/mA", 1.0, si="m/s/A"),
    "plain number": DisplayUnit("1"),
    "voltage": DisplayUnit("V"),
    "number of counts": DisplayUnit("count"),
    "angle": DisplayUnit("deg", 180.0 / math.pi, si="rad"),
}
# For tables and curves: so many of the bench unit are one of SI, and 0 degC in K.
UM, L_MIN, BAR, CST = (KINDS[kind].factor for kind in ("length", "flow", "pressure", "kinematic viscosity"))
CELSIUS = -KINDS["temperature"].offset
# The same for what is no column of a kind but a number with its SI unit, often a difference (so K, not degC).
_OF_SI = {
    "m": KINDS["length"],
    "m/K": DisplayUnit("um/K", 1e6),
    "m/Pa": DisplayUnit("um/bar", 1e11),
    "Pa": KINDS["pressure"],
    "m^3/s": KINDS["flow"],
    "m3/s": KINDS["flow"],
    "dimensionless": DisplayUnit("-"),
    "N*s/m": KINDS["viscous friction"],
}
# Amounts of effects, as engineers write them; a fit that lists them among its parameters shows them by the table above.
_OF_AMOUNTS = {
    "m/N": DisplayUnit("um/N", 1e6),
    "m/Pa": DisplayUnit("um/100 bar", 1e13),
    "1/Pa": DisplayUnit("1/GPa", 1e9),  # how tables of pressure-viscosity coefficients give it
    "m3/(s Pa)": DisplayUnit("l/min/bar", 6e9),
    "m3/Pa": DisplayUnit("mm3/bar", 1e14),
    "m3/s/sqrt(Pa)": DisplayUnit("l/min/sqrt(bar)", 6e4 * math.sqrt(1e5)),
    "Pa/(m3/s)": DisplayUnit("bar/(l/min)", 1e-5 / 6e4),
    "Pa/(m3/s)^2": DisplayUnit("bar/(l/min)^2", 1e-5 / 6e4**2),
    "1": DisplayUnit("-"),
}
# Figures of the static tests in a study.
_OF_FIGURES = {
    "dimensionless": DisplayUnit(""),
    "Pa/m": DisplayUnit("bar/um", 1e-11),
    "m2/s": DisplayUnit("l/min/um", 6e-2),
    "m3/(s Pa)": _OF_AMOUNTS["m3/(s Pa)"],
}


def display_unit(si_unit: str) -> DisplayUnit:
    """The bench unit for a parameter's SI unit (pint spelling); what is not in the table is shown in SI."""
    plain = si_unit.replace(" ", "").replace("**", "^")
    quantity, per, signal = plain.rpartition("/")
    if per and signal in ("V", "count") and plain not in _OF_SI:
        # The gain of a sensor: of lengths a piston's, not a spool's.
        known = {"m": DisplayUnit("mm", 1e3), "m/s": KINDS["velocity"]}.get(quantity) or _OF_SI.get(quantity)
        return DisplayUnit(f"{known.label}/{signal}", known.factor) if known is not None else DisplayUnit(si_unit)
    return _OF_SI.get(plain, DisplayUnit(si_unit))


def effect_unit(name: str, si_unit: str) -> DisplayUnit:
    """The bench unit of an effect's amount: shown = factor * SI. An effect of a new unit is shown in that unit."""
    info = find_effect(name)
    if info is not None and info.shown is not None:
        return DisplayUnit(*info.shown)
    return _OF_AMOUNTS.get(si_unit) or display_unit(si_unit)


def figure_unit(si_unit: str) -> DisplayUnit:
    """The bench unit of a study's figure or factor."""
    return _OF_FIGURES.get(si_unit) or display_unit(si_unit)


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


def amount(name: str, value: float, si_unit: str, std: float | None = None, *, with_std: bool = True) -> str:
    """An effect's amount as a report writes it, "0.04510 +/- 0.00061 l/min/sqrt(bar)"; without std four digits.

    with_std: whether std, which sets the digits, is written too.
    """
    unit = effect_unit(name, si_unit)
    shown = None if std is None else std * unit.factor
    words = beside(value * unit.factor, shown)
    if with_std and shown is not None and math.isfinite(shown) and shown > 0.0:
        words += f" +/- {beside(shown, shown)}"
    return words if unit.label == "-" else f"{words} {unit.label}"
