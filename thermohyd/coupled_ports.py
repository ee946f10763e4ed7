"""Balances of ports that lines or a path between them tie together: closed, connected and loaded use ports (docs/physics.md section 5).

Lines between the gauges and the edges add two unknowns per row, the pressures that the edges see; they are counted as
shares of the gauges' difference. The pressures *inside* come back as conditions beside the ports. Under an imposed load
pressure the temperatures of the ports are unknowns too where the oil keeps heat.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.effects.effect import AbstractCrossingEffect, AbstractLineEffect, Coupling, Edges

from .conditions import Conditions
from .edge import at_opening, mass_flow
from .flow_balance import coupled_root, falling_root
from .oil import Oil, at_temperature, density, throttling_rise
from .ports import (
    Between,
    Joined,
    PortFlows,
    Ports,
    apart,
    between,
    loaded_ports,
    log_ratio,
    mass_from_outside,
    openings,
    port_flows,
    ports_at,
    return_temperature,
    with_what_enters,
)


# The ports' own unknowns (unknowns, rows) and the pressures inside -> their imbalances, and the state.
PortBalance = Callable[[Float[Array, "unknowns rows"], Conditions], tuple[Float[Array, "unknowns rows"], Ports]]
ReturnTemperature = Callable[[Ports, Conditions], Float[Array, " rows"]]


def with_pressures(conditions: Conditions, supply: Float[Array, "..."], return_: Float[Array, "..."]) -> Conditions:
    return eqx.tree_at(lambda c: (c.supply_pressure, c.return_pressure), conditions, (supply, return_))


def lost_in_lines(
    lines: tuple[AbstractLineEffect, ...], ports: Ports, oil: Oil, gauges: Conditions, warm: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """(drop of the supply, rise of the return) [Pa] of all lines; flows are volumes at the gauges, the return's at `warm` [K]."""
    supply_flow = jnp.sum(ports.inflow, axis=0) / density(oil, gauges.supply_pressure, gauges.temperature)
    return_flow = jnp.sum(ports.outflow, axis=0) / density(oil, gauges.return_pressure, warm)
    losses = [line.losses(supply_flow, return_flow) for line in lines]
    lost, gained = (sum(parts, start=jnp.zeros(())) for parts in zip(*losses, strict=True))
    return lost, gained


def solve_with_lines(
    balance: PortBalance,
    start: Float[Array, "unknowns rows"],
    oil: Oil,
    gauges: Conditions,
    lines: tuple[AbstractLineEffect, ...],
    warm_return: ReturnTemperature,
    load: Float[Array, " rows"] | float = 0.0,
) -> tuple[Ports, Conditions]:
    """Ports and lines in balance: (state of the ports, conditions inside the lines).

    Flows through the lines are volumes at the gauges, the return's at `warm_return`. The pressure difference inside,
    plus the size of an imposed load pressure, stays positive.
    """
    count = start.shape[0]
    sought = apart(gauges, load)
    span = sought.supply_pressure - sought.return_pressure

    def inside(z: Float[Array, "unknowns rows"], at: Conditions) -> Conditions:
        if not lines:
            return at
        whole = at.supply_pressure - at.return_pressure
        return with_pressures(at, at.supply_pressure - z[count] * whole, at.return_pressure + z[count + 1] * whole)

    def imbalance(z: Float[Array, "unknowns rows"]) -> Float[Array, "unknowns rows"]:
        within = inside(z, sought)
        residual, ports = balance(z[:count], within)
        if not lines:
            return residual
        lost, gained = lost_in_lines(lines, ports, oil, sought, warm_return(ports, within))
        return jnp.concatenate([residual, jnp.stack([z[count] - lost / span, z[count + 1] - gained / span])])

    def room(z: Float[Array, "unknowns rows"]) -> Float[Array, " rows"]:
        return 1.0 - z[count] - z[count + 1] + jnp.abs(load) / span

    extra = jnp.zeros((2 if lines else 0, *start.shape[1:]))
    first = jax.lax.stop_gradient(jnp.concatenate([start, extra]))
    z = coupled_root(imbalance, first, room if lines else None)
    within = inside(z, gauges)
    return balance(z[:count], within)[1], within


