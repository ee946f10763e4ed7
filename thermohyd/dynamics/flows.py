"""Flows into and out of the chambers at any pressures, with the heat that comes with them (MODEL sections 3 and 7).

Arrays have the two ports A, B along their only axis. The edge law is that of the static tests; here a drop may have
either sign, and the oil is that of the side which the flow leaves. What would come back from the return is at T_s.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..balance import falling_root
from ..edge import MeteringEdge, OpenEdge, at_opening, mass_flow
from ..oil import Oil, OilAtTemperature, at_temperature, density, density_at, throttling_rise
from .plant import Plant, Supplied, Surroundings
from .state import State


# Port A's supply edge and port B's return edge open with +x.
MIRROR = np.array([1.0, -1.0])
JET_ANGLE = math.cos(math.radians(69.0))  # Merritt, section 5-6: the jet of a sharp orifice, from the spool's axis


class Flows(eqx.Module):
    """Mass [kg/s] and heat that flows bring to both chambers, and the flow force per its coefficient.

    net: mass in less mass out. warming: sum over the inflows of mass times how much warmer they arrive [kg K/s], None where
    no heat is computed. supply, return_: through the edges from the supply, to the return. force: F of MODEL section 7 [N].
    """

    net: Float[Array, "2"]
    warming: Float[Array, "2"] | None
    supply: Float[Array, "2"]
    return_: Float[Array, "2"]
    force: Float[Array, ""] | None


class _Edges(eqx.Module):
    """The edges at a spool position, and the oil on either side of them."""

    supply: OpenEdge
    return_: OpenEdge
    fresh: OilAtTemperature
    inside: OilAtTemperature | None  # None: as fresh


def _either(forward: Bool[Array, "2"], one: OilAtTemperature, other: OilAtTemperature | None) -> OilAtTemperature:
    return one if other is None else jax.tree.map(lambda a, b: jnp.where(forward, a, b), one, other)


def _from_supply(edges: _Edges, pressure: Float[Array, "2"], supply: Float[Array, ""]) -> Float[Array, "2"]:
    drop = supply - pressure
    oil = _either(drop >= 0.0, edges.fresh, edges.inside)
    return mass_flow(edges.supply, oil, drop, 0.5 * (supply + pressure))


def _to_return(edges: _Edges, pressure: Float[Array, "2"], back: Float[Array, ""]) -> Float[Array, "2"]:
    drop = pressure - back
    oil = _either(drop < 0.0, edges.fresh, edges.inside)
    return mass_flow(edges.return_, oil, drop, 0.5 * (pressure + back))


def _behind_lines(
    plant: Plant, edges: _Edges, state: State, around: Surroundings
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """(P_s, P_t) at the edges, behind what passages and lines lose; at rest in every instant (oil without inertia)."""
    ps, pt, ts = around.supply_pressure, around.return_pressure, around.temperature
    lines, oil = plant.coupling.lines, plant.oil
    if not lines:
        return ps, pt
    span = ps - pt
    entering, leaving = density(oil, ps, ts), density(oil, pt, ts)

    def imbalance(share: Float[Array, "2"]) -> Float[Array, "2"]:
        """Falls in each of both: what the flow loses less what was assumed, as shares of P_s - P_t."""
        at_supply, at_return = ps - share[0] * span, pt + share[1] * span
        out = _to_return(edges, state.pressure, at_return)
        left = leaving
        if plant.keeps_heat:
            assert state.temperature is not None
            drop = state.pressure - at_return
            warm = state.temperature + throttling_rise(oil, drop, at_return + 0.5 * drop, state.temperature)
            weight = jnp.maximum(out, 0.0) + 1e-30
            left = density(oil, pt, jnp.sum(weight * warm) / jnp.sum(weight))
        supply_flow = jnp.sum(_from_supply(edges, state.pressure, at_supply)) / entering
        losses = [line.losses(supply_flow, jnp.sum(out) / left) for line in lines]
        lost, gained = (sum(parts, start=jnp.zeros(())) for parts in zip(*losses, strict=True))
        return jnp.stack([lost, gained]) / span - share

    share = falling_root(imbalance, jnp.zeros(2))
    return ps - share[0] * span, pt + share[1] * span


def flows_at(plant: Plant, supplied: Supplied, around: Surroundings, state: State) -> Flows:
    """All flows at a state. The spool's position is counted from the centre of its stroke, edges see it less null bias."""
    oil, p, ts = plant.oil, state.pressure, around.temperature
    shift = MIRROR * (state.spool - plant.valve.null_bias)
    own = supplied.edges
    inside = None if state.temperature is None else at_temperature(oil, state.temperature)
    edges = _Edges(
        at_opening(own.supply, own.supply.underlap + shift),
        at_opening(own.return_, own.return_.underlap - shift),
        supplied.oil,
        inside,
    )
    ps, pt = _behind_lines(plant, edges, state, around)
    enter, leave = _from_supply(edges, p, ps), _to_return(edges, p, pt)

    # From the other chamber, past the piston and past the spool.
    fall = p[::-1] - p
    mean = 0.5 * (p[0] + p[1])
    conductance = plant.motion.jack_leakage
    if supplied.crossing is not None:
        conductance = conductance + supplied.crossing
    # Both chambers must see the same oil cross, so that none is lost.
    sent = density_at(supplied.oil, mean)
    if inside is not None:
        sent = jnp.where(fall[1] > 0.0, *(density_at(jax.tree.map(lambda a, i=i: _pick(a, i), inside), mean) for i in (0, 1)))
    across = sent * conductance * fall

    warming = None
    if state.temperature is not None:
        t = state.temperature
        other = t[::-1]
        brought = lambda mass, drop, at, origin: jnp.maximum(mass, 0.0) * (
            origin + throttling_rise(oil, drop, at, origin) - t
        )
        warming = brought(enter, ps - p, 0.5 * (ps + p), jnp.broadcast_to(ts, (2,)))
        warming = warming + brought(-leave, pt - p, 0.5 * (pt + p), jnp.broadcast_to(ts, (2,)))
        warming = warming + brought(across, fall, jnp.broadcast_to(mean, (2,)), other)

    force = None
    if plant.motion.flow_force is not None:
        force = JET_ANGLE * jnp.sum(MIRROR * (_jet(edges, enter, p, ps, True) - _jet(edges, leave, p, pt, False)))
    return Flows(enter - leave + across, warming, enter, leave, force)


