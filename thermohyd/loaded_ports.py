"""The steady balance of both ports with a load between them: p_A - p_B is imposed (the load-flow test)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .balance import falling_root
from .conditions import Conditions
from .edge import at_opening, mass_flow
from .effect import Edges
from .oil import Oil, at_temperature, throttling_rise
from .ports import Ports, openings


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
) -> Ports:
    """Ports under an imposed load pressure `load` = p_A - p_B [Pa], of any sign and size.

    What leaves one port through the load enters the other at the temperature it had (a load takes work out of the oil,
    it does not throttle it). The unknown is the mean port pressure; edges whose drop is negative run backwards, with
    oil of the volume they come from (return oil: at the supply's temperature).
    """
    c = conditions
    low = c.return_pressure - 0.5 * jnp.abs(load)
    span = c.supply_pressure - c.return_pressure + jnp.abs(load)
    offset = jnp.stack([0.5 * load, -0.5 * load])
    supply_opening, return_opening = openings(edges, c)
    supply, return_ = at_opening(edges.supply, supply_opening), at_opening(edges.return_, return_opening)
    fresh = at_temperature(oil, c.temperature)

    def state(q: Float[Array, " rows"]) -> Ports:
        pressure = low + span / (1.0 + jnp.exp(-q)) + offset
        supply_drop, return_drop = c.supply_pressure - pressure, pressure - c.return_pressure
        supply_mean, return_mean = pressure + 0.5 * supply_drop, pressure - 0.5 * return_drop

        # Oil from the supply or the return line is fresh; what runs backwards out of a port is as warm as the port.
        fresh_in = mass_flow(supply, fresh, supply_drop, supply_mean)
        fresh_out = mass_flow(return_, fresh, return_drop, return_mean)
        if heat_retention is None:
            cold = jnp.broadcast_to(c.temperature, pressure.shape)
            return Ports(pressure, cold, fresh_in, fresh_out)

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
        spare = _positive(own_in - own_out)
        warm = mixed(jnp.flip(spare, axis=0), jnp.flip(own, axis=0))
        return Ports(pressure, warm, *flows(warm))

    def log_ratio(q: Float[Array, " rows"]) -> Float[Array, " rows"]:
        ports = state(q)
        into = _positive(ports.inflow) + _positive(-ports.outflow)
        out = _positive(ports.outflow) + _positive(-ports.inflow)
        return jnp.log(jnp.sum(into, axis=0) / jnp.sum(out, axis=0))

    return state(falling_root(log_ratio, jnp.zeros(c.position.shape), NEWTON_STEPS))
