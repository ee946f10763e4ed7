"""Effects on the oil and in the lines: oil unlike its data sheet, heat that it keeps, pressure lost between gauges and edges.

Losses in lines are solved together with the ports (`coupled_ports`). Their flows are volumes at the gauges: the supply's at
supply pressure and temperature, the return's at return pressure and temperature. Q |Q|, so that a reversed flow (an overrunning
load) reverses its loss; passages and lines do not heat the oil.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.oil import Oil

from .effect import AbstractHeatEffect, AbstractLineEffect, AbstractOilEffect, as_amount


@final
class PressureViscosity(AbstractOilEffect):
    """mu exp(b p), added to what the oil has of its own.

    Source: Barus (1893); b of mineral oils 1.5e-8 to 2.5e-8 1/Pa (ASME Pressure-Viscosity Report, 1953).
    Amount b >= 0 [1/Pa], typical 1e-8 to 2.5e-8. Shows in the leakage, over the supply pressure.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def oil(self, nominal: Oil) -> Oil:
        own = nominal.pressure_viscosity
        total = self.amount if own is None else own + self.amount
        return eqx.tree_at(lambda o: o.pressure_viscosity, nominal, total, is_leaf=lambda leaf: leaf is None)


@final
class ViscosityShift(AbstractOilEffect):
    """nu (1 + d): another batch, ageing, water.

    Source: ISO 3448 allows 10 % about a grade's nominal viscosity.
    Amount d > -1 [-], typical 0.02 to 0.3. Shows in the leakage away from null and in the flow at small openings.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def oil(self, nominal: Oil) -> Oil:
        factor = 1.0 + self.amount
        own = nominal.viscosity_factor
        total = factor if own is None else own * factor
        return eqx.tree_at(lambda o: o.viscosity_factor, nominal, total, is_leaf=lambda leaf: leaf is None)


@final
class ThrottleHeating(AbstractHeatEffect):
    """Share of the throttling heat that stays in the oil, added to the valve's `heat_retention`: eta + amount.

    Source: the seed paper's adiabatic model (THM, eta = 1) beside its isothermal one (HM, eta = 0); eta = exp(-NTU).
    Amount [-], eta + amount from 0 to 1, typical 0.1 to 1. Shows in the leakage and the pressure gain of cold oil.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def heat_retention(self, own: Float[Array, "..."]) -> Float[Array, "..."]:
        return own + self.amount


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