def crossing_conductance(
    crossings: tuple[AbstractCrossingEffect, ...], oil: Oil, conditions: Conditions
) -> Float[Array, "..."]:
    """Volume conductance [m3/(s Pa)] of all paths between the ports together."""
    return sum((path.conductance(oil, conditions) for path in crossings), start=jnp.zeros(()))


def _with_crossing(
    flows: PortFlows, q: Float[Array, "2 rows"], conductance: Float[Array, "..."] | None, joined: Joined
) -> tuple[Float[Array, "2 rows"], Ports]:
    """Imbalances ln(in/out) of both ports and their state."""
    ports, into, out = ports_with_crossing(flows, between(q, flows.conditions), conductance)
    return log_ratio(ports.inflow + into, ports.outflow + out, joined), ports


def ports_with_crossing(
    flows: PortFlows, drops: Between, conductance: Float[Array, "..."] | None
) -> tuple[Ports, Float[Array, "..."], Float[Array, "..."]]:
    """Both closed ports at given drops, balanced or not, and the mass flows [kg/s] that pass no edge into each and out of it.

    The port of the higher pressure holds supply oil only; the other one mixes it with what crosses over.
    """
    conditions = flows.conditions
    ports = ports_at(flows, drops)
    extra = ports.crossing
    if conductance is None:
        return ports, *with_what_enters(jnp.zeros(()), jnp.zeros(()), extra)
    up, down = drops.supply_drop, drops.return_drop
    # p_A - p_B from the smaller drops keeps its digits where both ports are near one end.
    drop = jnp.where(jnp.sum(up, axis=0) < jnp.sum(down, axis=0), up[1] - up[0], down[0] - down[1])
    mean = conditions.return_pressure + 0.5 * jnp.sum(down, axis=0)
    sent = jnp.where(drop > 0.0, ports.temperature[0], ports.temperature[1])
    mass = conductance * density(flows.oil, mean, sent)  # per pressure
    fall = jnp.stack([drop, -drop])
    out, into = mass * jnp.maximum(fall, 0.0), mass * jnp.maximum(-fall, 0.0)
    if flows.heat_retention is not None:
        other = jnp.flip(ports.temperature, axis=0)
        arriving = other + flows.heat_retention * throttling_rise(flows.oil, -fall, mean, other)
        total = ports.inflow + into
        share = jnp.where(total != 0.0, into / jnp.where(total != 0.0, total, 1.0), 0.0)
        warm = ports.temperature + share * (arriving - ports.temperature)
        ports = eqx.tree_at(lambda p: (p.temperature, p.outflow), ports, (warm, flows.outflow(drops.return_drop, warm)))
    into, out = with_what_enters(into, out, extra)
    return Ports(ports.pressure, ports.temperature, ports.inflow, ports.outflow, crossing=into - out), into, out


# Joined ports sit near the middle between supply and return: 4 Newton steps leave rounding only.
JOINT_STEPS = 4


def _drawn_together(
    flows: PortFlows, q: Float[Array, "2 rows"], conductance: Float[Array, "..."]
) -> Float[Array, "2 rows"]:
    """Where to start with a path between the ports: on the way from each port alone, at `q`, to both at one pressure.

    X is the mass flow from A to B that the edges would make up. It falls with D = p_A - p_B from X_0 at one pressure to
    none at D_0, where the ports are alone; were it linear, X = g D would be at D_0 X_0 / (X_0 + g D_0). Starting from
    either end instead leaves one row in a hundred unsolved.
    """
    conditions = flows.conditions

    def joint(common: Float[Array, " rows"]) -> Float[Array, " rows"]:
        ports = ports_at(flows, between(common, conditions))
        return jnp.log(jnp.sum(ports.inflow, axis=0) / jnp.sum(ports.outflow, axis=0))

    one = between(falling_root(joint, jnp.zeros(conditions.position.shape), JOINT_STEPS), conditions)
    two, ports = between(q, conditions), ports_at(flows, one)
    surplus = ports.inflow - ports.outflow
    exchanged = 0.5 * jnp.abs(surplus[0] - surplus[1])
    apart = jnp.abs(two.return_drop[0] - two.return_drop[1])
    crossing = conductance * density(flows.oil, conditions.return_pressure, conditions.temperature) * apart
    share = jnp.where(crossing > 0.0, exchanged / jnp.where(crossing > 0.0, exchanged + crossing, 1.0), 1.0)
    up = one.supply_drop + share * (two.supply_drop - one.supply_drop)
    down = one.return_drop + share * (two.return_drop - one.return_drop)
    return jnp.where(share < 1.0, jnp.log(down / up), q)


