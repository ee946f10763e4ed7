"""The static tests between the seed paper's two heat models: oil that gives heat to a body of its own temperature.

After each throttling the oil passes along the wall and keeps exp(-NTU) of its excess temperature, NTU = h_w A_w/(m c_p)
with the flow of that very edge; the wall is where what it takes from the oil equals what it gives to the ambience. With a
wall as warm as the oil supplied this is MODEL section 4 with eta = exp(-NTU), eta then depending on position, temperature
and pressures through the flow.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .balance import falling_root
from .conditions import Conditions
from .coupled_balance import coupled_root
from .heat_path import HeatPath, Passed, pass_wall
from .oil import Oil, density, specific_heat, throttling_rise
from .ports import Between, PortFlows, Ports, between, port_flows
from .valve import Valve, coupling, metering_edges, read_out, true_conditions, true_oil


# Zero heat makes these flows those of the isothermal model; any value other than None makes them ask for a temperature.
_COMPUTED = 0.0
PASSAGES = 4


class ExchangeState(eqx.Module):
    """Ports and wall in balance; temperatures [K] behind each edge, heat flows [W]."""

    ports: Ports
    wall_temperature: Float[Array, " rows"]
    return_temperature: Float[Array, " rows"]
    heat_made: Float[Array, " rows"]  # by throttling
    heat_lost: Float[Array, " rows"]  # to the ambience
    port_retention: Float[Array, "2 rows"]  # excess temperature of each port over that of an adiabatic one

    @property
    def retention(self) -> Float[Array, " rows"]:
        """Share of the throttling heat that leaves with the oil: 1 behind an insulated body, whatever happens inside."""
        return 1.0 - self.heat_lost / self.heat_made


def _stages(
    flows: PortFlows, oil: Oil, path: HeatPath, drops: Between, wall: Float[Array, " rows"], joined: bool
) -> tuple[ExchangeState, Float[Array, " rows"]]:
    """Both throttling stages at given port drops and wall temperature: the state, and the wall that it asks for.

    `joined`: the ports are one volume, in which the oil of both supply edges mixes.
    """
    c = flows.conditions
    ambient = c.temperature if path.ambient_temperature is None else path.ambient_temperature
    heat = specific_heat(oil, c.temperature)
    quarter = path.wall_conductance / PASSAGES
    shape = (2, *c.position.shape)

    inflow = flows.inflow(drops.supply_drop)
    rise = throttling_rise(oil, drops.supply_drop, c.supply_pressure - 0.5 * drops.supply_drop, c.temperature)
    first = pass_wall(inflow * heat, quarter, c.temperature + rise, wall)
    port = first.temperature
    if joined:
        port = jnp.sum(inflow * port, axis=0) / jnp.sum(inflow, axis=0)
    outflow = flows.outflow(drops.return_drop, port)
    second_rise = throttling_rise(oil, drops.return_drop, c.return_pressure + 0.5 * drops.return_drop, port)
    second = pass_wall(outflow * heat, quarter, port + second_rise, wall)

    def total(supply_side: Float[Array, "..."], return_side: Float[Array, "..."]) -> Float[Array, " rows"]:
        return jnp.sum(jnp.broadcast_to(supply_side, shape) + jnp.broadcast_to(return_side, shape), axis=0)

    def taken(passed: Passed, arriving: Float[Array, "..."]) -> Float[Array, "..."]:
        return passed.conductance * arriving

    weight = total(first.conductance, second.conductance)
    into = total(taken(first, c.temperature + rise), taken(second, port + second_rise))
    state = ExchangeState(
        ports=Ports(
            pressure=jnp.broadcast_to(c.return_pressure + drops.return_drop, shape),
            temperature=jnp.broadcast_to(port, shape),
            inflow=inflow,
            outflow=outflow,
        ),
        wall_temperature=wall,
        return_temperature=jnp.sum(outflow * second.temperature, axis=0) / jnp.sum(outflow, axis=0),
        heat_made=heat * total(inflow * rise, outflow * second_rise),
        heat_lost=into - weight * wall,
        port_retention=jnp.broadcast_to((port - c.temperature) / rise, shape),
    )
    return state, (into + path.ambient_conductance * ambient) / (weight + path.ambient_conductance)


def _solve(valve: Valve, oil: Oil, true: Conditions, path: HeatPath, joined: bool) -> ExchangeState:
    ties = coupling(valve)
    if ties.lines or ties.crossings:
        raise ValueError(
            "heat exchange is not computed together with effects that tie the balances of the ports (supply_droop, "
            "flow_saturation, return_back_pressure, cross_port_leakage): leave them out of the valve"
        )
    flows = port_flows(metering_edges(valve, true), oil, jnp.asarray(_COMPUTED), true)
    rise = throttling_rise(oil, true.supply_pressure - true.return_pressure, true.supply_pressure, true.temperature)
    ambient = true.temperature if path.ambient_temperature is None else path.ambient_temperature
    # Only a measure for the unknown: how far the wall may be from the oil supplied.
    reach = jax.lax.stop_gradient(rise + jnp.abs(ambient - true.temperature))

    def at(z: Float[Array, "unknowns rows"]) -> tuple[ExchangeState, Float[Array, " rows"]]:
        drops = between(z[0] if joined else z[:2], true)
        return _stages(flows, oil, path, drops, true.temperature + reach * z[-1], joined)

    def imbalance(z: Float[Array, "unknowns rows"]) -> Float[Array, "unknowns rows"]:
        state, wanted = at(z)
        ratio = _log_ratio(state.ports, joined)
        return jnp.concatenate([ratio, ((state.wall_temperature - wanted) / reach)[None]])

    def isothermal(q: Float[Array, "ports rows"]) -> Float[Array, "ports rows"]:
        drops = between(q[0] if joined else q, true)
        inflow = flows.inflow(drops.supply_drop)
        return _log_ratio_of(inflow, flows.outflow(drops.return_drop, true.temperature), joined)

    start = falling_root(isothermal, jnp.zeros((1 if joined else 2, *true.position.shape)))
    first = jax.lax.stop_gradient(jnp.concatenate([start, jnp.zeros((1, *true.position.shape))]))
    return at(coupled_root(imbalance, first))[0]


def _log_ratio(ports: Ports, joined: bool) -> Float[Array, "ports rows"]:
    return _log_ratio_of(ports.inflow, ports.outflow, joined)


def _log_ratio_of(inflow: Array, outflow: Array, joined: bool) -> Float[Array, "ports rows"]:
    if joined:
        inflow, outflow = (jnp.sum(flow, axis=0, keepdims=True) for flow in (inflow, outflow))
    return jnp.log(inflow / outflow)


def _spread(path: HeatPath, conditions: Conditions) -> HeatPath:
    """The path with one entry per row, so that its derivatives are taken row by row too."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, conditions.position.shape), path)


