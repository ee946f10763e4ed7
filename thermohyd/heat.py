"""Heat between the extremes: oil that gives part of its throttling heat to a wall, and a wall that gives it to the air.

What the seed paper left as future work. HM and THM are its limits: all heat leaves (a perfect contact with a wall held at
the supply's temperature), or none does (no contact). Each port's volume and each side's return volume exchange heat with
one wall, in plug flow: T_out = T_w + (T_in - T_w) eta, eta = exp(-NTU), NTU = h_w A_w/(m c_p) with the valve's own mass
flow m. The wall is in balance: what the oil gives it, G_amb takes to the air.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .conditions import Conditions
from .flow_balance import coupled_root, falling_root
from .oil import Oil, specific_heat, throttling_rise
from .ports import PortFlows, Ports, between, port_flows
from .valve import Valve, coupling, metering_edges


def _as_array(value: float | Array) -> Array:
    return jnp.asarray(value, dtype=jnp.result_type(float))


class HeatExchange(eqx.Module):
    """Contact between oil, wall and air. Fields are numbers or one per row, differentiable; infinite conductances are allowed.

    wall_conductance: h_w A_w [W/K] of each of the four volumes behind an edge (ports A and B, return of either side).
    ambient_conductance: G_amb [W/K] from the wall to the air, 0 insulated. ambient_temperature: T_amb [K], None: that of
    the oil supplied. No wall_conductance is the adiabatic model, an infinite one with an infinite ambient_conductance and
    ambient_temperature None the isothermal one.
    """

    wall_conductance: Float[Array, "..."] = eqx.field(converter=_as_array)
    ambient_conductance: Float[Array, "..."] = eqx.field(converter=_as_array, default=jnp.inf)
    ambient_temperature: Float[Array, "..."] | None = None


class WallState(eqx.Module):
    """The ports, with eta (2, rows) of their volumes, and the temperatures [K] of the wall and of the joined return (rows,)."""

    ports: Ports
    eta: Float[Array, "2 rows"]
    wall_temperature: Float[Array, " rows"]
    return_temperature: Float[Array, " rows"]


def eta_from_ntu(ntu: ArrayLike) -> Array:
    """Share of its excess over the wall that oil keeps in plug flow: eta = exp(-NTU); 1 at 0, 0 at infinity."""
    return jnp.exp(-jnp.asarray(ntu))


def effectiveness(conductance: ArrayLike, mass_flow: ArrayLike, heat_capacity: ArrayLike) -> Array:
    """1 - eta: share of its excess over the wall that oil gives away, NTU = h_w A_w [W/K]/(m [kg/s] c_p [J/(kg K)]).

    Derivatives are finite at no conductance and, as zero, at an infinite one.

    >>> print(float(effectiveness(0.0, 1e-3, 2000.0)), float(effectiveness(float("inf"), 1e-3, 2000.0)))
    0.0 1.0
    >>> print(f"{float(effectiveness(2.0, 1e-3, 2000.0)):.4f}")
    0.6321
    """
    conductance = jnp.asarray(conductance, dtype=jnp.result_type(float))
    finite = jnp.isfinite(conductance)
    ntu = jnp.where(finite, conductance, 0.0) / (jnp.asarray(mass_flow) * jnp.asarray(heat_capacity))
    return jnp.where(finite, -jnp.expm1(-ntu), 1.0)


def _weighted_wall(
    gains: list[tuple[Array, Array]], exchange: HeatExchange, excess_of_air: Float[Array, " rows"]
) -> Float[Array, " rows"]:
    """The wall's excess [K] over the supply where its heat balances: mean of what touches it, weighted by conductance.

    gains: (effective conductance m c_p (1 - eta) [W/K], excess of the oil that enters [K]) of shape (streams, rows).
    """
    taken = sum((jnp.sum(g, axis=0) for g, _ in gains), start=jnp.zeros(()))
    brought = sum((jnp.sum(g * t, axis=0) for g, t in gains), start=jnp.zeros(()))
    finite = jnp.isfinite(exchange.ambient_conductance)
    air = jnp.where(finite, exchange.ambient_conductance, 0.0)
    total = taken + air
    # A wall that nothing touches has no balance; its temperature acts on nothing.
    alone = total == 0.0
    balanced = (brought + air * excess_of_air) / jnp.where(alone, 1.0, total)
    return jnp.where(finite, jnp.where(alone, 0.0, balanced), excess_of_air)


class _Wall(eqx.Module):
    """The valve's port balance with a wall: residuals and state at given unknowns."""

    flows: PortFlows
    exchange: HeatExchange
    joined: bool = eqx.field(static=True)

    @property
    def oil(self) -> Oil:
        return self.flows.oil

    def air(self) -> Float[Array, " rows"]:
        c = self.flows.conditions
        given = self.exchange.ambient_temperature
        return jnp.zeros_like(c.temperature) if given is None else given - c.temperature

    def unit(self) -> Float[Array, " rows"]:
        """What the wall's excess is counted in [K]: the whole throttling rise, and the air's distance."""
        c = self.flows.conditions
        drop = c.supply_pressure - c.return_pressure
        rise = throttling_rise(self.oil, drop, c.return_pressure + 0.5 * drop, c.temperature)
        return jax.lax.stop_gradient(rise + jnp.abs(self.air()))

    def balance(self, z: Float[Array, "unknowns rows"]) -> tuple[Float[Array, "unknowns rows"], WallState]:
        """z: q of port A and of port B (closed) or of both (joined), then the wall's excess in its unit."""
        c = self.flows.conditions
        shape = (2, *c.position.shape)
        drops = between(z[:-1], c)
        heat = specific_heat(self.oil, c.temperature)
        inflow = jnp.broadcast_to(self.flows.inflow(drops.supply_drop), shape)
        # Joined ports are one volume with both walls.
        fed, volumes = (jnp.sum(inflow, axis=0, keepdims=True), 2.0) if self.joined else (inflow, 1.0)
        wall = c.temperature + z[-1] * self.unit()

        given = effectiveness(volumes * self.exchange.wall_conductance, fed, heat)
        entering = self.flows.port_temperature(drops.supply_drop)
        warm = entering + given * (wall - entering)
        outflow = jnp.broadcast_to(self.flows.outflow(drops.return_drop, warm), shape)

        back = effectiveness(self.exchange.wall_conductance, outflow, heat)
        rise = throttling_rise(self.oil, drops.return_drop, c.return_pressure + 0.5 * drops.return_drop, warm)
        returning = jnp.broadcast_to(warm + rise, shape)
        leaving = returning + back * (wall - returning)

        gains = [
            (fed * heat * given, jnp.broadcast_to(entering - c.temperature, fed.shape)),
            (outflow * heat * back, returning - c.temperature),
        ]
        balanced = _weighted_wall(gains, self.exchange, self.air())
        out = jnp.sum(outflow, axis=0, keepdims=True) if self.joined else outflow
        residual = jnp.concatenate([jnp.log(fed / out), (z[-1] - balanced / self.unit())[None]])
        ports = Ports(
            pressure=jnp.broadcast_to(c.return_pressure + drops.return_drop, shape),
            temperature=jnp.broadcast_to(warm, shape),
            inflow=inflow,
            outflow=outflow,
        )
        state = WallState(
            ports=ports,
            eta=jnp.broadcast_to(1.0 - given, shape),
            wall_temperature=wall,
            return_temperature=jnp.sum(outflow * leaving, axis=0) / jnp.sum(outflow, axis=0),
        )
        return residual, state