def coupled_unloaded_ports(
    edges: Edges,
    oil: Oil,
    heat_retention: Float[Array, "..."] | None,
    conditions: Conditions,
    coupling: Coupling,
    joined: Joined = False,
) -> tuple[Ports, Conditions]:
    """As `unloaded_ports`, with lines and flow between the ports: (ports, conditions inside the lines).

    Nothing crosses between ports that are joined without loss.
    """
    flows = port_flows(edges, oil, heat_retention, conditions, coupling.inflows)
    sought = flows.at(apart(conditions))
    conductance = None
    if coupling.crossings and joined is not True:
        conductance = crossing_conductance(coupling.crossings, oil, conditions)
        conductance = jnp.where(joined, 0.0, conductance)

    def alone(q: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
        return _with_crossing(sought, q, None, joined)[0]

    def balance(q: Float[Array, "2 rows"], inside: Conditions) -> tuple[Float[Array, "2 rows"], Ports]:
        imbalance, ports = _with_crossing(flows.at(inside), q, conductance, joined)
        if joined is False:
            return imbalance, ports
        # Both balances of joined ports are one; the other is that they stay at one pressure.
        return jnp.where(joined, jnp.stack([imbalance[0], q[1] - q[0]]), imbalance), ports

    start = falling_root(alone, jnp.zeros((2, *conditions.position.shape)))
    if conductance is not None:
        start = _drawn_together(sought, start, conductance)

    def warm(ports: Ports, inside: Conditions) -> Float[Array, " rows"]:
        return return_temperature(ports, oil, heat_retention, inside)

    return solve_with_lines(balance, start, oil, conditions, coupling.lines, warm)


# A large change of a port temperature [K]: the unit of the temperatures among the unknowns.
TEMPERATURE_UNIT = 10.0


def _positive(flow: Float[Array, "..."]) -> Float[Array, "..."]:
    return jnp.maximum(flow, 0.0)


def _mixed(streams: list[tuple[Array, Array]], otherwise: Float[Array, "..."]) -> Float[Array, "..."]:
    """Flow-weighted temperature of (flow in, temperature on arrival); `otherwise` where nothing flows."""
    total = sum((flow for flow, _ in streams), start=jnp.zeros(()))
    heat = sum((flow * (warm - otherwise) for flow, warm in streams), start=jnp.zeros(()))
    return otherwise + jnp.where(total > 0.0, heat / jnp.where(total > 0.0, total, 1.0), 0.0)


def coupled_loaded_ports(
    edges: Edges,
    oil: Oil,
    heat_retention: Float[Array, "..."] | None,
    conditions: Conditions,
    load: Float[Array, " rows"],
    coupling: Coupling,
) -> tuple[Ports, Conditions]:
    """As `loaded_ports`, with lines and flow between the ports: (ports, conditions inside the lines).

    Where the oil keeps heat both port temperatures are unknowns: what crosses over may come back through the load. With
    overlapped edges, eta near 1 and a load that returns what crossed over, nothing cools that oil and no steady state
    exists: such rows are NaN.
    """
    supply_opening, return_opening = openings(edges, conditions)
    supply, return_ = at_opening(edges.supply, supply_opening), at_opening(edges.return_, return_opening)
    cold = conditions.temperature
    fresh = at_temperature(oil, cold)
    conductance = crossing_conductance(coupling.crossings, oil, conditions) if coupling.crossings else None
    fall = jnp.stack([load, -load])

    def balance(u: Float[Array, "own rows"], inside: Conditions) -> tuple[Float[Array, "own rows"], Ports]:
        mean = (
            inside.return_pressure
            - 0.5 * jnp.abs(load)
            + (inside.supply_pressure - inside.return_pressure + jnp.abs(load)) / (1.0 + jnp.exp(-u[0]))
        )
        pressure = mean + 0.5 * fall
        supply_drop, return_drop = inside.supply_pressure - pressure, pressure - inside.return_pressure
        supply_mean, return_mean = pressure + 0.5 * supply_drop, pressure - 0.5 * return_drop
        warm = jnp.broadcast_to(cold, pressure.shape)
        inflow = mass_flow(supply, fresh, supply_drop, supply_mean)
        outflow = mass_flow(return_, fresh, return_drop, return_mean)
        if heat_retention is not None:
            warm = cold + TEMPERATURE_UNIT * u[1:]
            hot = at_temperature(oil, warm)
            inflow = jnp.where(supply_drop < 0.0, mass_flow(supply, hot, supply_drop, supply_mean), inflow)
            outflow = jnp.where(return_drop < 0.0, outflow, mass_flow(return_, hot, return_drop, return_mean))
        into, crossing = jnp.zeros(()), None
        if conductance is not None:
            mass = conductance * density(oil, mean, jnp.where(load > 0.0, warm[0], warm[1]))
            into = mass * _positive(-fall)
            crossing = into - mass * _positive(fall)
        extra = mass_from_outside(coupling.inflows, pressure, oil, inside)
        came, left = _positive(inflow) + _positive(-outflow), _positive(outflow) + _positive(-inflow)
        came, left = (jnp.sum(flow, axis=0) for flow in with_what_enters(came, left, extra))
        if extra is not None:
            crossing = extra if crossing is None else crossing + extra
        ports = Ports(pressure, warm, inflow, outflow, crossing)
        residual = jnp.log(came / left)[None]
        if heat_retention is None:
            return residual, ports
        other = jnp.flip(warm, axis=0)
        surplus = inflow - outflow if crossing is None else inflow - outflow + crossing
        arriving = _mixed(
            [
                (_positive(inflow), cold + heat_retention * throttling_rise(oil, supply_drop, supply_mean, cold)),
                (_positive(-outflow), cold + heat_retention * throttling_rise(oil, -return_drop, return_mean, cold)),
                (into + 0.0 * pressure, other + heat_retention * throttling_rise(oil, -fall, mean, other)),
                (_positive(jnp.flip(surplus, axis=0)), other),
            ],
            cold,
        )
        return jnp.concatenate([residual, (warm - arriving) / TEMPERATURE_UNIT]), ports

    def warm_return(ports: Ports, inside: Conditions) -> Float[Array, " rows"]:
        if heat_retention is None:
            return cold
        drop = ports.pressure - inside.return_pressure
        rise = throttling_rise(oil, drop, inside.return_pressure + 0.5 * drop, ports.temperature)
        leaving, flow = ports.temperature + heat_retention * rise, _positive(ports.outflow)
        return _mixed([(flow[i], leaving[i]) for i in (0, 1)], cold)

    sought = apart(conditions, load)
    alone = loaded_ports(edges, oil, heat_retention, sought, load, coupling.inflows)
    span = sought.supply_pressure - sought.return_pressure
    share = (jnp.mean(alone.pressure, axis=0) - conditions.return_pressure + 0.5 * jnp.abs(load)) / (
        span + jnp.abs(load)
    )
    start = (jnp.log(share) - jnp.log1p(-share))[None]
    if heat_retention is not None:
        start = jnp.concatenate([start, (alone.temperature - cold) / TEMPERATURE_UNIT])
    return solve_with_lines(balance, start, oil, conditions, coupling.lines, warm_return, load)
