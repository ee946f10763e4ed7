"""The steady balance of the two port volumes: blocked, connected to each other, or under an imposed load pressure.

Arrays carry a leading axis of length 2, port A then port B: the edges of B meet the spool mirrored, so both ports are
one computation with openings U + s x and U - s x, s = +1, -1.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .balance import falling_root
from .conditions import Conditions
from .edge import OpenEdge, at_opening, mass_flow
from .effect import Edges
from .oil import Oil, OilAtTemperature, at_temperature, throttling_rise


# Connected ports sit near the middle between supply and return: 4 Newton steps leave rounding only.
CONNECTED_STEPS = 4
MIRROR = np.array([[1.0], [-1.0]])


class Ports(eqx.Module):
    """The solved state of both ports: pressures [Pa, gauge], temperatures [K], mass flows through the edges [kg/s]."""

    pressure: Float[Array, "2 rows"]
    temperature: Float[Array, "2 rows"]
    inflow: Float[Array, "2 rows"]  # P-A, P-B
    outflow: Float[Array, "2 rows"]  # A-T, B-T
    # Net flow in from the other port past the spool; None: no such path.
    crossing: Float[Array, "2 rows"] | None = None


class Between(eqx.Module):
    """Pressures between supply and return by the logit q of their share: both drops keep full relative precision."""

    supply_drop: Float[Array, "..."]
    return_drop: Float[Array, "..."]


def between(q: Float[Array, "..."], conditions: Conditions) -> Between:
    """Both drops [Pa] of ports at the logit q of their share of the pressure between return and supply."""
    whole = conditions.supply_pressure - conditions.return_pressure
    # One exponential: share = 1/(1 + e^-q), and the supply's drop is e^-q times the return's.
    decay = jnp.exp(-q)
    return_drop = whole / (1.0 + decay)
    return Between(supply_drop=decay * return_drop, return_drop=return_drop)


def openings(edges: Edges, conditions: Conditions) -> tuple[Float[Array, "2 rows"], Float[Array, "2 rows"]]:
    """Openings [m] of the supply edges (P-A, P-B) and of the return edges (A-T, B-T)."""
    shift = MIRROR * conditions.position
    return edges.supply.underlap + shift, edges.return_.underlap - shift


class PortFlows(eqx.Module):
    """Mass flows in and out of port volumes at given drops, with the heat that the oil keeps on its way."""

    supply: OpenEdge
    return_: OpenEdge
    oil: Oil
    fresh: OilAtTemperature  # at the supply's temperature
    heat_retention: Float[Array, "..."] | None
    conditions: Conditions

    def inflow(self, drop: Float[Array, "..."]) -> Float[Array, "..."]:
        return mass_flow(self.supply, self.fresh, drop, self.conditions.supply_pressure - 0.5 * drop)

    def port_temperature(self, supply_drop: Float[Array, "..."]) -> Float[Array, "..."]:
        """T_s + eta times the throttling rise of the inflow; plain T_s where no heat is kept."""
        c = self.conditions
        if self.heat_retention is None:
            return c.temperature
        rise = throttling_rise(self.oil, supply_drop, c.supply_pressure - 0.5 * supply_drop, c.temperature)
        return c.temperature + self.heat_retention * rise

    def outflow(self, drop: Float[Array, "..."], temperature: Float[Array, "..."]) -> Float[Array, "..."]:
        oil = self.fresh if self.heat_retention is None else at_temperature(self.oil, temperature)
        return mass_flow(self.return_, oil, drop, self.conditions.return_pressure + 0.5 * drop)


def port_flows(edges: Edges, oil: Oil, heat_retention: Float[Array, "..."] | None, conditions: Conditions) -> PortFlows:
    """The edges at their openings, ready for any port pressures."""
    supply, return_ = openings(edges, conditions)
    return PortFlows(
        supply=at_opening(edges.supply, supply),
        return_=at_opening(edges.return_, return_),
        oil=oil,
        fresh=at_temperature(oil, conditions.temperature),
        heat_retention=heat_retention,
        conditions=conditions,
    )


def ports_at(flows: PortFlows, drops: Between) -> Ports:
    """The state of both ports at given drops, balanced or not."""
    shape = (2, *flows.conditions.position.shape)
    temperature = flows.port_temperature(drops.supply_drop)
    return Ports(
        pressure=jnp.broadcast_to(flows.conditions.return_pressure + drops.return_drop, shape),
        temperature=jnp.broadcast_to(temperature, shape),
        inflow=flows.inflow(drops.supply_drop),
        outflow=flows.outflow(drops.return_drop, temperature),
    )


def blocked_ports(edges: Edges, oil: Oil, heat_retention: Float[Array, "..."] | None, conditions: Conditions) -> Ports:
    """Both ports closed: each port's inflow equals its outflow, ln(in/out) = 0 (MODEL section 4)."""
    flows = port_flows(edges, oil, heat_retention, conditions)

    def log_ratio(q: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
        drops = between(q, conditions)
        temperature = flows.port_temperature(drops.supply_drop)
        return jnp.log(flows.inflow(drops.supply_drop) / flows.outflow(drops.return_drop, temperature))

    q = falling_root(log_ratio, jnp.zeros((2, *conditions.position.shape)))
    return ports_at(flows, between(q, conditions))


def connected_ports(
    edges: Edges, oil: Oil, heat_retention: Float[Array, "..."] | None, conditions: Conditions
) -> Ports:
    """Both ports joined without loss: p_A = p_B = p_m balances the four edges (the flow-gain test)."""
    flows = port_flows(edges, oil, heat_retention, conditions)

    def log_ratio(q: Float[Array, " rows"]) -> Float[Array, " rows"]:
        drops = between(q, conditions)
        temperature = flows.port_temperature(drops.supply_drop)
        inflow = jnp.sum(flows.inflow(drops.supply_drop), axis=0)
        return jnp.log(inflow / jnp.sum(flows.outflow(drops.return_drop, temperature), axis=0))

    q = falling_root(log_ratio, jnp.zeros(conditions.position.shape), CONNECTED_STEPS)
    return ports_at(flows, between(q, conditions))


def return_temperature(
    ports: Ports, oil: Oil, heat_retention: Float[Array, "..."] | None, conditions: Conditions
) -> Float[Array, " rows"]:
    """Temperature of the joined return flow [K]: each side's port temperature plus its second throttling, by mass."""
    if heat_retention is None:
        return conditions.temperature
    drop = ports.pressure - conditions.return_pressure
    rise = throttling_rise(oil, drop, conditions.return_pressure + 0.5 * drop, ports.temperature)
    leaving = ports.temperature + heat_retention * rise
    return jnp.sum(ports.outflow * leaving, axis=0) / jnp.sum(ports.outflow, axis=0)
