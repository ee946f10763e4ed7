"""What defines an oil, as plain numbers: nothing here needs JAX, so a record can be read and checked without it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


LOWEST_TEMPERATURE = 150.0  # K: below it nothing is an oil, and a number was meant in degC
HIGHEST_VISCOSITY = 1e6  # cSt: above it a number was meant in cSt, not in m2/s
REFERENCE_TEMPERATURE = 288.15  # K, 15 degC: where density, bulk modulus and specific heat are stated


@dataclass(frozen=True)
class OilDefinition:
    """Coefficients of the oil laws in `thermohyd.oil` (docs/physics.md section 2), SI units.

    viscosity_a, viscosity_b: ASTM D341 (Walther), log10 log10(nu/cSt + 0.7) = a - b log10(T/K).
    density: kg/m3 at 15 degC and zero gauge pressure; expansion: 1/K there.
    bulk_modulus: Pa, isothermal, at 15 degC and zero gauge pressure; it falls as exp(-bulk_modulus_decay (T - T0)).
    tait_slope: K' of the Tait equation. specific_heat: J/(kg K) at 15 degC; specific_heat_slope: J/(kg K2).
    coldest, hottest: K, between which the viscosity is known; None where nobody says.
    pressure_viscosity: 1/Pa, mu(p) = mu(0) exp(pressure_viscosity p); 0 leaves it to the effect of that name.
    """

    viscosity_a: float
    viscosity_b: float
    density: float = 870.0
    expansion: float = 7.8e-4
    bulk_modulus: float = 1.7e9
    tait_slope: float = 10.9
    bulk_modulus_decay: float = 5.8e-3
    specific_heat: float = 1900.0
    specific_heat_slope: float = 3.8
    pressure_viscosity: float = 0.0
    name: str = "user oil"
    source: str = ""
    coldest: float | None = None
    hottest: float | None = None


def walther_coefficients(temperatures: Sequence[float], viscosities: Sequence[float]) -> tuple[float, float]:
    """Coefficients (a, b) of ASTM D341 through points of temperature [K] and kinematic viscosity [m2/s].

    Two points are met exactly, more by least squares in the coordinates of the ASTM chart.
    Raises ValueError with one sentence where the points cannot define an oil, or are in degC or cSt.
    """
    t = np.asarray(temperatures, dtype=float)
    nu = np.asarray(viscosities, dtype=float) * 1e6  # cSt
    if t.shape != nu.shape:
        raise ValueError(f"a viscosity law needs one viscosity per temperature, not {nu.size} for {t.size}")
    if t.size < 2 or np.ptp(t) == 0.0:
        raise ValueError("a viscosity law needs at least two points at different temperatures")
    if np.any(t <= 0.0):
        raise ValueError("a temperature must be above absolute zero")
    if np.any(t < LOWEST_TEMPERATURE):
        cold = float(t[t < LOWEST_TEMPERATURE][0])
        raise ValueError(f"temperatures are in kelvin; {cold:g} looks like degC: use {cold + 273.15:.6g}")
    if np.any(nu >= HIGHEST_VISCOSITY):
        thick = 1e-6 * float(nu[nu >= HIGHEST_VISCOSITY][0])
        raise ValueError(f"kinematic viscosities are in m2/s; {thick:g} looks like cSt: use {thick:g}e-6")
    if np.any(nu <= 0.3):
        raise ValueError("a kinematic viscosity must be above 0.3 cSt, the limit of the ASTM D341 law")
    y = np.log10(np.log10(nu + 0.7))
    slope, intercept = np.polyfit(np.log10(t), y, 1)
    if slope >= 0.0:
        raise ValueError("the viscosity must fall as the temperature rises")
    return float(intercept), float(-slope)


def kinematic_viscosity_of(definition: OilDefinition, temperature: float) -> float:
    """Kinematic viscosity [m2/s] at a temperature [K] and zero gauge pressure, on the host."""
    exponent = definition.viscosity_a - definition.viscosity_b * math.log10(temperature)
    return (10.0 ** (10.0**exponent) - 0.7) * 1e-6
