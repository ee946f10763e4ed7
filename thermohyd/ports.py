"""The steady balance of the two port volumes: blocked, connected to each other, or under an imposed load pressure.

Arrays carry a leading axis of length 2, port A then port B: the edges of B meet the spool mirrored, so both ports are
one computation with openings U + s x and U - s x, s = +1, -1. In the load-flow test p_A - p_B is imposed.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.effects.effect import AbstractInflowEffect, Edges

from .conditions import Conditions
from .edge import OpenEdge, at_opening, mass_flow
from .flow_balance import falling_root, state_at_root
from .oil import Oil, OilAtTemperature, at_temperature, density, throttling_rise


# Rows whose ports are connected to each other: none, all, or those where it is true (rows or a single one).
Joined = bool | Bool[Array, "..."]
# Pressure [Pa] by which supply and return differ at least where a balance is sought: see `apart`. Flows are laminar there to 1e-8.
LEAST = 1e-3
MIRROR = np.array([[1.0], [-1.0]])


class Ports(eqx.Module):
    """The solved state of both ports: pressures [Pa, gauge], temperatures [K], mass flows through the edges [kg/s]."""

    pressure: Float[Array, "2 rows"]
    temperature: Float[Array, "2 rows"]
    inflow: Float[Array, "2 rows"]  # P-A, P-B
    outflow: Float[Array, "2 rows"]  # A-T, B-T
    # Net flow in by no edge, from the other port past the spool or from outside; None: no such path.
    crossing: Float[Array, "2 rows"] | None = None


class Between(eqx.Module):
    """Pressures between supply and return by the logit q of their share: both drops keep full relative precision."""

    supply_drop: Float[Array, "..."]
    return_drop: Float[Array, "..."]


def apart(conditions: Conditions, load: Float[Array, "..."] | float = 0.0) -> Conditions:
    """The conditions, and where nothing drives a flow (no load [Pa] either) the supply `LEAST` above the return.

    There every share of no pressure balances, and ln(0/0) has no derivative. The share that flows have in the limit does: with it
    flows at the conditions themselves are 0, and their first derivatives those of the limit.
    """
    supply, return_ = conditions.supply_pressure, conditions.return_pressure
    none = jnp.abs(supply - return_) + jnp.abs(load) < LEAST
    return eqx.tree_at(lambda c: c.supply_pressure, conditions, jnp.where(none, return_ + LEAST, supply))


def driven(ports: "Ports", conditions: Conditions) -> "Ports":
    """The state at the conditions of one that was solved `apart`: where nothing drives a flow, pressures and flows through edges are in
    proportion to what does."""
    whole = conditions.supply_pressure - conditions.return_pressure
    share = jnp.where(jnp.abs(whole) < LEAST, whole / LEAST, 1.0)
    drop = ports.pressure - conditions.return_pressure
    parts = (conditions.return_pressure + share * drop, share * ports.inflow, share * ports.outflow)
    return eqx.tree_at(lambda p: (p.pressure, p.inflow, p.outflow), ports, parts)


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
    outside: tuple[AbstractInflowEffect, ...] = ()

    def at(self, conditions: Conditions) -> "PortFlows":
        """The same at other pressures."""
        return eqx.tree_at(lambda flows: flows.conditions, self, conditions)

    def entering(self, drops: "Between") -> Float[Array, "2 rows"] | None:
        """Mass flow [kg/s] from outside into each port, at the supply's temperature; None where nothing lets it in."""
        c = self.conditions
        pressure = jnp.broadcast_to(c.return_pressure + drops.return_drop, (2, *c.position.shape))
        return mass_from_outside(self.outside, pressure, self.oil, c)

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


