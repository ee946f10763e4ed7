"""Pressure lost between the gauges and the edges; solved together with the ports (`coupled_ports`).

Flows are volumes at the gauges: the supply's at supply pressure and temperature, the return's at return pressure and
temperature. Q |Q|, so that a reversed flow (an overrunning load) reverses its loss; passages and lines do not heat the oil.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..effect import AbstractLineEffect, as_amount


Losses = tuple[Float[Array, "..."], Float[Array, "..."]]


def _squared(flow: Float[Array, "..."]) -> Float[Array, "..."]:
    return flow * jnp.abs(flow)


@final
class FlowSaturation(AbstractLineEffect):
    """Passages inside the valve body: P_s - K Q_s |Q_s| and P_t + K Q_t |Q_t|, the same K on both sides.

    Source: turbulent losses of drillings and bends (Idelchik); flow saturates at large openings (ISO 10770-1, flow gain).
    Amount K >= 0 [Pa/(m3/s)^2], typical 5e12 to 2e14 (2.2 bar at 9.8 l/min per 8e12). Shows in the flow at large openings.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def losses(self, supply_flow: Float[Array, "..."], return_flow: Float[Array, "..."]) -> Losses:
        return self.amount * _squared(supply_flow), self.amount * _squared(return_flow)


@final
class SupplyDroop(AbstractLineEffect):
    """The line between the supply gauge and the valve, laminar: P_s - R Q_s.

    Source: Hagen-Poiseuille; also the droop of a pressure controller.
    Amount R >= 0 [Pa/(m3/s)], typical 1e9 to 2e10 (1.6 bar at 9.8 l/min per 1e9). Shows in the flow at large openings.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def losses(self, supply_flow: Float[Array, "..."], return_flow: Float[Array, "..."]) -> Losses:
        return self.amount * supply_flow, jnp.zeros_like(return_flow)


@final
class ReturnBackPressure(AbstractLineEffect):
    """The line between the valve and the return gauge: P_t + K Q_t |Q_t|.

    Source: filters, coolers and hoses of the return line, turbulent.
    Amount K >= 0 [Pa/(m3/s)^2], typical 5e12 to 4e14 (1.3 bar at 9.8 l/min per 5e12). Shows in the flow at large openings.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def losses(self, supply_flow: Float[Array, "..."], return_flow: Float[Array, "..."]) -> Losses:
        return jnp.zeros_like(supply_flow), self.amount * _squared(return_flow)