@eqx.filter_jit
def exchange_blocked(
    valve: Valve, conditions: Conditions, path: HeatPath
) -> tuple[dict[str, Float[Array, " rows"]], ExchangeState]:
    """Readings with closed use ports (leakage_flow [m3/s], pressure_a, pressure_b, load_pressure [Pa]) and the state.

    The valve's own `heat_retention`, and an effect on it, are replaced by the exchange. Raises ValueError for a valve with
    effects that tie the ports' balances together.
    """
    true, oil = true_conditions(valve, conditions), true_oil(valve)
    state = _solve(valve, oil, true, _spread(path, conditions), joined=False)
    ports = state.ports
    leaving = jnp.sum(ports.outflow, axis=0) / density(oil, true.return_pressure, state.return_temperature)
    values = {
        "leakage_flow": leaving,
        "pressure_a": ports.pressure[0],
        "pressure_b": ports.pressure[1],
        "load_pressure": ports.pressure[0] - ports.pressure[1],
    }
    return {name: read_out(valve, name, value, conditions, true, oil) for name, value in values.items()}, state


@eqx.filter_jit
def exchange_connected(
    valve: Valve, conditions: Conditions, path: HeatPath
) -> tuple[Float[Array, " rows"], ExchangeState]:
    """Control flow of the flow-gain test [m3/s] with connected use ports, and the state; see `exchange_blocked`."""
    true, oil = true_conditions(valve, conditions), true_oil(valve)
    state = _solve(valve, oil, true, _spread(path, conditions), joined=True)
    ports = state.ports
    through = (ports.inflow[0] - ports.outflow[0]) / density(oil, ports.pressure[0], ports.temperature[0])
    return read_out(valve, "flow", through, conditions, true, oil), state


def slopes_in_position(
    reading: Callable[[Conditions], tuple[Array, Array]], conditions: Conditions
) -> tuple[Array, Array, Array]:
    """(reading, its slope over the position, what came with it), row by row."""

    def of(x: Float[Array, " rows"]) -> tuple[Array, Array]:
        return reading(replace(conditions, position=x))

    value, slope, rest = jax.jvp(of, (conditions.position,), (jnp.ones_like(conditions.position),), has_aux=True)
    return value, slope, rest
