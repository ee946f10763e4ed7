"""Radial clearance that is not constant: with the temperature, with the pressure."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..conditions import Conditions
from ..effect import AbstractEdgeEffect, Edges, as_amount
from .lands import on_both


REFERENCE_TEMPERATURE = 313.15  # K, 40 degC: where the clearance is stated
# A spool without clearance seizes; the flow laws need a gap, so a far too negative amount stops here [m].
SMALLEST_CLEARANCE = 1e-8


@final
class ThermalClearance(AbstractEdgeEffect):
    """c + k (T - 40 degC), T the true temperature of the oil supplied; at least 0.01 um.

    Source: unequal expansion of spool and sleeve, k = (alpha_sleeve - alpha_spool) d/2.
    Amount k [m/K], either sign, typical 1 to 20 nm/K. Shows in the leakage away from null, over temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        growth = self.amount * (conditions.temperature - REFERENCE_TEMPERATURE)

        def wider(clearance: Float[Array, "..."]) -> Float[Array, "..."]:
            return jnp.maximum(clearance + growth, SMALLEST_CLEARANCE)

        return on_both(ideal, "clearance", wider)


@final
class PressureClearance(AbstractEdgeEffect):
    """c + k p, p the mean pressure of the edge.

    Source: the sleeve widens under pressure (thick-walled cylinder, Lame).
    Amount k >= 0 [m/Pa], typical 0.5e-14 to 5e-14 (0.05 to 0.5 um at 100 bar). Shows in the leakage away from null, over
    the supply pressure.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return on_both(ideal, "clearance_per_pressure", lambda own: self.amount if own is None else own + self.amount)