def _pick(value: Float[Array, "..."], i: int) -> Float[Array, "..."]:
    return value[i] if value.ndim else value


def _jet(
    edges: _Edges, mass: Float[Array, "2"], pressure: Float[Array, "2"], outside: Float[Array, ""], supply: bool
) -> Float[Array, "2"]:
    """|Q| sqrt(2 rho |dp|) of each orifice [N]: momentum of its jet; oil over the lands between the slots makes none."""
    drop = jnp.abs(outside - pressure)
    forward = (outside - pressure >= 0.0) == supply
    mean = 0.5 * (outside + pressure)
    at = edges.supply if supply else edges.return_
    oil = _either(forward, edges.fresh, edges.inside) if supply else _either(~forward, edges.fresh, edges.inside)
    if at.edge.land_leakage is not None:
        bare = eqx.tree_at(lambda e: e.land_leakage, at.edge, None)
        mass = mass_flow(at_opening(bare, at.opening), oil, drop, mean)
    rho = density_at(oil, mean)
    # sqrt has no slope at zero; the product's is zero there, as the flow falls with the drop.
    flows = drop > 0.0
    speed = jnp.where(flows, jnp.sqrt(2.0 * rho * jnp.where(flows, drop, 1.0)), 0.0)
    return jnp.abs(mass) / rho * speed
