"""The oil: viscosity, density, expansion, bulk modulus, heat and the temperature rise of throttling (docs/physics.md section 2).

Every function is elementwise over pressures [Pa, gauge] and temperatures [K] that broadcast against each other.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .arguments import ArgumentTypeError, as_array, as_optional_array, check_sign, check_size, described, known
from .numerics import require_float64
from .oil_definition import REFERENCE_TEMPERATURE, OilDefinition


LN10 = 2.302585092994046


# (coefficient, least, greatest, what is meant): far outside anything that flows, and where numbers in other units lie.
SIZES = (
    ("density_15degC", 100.0, 1e4, "densities are in kg/m3, such as 870"),
    ("expansion_15degC", 0.0, 0.1, "expansions are in 1/K, such as 7.8e-4"),
    ("bulk_modulus_15degC", 1e6, 1e20, "bulk moduli are in Pa, such as 1.7e9"),
    ("specific_heat_15degC", 100.0, 1e5, "specific heats are in J/(kg K), such as 1900"),
)


class TemperatureShifts(eqx.Module):
    """Kelvins by which single laws see the oil warmer than it is, to ask which of them carries an effect of temperature.

    viscosity: of the kinematic viscosity; density: rho(0, T) and with it the expansion; bulk_modulus: K0(T); heat: c_p(T)
    and the alpha T of throttling. All four by the same amount are a change of the oil's temperature.
    """

    viscosity: Float[Array, "..."]
    density: Float[Array, "..."]
    bulk_modulus: Float[Array, "..."]
    heat: Float[Array, "..."]


class Oil(eqx.Module):
    """Coefficients of the oil laws; see `OilDefinition` for their meaning and units. All fields are differentiable.

    Raises ArgumentValueError for a coefficient in another unit, RuntimeError in single precision.
    """

    viscosity_a: Float[Array, ""] = eqx.field(converter=as_array)
    viscosity_b: Float[Array, ""] = eqx.field(converter=as_array)
    density_15degC: Float[Array, ""] = eqx.field(converter=as_array, default=870.0)
    expansion_15degC: Float[Array, ""] = eqx.field(converter=as_array, default=7.8e-4)
    bulk_modulus_15degC: Float[Array, ""] = eqx.field(converter=as_array, default=1.7e9)
    tait_slope: Float[Array, ""] = eqx.field(converter=as_array, default=10.9)
    bulk_modulus_decay: Float[Array, ""] = eqx.field(converter=as_array, default=5.8e-3)
    specific_heat_15degC: Float[Array, ""] = eqx.field(converter=as_array, default=1900.0)
    specific_heat_slope: Float[Array, ""] = eqx.field(converter=as_array, default=3.8)
    # None: the oil has none, and none is computed. A number: mu(p) = mu(0) exp(pressure_viscosity p), 1/Pa.
    pressure_viscosity: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    # None: as defined. A number: the kinematic viscosity is multiplied by it (another batch, ageing, water).
    viscosity_factor: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    # None: every law sees the oil's own temperature.
    shifts: TemperatureShifts | None = None

    def __check_init__(self) -> None:
        require_float64("an Oil")
        known("viscosity_a", self.viscosity_a)
        check_sign("viscosity_b", self.viscosity_b)
        for name, low, high, hint in SIZES:
            check_size(name, getattr(self, name), low, high, hint)


class OilAtTemperature(eqx.Module):
    """What of the oil depends on temperature only: computed once where the temperature of a row is given.

    density: rho(0, T) [kg/m3]; bulk_modulus: K0(T) [Pa]; viscosity: mu(0, T) [Pa s].
    """

    density: Float[Array, "..."]
    bulk_modulus: Float[Array, "..."]
    viscosity: Float[Array, "..."]
    tait_slope: Float[Array, ""]
    pressure_viscosity: Float[Array, "..."] | None


def oil_from_definition(definition: OilDefinition) -> Oil:
    """The differentiable oil of a plain definition (a preset, or a user's points).

    Raises ArgumentTypeError for anything else, such as a preset's bare name.
    """
    if not isinstance(definition, OilDefinition):
        raise ArgumentTypeError(
            f"oil_from_definition takes an OilDefinition, not {described(definition)}: "
            'thermohyd.data.oil_preset("mil-prf-5606") is one'
        )
    return Oil(
        viscosity_a=definition.viscosity_a,
        viscosity_b=definition.viscosity_b,
        density_15degC=definition.density,
        expansion_15degC=definition.expansion,
        bulk_modulus_15degC=definition.bulk_modulus,
        tait_slope=definition.tait_slope,
        bulk_modulus_decay=definition.bulk_modulus_decay,
        specific_heat_15degC=definition.specific_heat,
        specific_heat_slope=definition.specific_heat_slope,
        pressure_viscosity=definition.pressure_viscosity or None,
    )


def walther_viscosity(oil: Oil, temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    """Kinematic viscosity nu(T) at zero gauge pressure [m2/s], ASTM D341: log10 log10(nu/cSt + 0.7) = A - B log10 T."""
    seen = temperature if oil.shifts is None else temperature + oil.shifts.viscosity
    exponent = oil.viscosity_a - oil.viscosity_b * jnp.log10(seen)
    # expm1 keeps the thin end (nu near 0.3 cSt) exact: 10**y - 0.7 = expm1(y ln 10) + 0.3.
    nu = (jnp.expm1(LN10 * jnp.exp(LN10 * exponent)) + 0.3) * 1e-6
    return nu if oil.viscosity_factor is None else nu * oil.viscosity_factor


def _without_pressure(oil: Oil, temperature: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """(rho(0, T) [kg/m3], K0(T) [Pa])."""
    for_density = for_modulus = temperature - REFERENCE_TEMPERATURE
    if oil.shifts is not None:
        for_density, for_modulus = for_density + oil.shifts.density, for_modulus + oil.shifts.bulk_modulus
    rho = oil.density_15degC * (1.0 - oil.expansion_15degC * for_density)
    return rho, oil.bulk_modulus_15degC * jnp.exp(-oil.bulk_modulus_decay * for_modulus)


def at_temperature(oil: Oil, temperature: Float[Array, "..."]) -> OilAtTemperature:
    """The temperature-dependent coefficients of the oil at T [K]."""
    rho, modulus = _without_pressure(oil, temperature)
    return OilAtTemperature(
        density=rho,
        bulk_modulus=modulus,
        viscosity=rho * walther_viscosity(oil, temperature),
        tait_slope=oil.tait_slope,
        pressure_viscosity=oil.pressure_viscosity,
    )


def _squeezed(
    modulus: Float[Array, "..."], tait_slope: Float[Array, "..."], pressure: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Volume by that without pressure, Tait: D = 1 - ln(1 + (1 + K') p / K0) / (1 + K')."""
    stiffening = 1.0 + tait_slope
    # Not log1p: its rounding is finer than the density can show, and it is the dearest function of the whole balance.
    return 1.0 - jnp.log(1.0 + stiffening * pressure / modulus) / stiffening


def density_at(state: OilAtTemperature, pressure: Float[Array, "..."]) -> Float[Array, "..."]:
    """rho(p) = rho(0)/D [kg/m3] at the state's temperature, Tait."""
    return state.density / _squeezed(state.bulk_modulus, state.tait_slope, pressure)


def viscosity_at(state: OilAtTemperature, pressure: Float[Array, "..."]) -> Float[Array, "..."]:
    """mu(p) [Pa s] at the state's temperature, Barus: mu(0) exp(b p); without b the pressure costs nothing."""
    if state.pressure_viscosity is None:
        return state.viscosity
    return state.viscosity * jnp.exp(state.pressure_viscosity * pressure)


class CompressedOil(eqx.Module):
    """Oil under pressure: density [kg/m3], isothermal bulk modulus [Pa], expansion at constant pressure [1/K]."""

    density: Float[Array, "..."]
    bulk_modulus: Float[Array, "..."]
    expansion: Float[Array, "..."]


def compressed(oil: Oil, pressure: Float[Array, "..."], temperature: Float[Array, "..."]) -> CompressedOil:
    """rho, beta_T and alpha at p and T, from one logarithm.

    With rho = rho0(T)/D, Tait: beta_T = rho/(d rho/dp) = D (K0 + (1 + K') p), and alpha = -(1/rho) d rho/dT =
    alpha_15 rho_15/rho0 - d p/beta_T, as K0 falls with T at the relative rate d (docs/physics.md section 2).
    """
    rho, modulus = _without_pressure(oil, temperature)
    squeezed = _squeezed(modulus, oil.tait_slope, pressure)
    stiff = squeezed * (modulus + (1.0 + oil.tait_slope) * pressure)
    free = oil.expansion_15degC * oil.density_15degC / rho
    return CompressedOil(rho / squeezed, stiff, free - oil.bulk_modulus_decay * pressure / stiff)


def density(oil: Oil, pressure: Float[Array, "..."], temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    """rho(p, T) [kg/m3], Tait."""
    rho, modulus = _without_pressure(oil, temperature)
    return rho / _squeezed(modulus, oil.tait_slope, pressure)


def dynamic_viscosity(oil: Oil, pressure: Float[Array, "..."], temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    """mu(p, T) = rho(0, T) nu(T) exp(b p) [Pa s]."""
    return viscosity_at(at_temperature(oil, temperature), pressure) + 0.0 * pressure


def kinematic_viscosity(
    oil: Oil, pressure: Float[Array, "..."], temperature: Float[Array, "..."]
) -> Float[Array, "..."]:
    """nu(p, T) = mu(p, T) / rho(p, T) [m2/s]."""
    return dynamic_viscosity(oil, pressure, temperature) / density(oil, pressure, temperature)


def specific_heat(oil: Oil, temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    """c_p(T) [J/(kg K)], linear in temperature."""
    seen = temperature if oil.shifts is None else temperature + oil.shifts.heat
    return oil.specific_heat_15degC + oil.specific_heat_slope * (seen - REFERENCE_TEMPERATURE)


def enthalpy_slopes(
    oil: Oil, pressure: Float[Array, "..."], temperature: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """(dh/dT, dh/dp) = (c_p, (1 - alpha T)/rho) in J/(kg K) and m3/kg: dh = c_p dT + (1 - alpha T)/rho dp."""
    absolute = temperature if oil.shifts is None else temperature + oil.shifts.heat
    inside = compressed(oil, pressure, temperature)
    return specific_heat(oil, temperature), (1.0 - inside.expansion * absolute) / inside.density


def throttling_rise(
    oil: Oil, drop: Float[Array, "..."], mean_pressure: Float[Array, "..."], temperature: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Isenthalpic temperature rise [K] of oil at `temperature` throttled by `drop` = p1 - p2 [Pa].

    T2 - T1 = (1 - alpha T1)(p1 - p2)/(rho c_p), properties at T1 and the mean pressure (docs/physics.md section 2).
    """
    heat, slope = enthalpy_slopes(oil, mean_pressure, temperature)
    return slope * drop / heat
