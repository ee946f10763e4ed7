"""Leakage past the metering edges: the first stage, the bushing's seals, and from one port to the other."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..conditions import Conditions
from ..effect import AbstractCrossingEffect, AbstractReadingEffect, as_amount
from ..oil import Oil, at_temperature
from .clearances import REFERENCE_TEMPERATURE


def thinning(oil: Oil, temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    """mu(0, 40 degC)/mu(0, T): how much more a laminar leak lets through at T [K] than at 40 degC."""
    reference = jnp.full_like(temperature, REFERENCE_TEMPERATURE)
    return at_temperature(oil, reference).viscosity / at_temperature(oil, temperature).viscosity


@final
class PilotLeakage(AbstractReadingEffect):
    """Leakage test: Q + K sqrt(P_s - P_t), at the gauges' pressures.

    Source: nozzles and flapper of the first stage are orifices (Merritt, section 7-2); the tare flow of ARP490.
    Amount K >= 0 [m3/s/sqrt(Pa)], typical 1e-10 to 5e-9 (0.2 l/min at 70 bar: 1.3e-9). Shows in the leakage, at every
    position alike, nearly independent of temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        if channel != "leakage_flow":
            return value
        drop = true.supply_pressure - true.return_pressure
        flows = drop > 0.0
        return value + self.amount * jnp.where(flows, jnp.sqrt(jnp.where(flows, drop, 1.0)), 0.0)


@final
class BushingLeakage(AbstractReadingEffect):
    """Leakage test: Q + G (P_s - P_t) mu(0, 40 degC)/mu(0, T), at the gauges' pressures.

    Source: a laminar gap around the bushing or past a seal (Poiseuille).
    Amount G >= 0 [m3/(s Pa)], typical 1e-14 to 1e-12 (0.2 l/min at 70 bar: 5e-13). Shows in the leakage, at every position
    alike, with the oil's thinning.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        if channel != "leakage_flow":
            return value
        drop = true.supply_pressure - true.return_pressure
        return value + self.amount * drop * thinning(oil, true.temperature)


@final
class CrossPortLeakage(AbstractCrossingEffect):
    """Between the ports A and B: Q = G (p_A - p_B) mu(0, 40 degC)/mu(0, T); solved together with both ports.

    Source: a laminar gap past the spool's middle land, or a test manifold's seal (Poiseuille). The mass is taken at the mean
    pressure and the upstream temperature; with connected ports it vanishes.
    Amount G >= 0 [m3/(s Pa)], typical 1e-14 to 1e-12. Shows in the pressure gain (slope and saturation), and in the leakage.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def conductance(self, oil: Oil, conditions: Conditions) -> Float[Array, "..."]:
        return self.amount * thinning(oil, conditions.temperature)
