"""The oil in plain NumPy: ASTM D341 viscosity, Tait density, throttling rise. SI units, gauge pressures, K."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


T0 = 288.15  # K, 15 degC: where density, bulk modulus and specific heat are stated
T40 = 313.15  # K, 40 degC: where leakage and clearance effects are stated

Array = np.ndarray | float


@dataclass(frozen=True)
class Oil:
    """Coefficients of the oil laws; numbers, or arrays with one entry per row.

    log10 log10(nu/cSt + 0.7) = walther_a - walther_b log10 T; density, expansion, bulk_modulus and specific_heat at
    15 degC and zero gauge pressure. `viscosity_factor` multiplies nu; mu(p) = mu(0) exp(pressure_viscosity p).
    """

    walther_a: Array
    walther_b: Array
    density: Array = 870.0
    expansion: Array = 7.8e-4
    bulk_modulus: Array = 1.7e9
    tait_slope: Array = 10.9
    bulk_modulus_decay: Array = 5.8e-3
    specific_heat: Array = 1900.0
    specific_heat_slope: Array = 3.8
    pressure_viscosity: Array = 0.0
    viscosity_factor: Array = 1.0

    def rho(self, p: Array, temperature: Array) -> np.ndarray:
        """Density [kg/m3], Tait."""
        k1 = 1.0 + np.asarray(self.tait_slope)
        y = k1 * p / self._k0(temperature)
        return self.density * (1.0 - self.expansion * (temperature - T0)) / (1.0 - np.log1p(y) / k1)

    def alpha(self, p: Array, temperature: Array) -> np.ndarray:
        """Thermal expansion -(1/rho) d rho/dT [1/K]: the derivative of the Tait form, written out."""
        k1 = 1.0 + np.asarray(self.tait_slope)
        y = k1 * p / self._k0(temperature)
        squeeze = 1.0 - np.log1p(y) / k1
        thermal = self.expansion / (1.0 - self.expansion * (temperature - T0))
        return thermal - self.bulk_modulus_decay * y / (k1 * (1.0 + y) * squeeze)

    def beta(self, p: Array, temperature: Array) -> np.ndarray:
        """Isothermal bulk modulus rho/(d rho/dp) [Pa]."""
        k1 = 1.0 + np.asarray(self.tait_slope)
        k0 = self._k0(temperature)
        y = k1 * p / k0
        return k0 * (1.0 + y) * (1.0 - np.log1p(y) / k1)

    def nu0(self, temperature: Array) -> np.ndarray:
        """Kinematic viscosity at zero gauge pressure [m2/s]."""
        exponent = self.walther_a - self.walther_b * np.log10(temperature)
        return (10.0 ** (10.0**exponent) - 0.7) * 1e-6 * self.viscosity_factor

    def mu(self, p: Array, temperature: Array) -> np.ndarray:
        """Dynamic viscosity [Pa s]."""
        return self.rho(0.0, temperature) * self.nu0(temperature) * np.exp(self.pressure_viscosity * p)

    def cp(self, temperature: Array) -> np.ndarray:
        """Specific heat [J/(kg K)]."""
        return self.specific_heat + self.specific_heat_slope * (np.asarray(temperature) - T0)

    def throttling_rise(self, drop: Array, p_mean: Array, temperature: Array) -> np.ndarray:
        """T2 - T1 [K] of oil throttled by `drop` = p1 - p2 at constant enthalpy; properties at T1 and mean pressure."""
        volume = (1.0 - self.alpha(p_mean, temperature) * temperature) / self.rho(p_mean, temperature)
        return volume * drop / self.cp(temperature)

    def _k0(self, temperature: Array) -> np.ndarray:
        return self.bulk_modulus * np.exp(-self.bulk_modulus_decay * (np.asarray(temperature) - T0))


def walther(points_degc_cst: Sequence[Sequence[float]]) -> tuple[float, float]:
    """(walther_a, walther_b) through points of [degC, cSt]; more than two by least squares on the chart."""
    t, nu = np.array(points_degc_cst, dtype=float).T
    y = np.log10(np.log10(nu + 0.7))
    x = np.log10(t + 273.15)
    slope = ((x - x.mean()) * (y - y.mean())).sum() / ((x - x.mean()) ** 2).sum()
    return float(y.mean() - slope * x.mean()), float(-slope)


SEED_VISCOSITY = ((-40.0, 4000.0), (70.0, 30.0))  # degC, cSt: docs/physics.md section 1


def seed_oil() -> Oil:
    """The oil of the seed paper."""
    return Oil(*walther(SEED_VISCOSITY))