def wall_state(valve: Valve, oil: Oil, exchange: HeatExchange, true: Conditions, *, joined: bool) -> WallState:
    """The ports (closed, or joined without loss) and the wall in balance together; `oil` and `true` as the edges see them.

    Flow, eta and the wall's temperature depend on each other: one damped Newton solve per row, differentiated implicitly,
    forward and reverse. The valve's own heat_retention takes no part. Raises ValueError for a valve whose effects tie the
    ports to lines or to each other, which this balance leaves out.
    """
    ties = coupling(valve)
    if ties.lines or ties.crossings or ties.inflows:
        names = ", ".join(type(effect).__name__ for effect in (*ties.lines, *ties.crossings, *ties.inflows))
        raise ValueError(f"heat exchange with a wall is not solved together with {names}: leave these effects out")
    edges = metering_edges(valve, true)
    wall = _Wall(port_flows(edges, oil, jnp.ones(()), true), exchange, joined)
    start = jnp.zeros((1 if joined else 2, *true.position.shape))

    def isothermal(q: Float[Array, "unknowns rows"]) -> Float[Array, "unknowns rows"]:
        drops = between(q, true)
        into, out = wall.flows.inflow(drops.supply_drop), wall.flows.outflow(drops.return_drop, true.temperature)
        if joined:
            into, out = (jnp.sum(m, axis=0, keepdims=True) for m in (into, out))
        return jnp.log(into / out)

    begin = jnp.concatenate([falling_root(isothermal, start), jnp.zeros((1, *true.position.shape))])
    z = coupled_root(lambda z: wall.balance(z)[0], jax.lax.stop_gradient(begin))
    return wall.balance(z)[1]