def mass_from_outside(
    outside: tuple[AbstractInflowEffect, ...], pressure: Float[Array, "2 rows"], oil: Oil, conditions: Conditions
) -> Float[Array, "2 rows"] | None:
    """Mass flow [kg/s] of all effects that let oil into the ports, at the supply's temperature; None where there is none."""
    if not outside:
        return None
    volume = sum((effect.inflow(pressure, oil, conditions) for effect in outside), start=jnp.zeros_like(pressure))
    return density(oil, pressure, conditions.temperature) * volume


def with_what_enters(
    into: Float[Array, "..."], out: Float[Array, "..."], extra: Float[Array, "..."] | None
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Mass flows [kg/s] into and out of ports with what comes in by no edge, below 0: goes out; None: nothing does."""
    return (into, out) if extra is None else (into + _positive(extra), out + _positive(-extra))


def port_flows(
    edges: Edges,
    oil: Oil,
    heat_retention: Float[Array, "..."] | None,
    conditions: Conditions,
    outside: tuple[AbstractInflowEffect, ...] = (),
) -> PortFlows:
    """The edges at their openings, ready for any port pressures."""
    supply, return_ = openings(edges, conditions)
    return PortFlows(
        supply=at_opening(edges.supply, supply),
        return_=at_opening(edges.return_, return_),
        oil=oil,
        fresh=at_temperature(oil, conditions.temperature),
        heat_retention=heat_retention,
        conditions=conditions,
        outside=outside,
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
        crossing=flows.entering(drops),
    )


def log_ratio(into: Float[Array, "2 rows"], out: Float[Array, "2 rows"], joined: Joined) -> Float[Array, "2 rows"]:
    """ln(in/out) of each port by itself, or where they are joined that of both together, twice."""
    if joined is not False:
        into, out = (jnp.where(joined, jnp.sum(flow, axis=0), flow) for flow in (into, out))
    return jnp.log(into / out)


def unloaded_ports(
    edges: Edges,
    oil: Oil,
    heat_retention: Float[Array, "..."] | None,
    conditions: Conditions,
    outside: tuple[AbstractInflowEffect, ...] = (),
    joined: Joined = False,
) -> Ports:
    """Both ports closed: each port's inflow equals its outflow, ln(in/out) = 0 (docs/physics.md section 5).

    joined: without loss to each other, so that p_A = p_B balances the four edges (the flow-gain test).
    """
    flows = port_flows(edges, oil, heat_retention, apart(conditions), outside)

    def balance(q: Float[Array, "2 rows"]) -> tuple[Float[Array, "2 rows"], Ports]:
        ports = ports_at(flows, between(q, flows.conditions))
        return log_ratio(*with_what_enters(ports.inflow, ports.outflow, ports.crossing), joined), ports

    # Of joined ports both logits are one: they begin alike, and each step moves both by the balance of both.
    ports = state_at_root(balance, jnp.zeros((2, *conditions.position.shape)))
    return driven(ports, conditions)


def return_temperature(
    ports: Ports, oil: Oil, heat_retention: Float[Array, "..."] | None, conditions: Conditions
) -> Float[Array, " rows"]:
    """Temperature of the joined return flow [K]: each side's port temperature plus its second throttling, by mass."""
    if heat_retention is None:
        return conditions.temperature
    drop = ports.pressure - conditions.return_pressure
    rise = throttling_rise(oil, drop, conditions.return_pressure + 0.5 * drop, ports.temperature)
    leaving = ports.temperature + heat_retention * rise
    total = jnp.sum(ports.outflow, axis=0)
    some = total != 0.0
    joined = jnp.sum(ports.outflow * leaving, axis=0) / jnp.where(some, total, 1.0)
    return jnp.where(some, joined, jnp.mean(leaving, axis=0))


# Edges may run backwards under an overrunning load, where the logarithmic balance has kinks: more steps than a blocked port.
NEWTON_STEPS = 10


def _positive(flow: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.maximum(flow, 0.0)


def loaded_ports(
    edges: Edges,
    oil: Oil,
    heat_retention: Float[Array, "..."] | None,
    conditions: Conditions,
    load: Float[Array, " rows"],
    outside: tuple[AbstractInflowEffect, ...] = (),
) -> Ports:
    """Ports under an imposed load pressure `load` = p_A - p_B [Pa], of any sign and size.

    What leaves one port through the load enters the other at the temperature it had (a load takes work out of the oil,
    it does not throttle it). The unknown is the mean port pressure; edges whose drop is negative run backwards, with
    oil of the volume they come from (return oil: at the supply's temperature).
    """
    offset = jnp.stack([0.5 * load, -0.5 * load])
    supply_opening, return_opening = openings(edges, conditions)
    supply, return_ = at_opening(edges.supply, supply_opening), at_opening(edges.return_, return_opening)
    fresh = at_temperature(oil, conditions.temperature)
    sought = apart(conditions, load)

    def state(q: Float[Array, " rows"], c: Conditions) -> Ports:
        low = c.return_pressure - 0.5 * jnp.abs(load)
        span = c.supply_pressure - c.return_pressure + jnp.abs(load)
        pressure = low + span / (1.0 + jnp.exp(-q)) + offset
        supply_drop, return_drop = c.supply_pressure - pressure, pressure - c.return_pressure
        supply_mean, return_mean = pressure + 0.5 * supply_drop, pressure - 0.5 * return_drop

        # Oil from the supply or the return line is fresh; what runs backwards out of a port is as warm as the port.
        fresh_in = mass_flow(supply, fresh, supply_drop, supply_mean)
        fresh_out = mass_flow(return_, fresh, return_drop, return_mean)
        extra = mass_from_outside(outside, pressure, oil, c)
        if heat_retention is None:
            cold = jnp.broadcast_to(c.temperature, pressure.shape)
            return Ports(pressure, cold, fresh_in, fresh_out, extra)

        def flows(warm: Float[Array, "2 rows"]) -> tuple[Float[Array, "2 rows"], Float[Array, "2 rows"]]:
            port = at_temperature(oil, warm)
            backwards = mass_flow(supply, port, supply_drop, supply_mean)
            forwards = mass_flow(return_, port, return_drop, return_mean)
            return jnp.where(supply_drop < 0.0, backwards, fresh_in), jnp.where(return_drop < 0.0, fresh_out, forwards)

        from_supply = c.temperature + heat_retention * throttling_rise(
            oil, _positive(supply_drop), supply_mean, c.temperature
        )
        from_return = c.temperature + heat_retention * throttling_rise(
            oil, _positive(-return_drop), return_mean, c.temperature
        )
        fed, back = _positive(fresh_in), _positive(-fresh_out)

        def mixed(brought: Float[Array, "..."], other: Float[Array, "..."]) -> Float[Array, "2 rows"]:
            total = fed + back + brought
            mean = (fed * from_supply + back * from_return + brought * other) / jnp.where(total > 0.0, total, 1.0)
            return jnp.where(total > 0.0, mean, c.temperature)

        # What one port has to spare goes through the load to the other, at the temperature it had there.
        own = mixed(jnp.zeros(()), jnp.zeros(()))
        own_in, own_out = flows(own)
        spare = _positive(own_in - own_out if extra is None else own_in - own_out + extra)
        warm = mixed(jnp.flip(spare, axis=0), jnp.flip(own, axis=0))
        return Ports(pressure, warm, *flows(warm), extra)

    def log_ratio(q: Float[Array, " rows"]) -> Float[Array, " rows"]:
        ports = state(q, sought)
        into = _positive(ports.inflow) + _positive(-ports.outflow)
        out = _positive(ports.outflow) + _positive(-ports.inflow)
        into, out = with_what_enters(into, out, ports.crossing)
        return jnp.log(jnp.sum(into, axis=0) / jnp.sum(out, axis=0))

    return state(falling_root(log_ratio, jnp.zeros(conditions.position.shape), NEWTON_STEPS), conditions)
