"""The balance under an imposed load pressure when lines or a path between the ports tie it together (load-flow test)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .conditions import Conditions
from .coupled_ports import crossing_conductance, solve_with_lines
from .edge import at_opening, mass_flow
from .effect import Coupling, Edges
from .loaded_ports import loaded_ports
from .oil import Oil, at_temperature, density, throttling_rise
from .ports import Ports, openings


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
    exists; the temperatures that come out there mean nothing.
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
        ports = Ports(pressure, warm, inflow, outflow, crossing)
        came = jnp.sum(_positive(inflow) + _positive(-outflow), axis=0)
        left = jnp.sum(_positive(outflow) + _positive(-inflow), axis=0)
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

    alone = loaded_ports(edges, oil, heat_retention, conditions, load)
    span = conditions.supply_pressure - conditions.return_pressure
    share = (jnp.mean(alone.pressure, axis=0) - conditions.return_pressure + 0.5 * jnp.abs(load)) / (
        span + jnp.abs(load)
    )
    start = (jnp.log(share) - jnp.log1p(-share))[None]
    if heat_retention is not None:
        start = jnp.concatenate([start, (alone.temperature - cold) / TEMPERATURE_UNIT])
    return solve_with_lines(balance, start, oil, conditions, coupling.lines, warm_return, jnp.abs(load) / span)
