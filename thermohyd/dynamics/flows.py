"""Flows into and out of the chambers at any pressures, and how fast they change the chambers (docs/physics.md sections 9.2 and 9.3).

Arrays have the ports A, B along their last axis, and along the one before it the edges from the supply and to the return.
The edge law is that of the static tests; here a drop may have either sign, and the oil is that of the side which the flow
leaves. What comes back from the return is at T_s. Mass and energy of each chamber then give its pressure's and its temperature's
rate of change.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.edge import OpenEdge, at_opening, mass_flow
from thermohyd.flow_balance import falling_root
from thermohyd.oil import (
    CompressedOil,
    OilAtTemperature,
    at_temperature,
    compressed,
    density,
    density_at,
    specific_heat,
    throttling_rise,
)

from .circuit import NOTHING, Added
from .machine import Plant, State, Supplied, Surroundings


# P-A and B-T open with +x, P-B and A-T with -x.
OPENS_WITH_X = np.array([[1.0, -1.0], [-1.0, 1.0]])
JET_ANGLE = math.cos(math.radians(69.0))  # the jet of a sharp orifice, from the spool's axis (Merritt, section 5-6)


class Flows(eqx.Module):
    """Mass [kg/s] and heat that flows bring to both chambers, and the flow force per its coefficient.

    through: of the edges, from the supply and to the return. net: into the chambers, flow past the piston and the spool
    included. warming: sum over the inflows of mass times how much warmer they arrive [kg K/s], None where no heat is
    computed. inflow: mass that enters, all inflows. force: F of docs/physics.md section 9.1 [N], None where nothing feels it.
    """

    through: Float[Array, "2 2"]
    net: Float[Array, "2"]
    warming: Float[Array, "2"] | None
    inflow: Float[Array, "2"]
    force: Float[Array, ""] | None


class _Drops(eqx.Module):
    """Pressure drops [Pa] along supply -> chamber -> return and the means of both pressures."""

    drop: Float[Array, "2 2"]
    mean: Float[Array, "2 2"]


def _drops(pressure: Float[Array, "2"], supply: Float[Array, ""], back: Float[Array, ""]) -> _Drops:
    return _Drops(
        drop=jnp.stack([supply - pressure, pressure - back]),
        mean=jnp.stack([0.5 * (supply + pressure), 0.5 * (pressure + back)]),
    )


def _upstream(drops: _Drops, fresh: OilAtTemperature, inside: OilAtTemperature | None) -> OilAtTemperature:
    """The oil that each edge passes on: from outside the chamber, or from inside it."""
    if inside is None:
        return fresh
    from_outside: Bool[Array, "2 2"] = (drops.drop >= 0.0) == np.array([[True], [False]])
    return jax.tree.map(lambda outside, within: jnp.where(from_outside, outside, within), fresh, inside)


def _behind_lines(
    plant: Plant,
    opened: OpenEdge,
    fresh: OilAtTemperature,
    inside: OilAtTemperature | None,
    state: State,
    around: Surroundings,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """(P_s, P_t) at the edges, behind what passages and lines lose; at rest in every instant (oil without inertia)."""
    ps, pt = around.supply_pressure, around.return_pressure
    lines, oil = plant.coupling.lines, plant.oil
    if not lines:
        return ps, pt
    span = ps - pt
    entering, leaving = density(oil, ps, around.temperature), density(oil, pt, around.temperature)

    def imbalance(share: Float[Array, "2"]) -> Float[Array, "2"]:
        """Falls in each of both: what the flow loses less what was assumed, as shares of P_s - P_t."""
        drops = _drops(state.pressure, ps - share[0] * span, pt + share[1] * span)
        flow = mass_flow(opened, _upstream(drops, fresh, inside), drops.drop, drops.mean)
        left = leaving
        if state.temperature is not None:
            warm = state.temperature + throttling_rise(oil, drops.drop[1], drops.mean[1], state.temperature)
            weight = jnp.maximum(flow[1], 0.0) + 1e-30  # with all of it coming back, its temperature matters to nobody
            left = density(oil, pt, jnp.sum(weight * warm) / jnp.sum(weight))
        supply_flow, return_flow = jnp.sum(flow[0]) / entering, jnp.sum(flow[1]) / left
        losses = [line.losses(supply_flow, return_flow) for line in lines]
        lost, gained = (sum(parts, start=jnp.zeros(())) for parts in zip(*losses, strict=True))
        return jnp.stack([lost, gained]) / span - share

    share = falling_root(imbalance, jnp.zeros(2))
    return ps - share[0] * span, pt + share[1] * span


def openings(supplied: Supplied, state: State, more: Added) -> Float[Array, "2 2"]:
    """Of the edges [m]; the spool's position is counted from the middle of its stroke, edges see it less null bias."""
    seen = state.spool - supplied.null_bias
    return supplied.edges.underlap + OPENS_WITH_X * (seen if more.opening is None else seen + more.opening)


def flows_at(plant: Plant, supplied: Supplied, around: Surroundings, state: State, more: Added = NOTHING) -> Flows:
    """All flows at a state; more: what effects add there."""
    oil, p = plant.oil, state.pressure
    inside = None if state.temperature is None else more.thickened(at_temperature(oil, state.temperature))
    fresh = more.thickened(supplied.oil)
    opened = at_opening(supplied.edges, openings(supplied, state, more))
    ps, pt = _behind_lines(plant, opened, fresh, inside, state, around)
    drops = _drops(p, ps, pt)
    upstream = _upstream(drops, fresh, inside)
    through = mass_flow(opened, upstream, drops.drop, drops.mean)

    # From the other chamber, past the piston and past the spool; both chambers see the same oil, so that none is lost.
    fall, mean = p[::-1] - p, jnp.mean(p)
    conductance = plant.motion.jack_leakage
    if supplied.crossing is not None:
        conductance = conductance + supplied.crossing
    sent = density_at(fresh, mean)
    if state.temperature is not None:
        sent = density(oil, mean, jnp.where(p[0] > p[1], state.temperature[0], state.temperature[1]))
    across = sent * conductance * fall

    warming = None
    inflow = jnp.maximum(jnp.stack([through[0], -through[1], across]), 0.0)
    if state.temperature is not None:
        t = state.temperature
        outside = jnp.broadcast_to(around.temperature, (2,))
        origin = jnp.stack([outside, outside, t[::-1]])
        drop = jnp.stack([drops.drop[0], -drops.drop[1], fall])
        middle = jnp.stack([*drops.mean, jnp.broadcast_to(mean, (2,))])
        warming = jnp.sum(inflow * (origin + throttling_rise(oil, drop, middle, origin) - t), axis=0)

    force = None
    if plant.motion.flow_force is not None:
        force = JET_ANGLE * jnp.sum(OPENS_WITH_X * _jets(opened, upstream, drops, through))
    return Flows(through, through[0] - through[1] + across, warming, jnp.sum(inflow, axis=0), force)


def _jets(opened: OpenEdge, oil: OilAtTemperature, drops: _Drops, through: Float[Array, "2 2"]) -> Float[Array, "2 2"]:
    """|Q| sqrt(2 rho |dp|) of each orifice [N], the momentum of its jet; oil over the lands between the slots makes none."""
    if opened.edge.land_leakage is not None:
        bare = eqx.tree_at(lambda e: e.land_leakage, opened.edge, None)
        through = mass_flow(at_opening(bare, opened.opening), oil, drops.drop, drops.mean)
    rho, size = density_at(oil, drops.mean), jnp.abs(drops.drop)
    # The root has no slope at zero; the product's is zero there, as the flow falls with the drop.
    flows = size > 0.0
    speed = jnp.where(flows, jnp.sqrt(2.0 * rho * jnp.where(flows, size, 1.0)), 0.0)
    return jnp.abs(through) / rho * speed


ATMOSPHERE = 1.013e5  # Pa absolute, at gauge zero
POLYTROPIC = 1.4
# Air is an ideal gas and has no pressure below zero; no state that the model is for comes near [Pa, absolute].
THINNEST_AIR = 1e3
SIDES = np.array([1.0, -1.0])  # a piston moving with +z makes room in A


def mixture_modulus(
    beta: Float[Array, "..."], share: Float[Array, "..."], pressure: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Bulk modulus [Pa] of oil with a share phi of its volume, at atmospheric pressure, as air bubbles; pressure gauge.

    1/beta_eff = [(1 - phi)/beta + g/(n P)]/(1 - phi + g), g = phi (p_a/P)^(1/n), polytropic, n = 1.4 (docs/physics.md section 9.3;
    the mixture model of Merritt, section 2-4, with the air's compression followed).
    """
    absolute = _absolute(pressure)
    air = share * jnp.power(ATMOSPHERE / absolute, 1.0 / POLYTROPIC)
    return (1.0 - share + air) / ((1.0 - share) / beta + air / (POLYTROPIC * absolute))


def softness_of_gas(pressure: Float[Array, "..."]) -> Float[Array, "..."]:
    """Compliance of a fixed amount of gas over that at gauge zero, (p_a/P)^(1 + 1/n), as in `mixture_modulus`; pressure gauge."""
    return jnp.power(ATMOSPHERE / _absolute(pressure), 1.0 + 1.0 / POLYTROPIC)


def _absolute(pressure: Float[Array, "..."]) -> Float[Array, "..."]:
    """Of air [Pa], at a gauge pressure."""
    return jnp.maximum(pressure + ATMOSPHERE, THINNEST_AIR)


def chamber_volumes(plant: Plant, position: Float[Array, "..."]) -> Float[Array, "... 2"]:
    """V_ta + S_a z and V_tb - S_b z [m3]."""
    j = plant.actuator
    return j.volumes + j.areas * SIDES * position[..., None]


class Sources(eqx.Module):
    """What changes the chambers' state; all of it is zero in a steady state, where the pressures and temperatures rest.

    squeeze: relative surplus of oil over room [1/s]; heating: of the oil at constant pressure [K/s], renewal: how fast inflow
    and walls bring that about [1/s], both None where the oil stays at T_s. oil: what is in the chambers; temperature [K].
    per_rate: more of the squeeze per dp/dt [1/Pa], None where nothing stores oil beside the chambers.
    """

    squeeze: Float[Array, "2"]
    heating: Float[Array, "2"] | None
    renewal: Float[Array, "2"] | None
    oil: CompressedOil
    temperature: Float[Array, "2"]
    per_rate: Float[Array, "2"] | None = None


def chamber_sources(plant: Plant, around: Surroundings, state: State, flows: Flows, more: Added = NOTHING) -> Sources:
    """Oil and heat that flows, walls, the piston's motion and what effects add (`more`) bring."""
    oil, p = plant.oil, state.pressure
    t = jnp.broadcast_to(around.temperature, (2,)) if state.temperature is None else state.temperature
    volume = chamber_volumes(plant, state.position)
    inside = compressed(oil, p, t)
    rho = inside.density
    growth = plant.actuator.areas * SIDES * state.velocity
    squeeze = (flows.net / rho - growth) / volume
    if more.inflow is not None:
        squeeze = squeeze + more.inflow / volume
    per_rate = None if more.inflow_per_rate is None else more.inflow_per_rate / volume
    if state.temperature is None:
        return Sources(squeeze, None, None, inside, t, per_rate)
    assert flows.warming is not None
    mass = rho * volume
    heating, renewal = flows.warming / mass, flows.inflow / mass
    passed = plant.walls.into_oil(t, state.wall, around.temperature)
    if passed is not None:
        assert plant.walls.conductance is not None
        capacity = mass * specific_heat(oil, t)
        heating, renewal = heating + passed / capacity, renewal + plant.walls.conductance / capacity
    if more.heat is not None:
        heating = heating + more.heat / (mass * specific_heat(oil, t))
    return Sources(squeeze, heating, renewal, inside, t, per_rate)


def chamber_rates(plant: Plant, state: State, sources: Sources) -> tuple[Float[Array, "2"], Float[Array, "2"] | None]:
    """Rates of the chambers: (dp/dt [Pa/s], dT/dt [K/s] or None where the oil stays at T_s)."""
    oil, p, t = plant.oil, state.pressure, sources.temperature
    inside = sources.oil
    beta = inside.bulk_modulus * plant.actuator.bulk_modulus_factor
    if plant.motion.entrained_air is not None:
        beta = mixture_modulus(beta, plant.motion.entrained_air, p)
    # What is stored beside the chamber, per dp/dt, stands on the left of the equation.
    own = 1.0 if sources.per_rate is None else 1.0 - beta * sources.per_rate
    if sources.heating is None:
        return beta * sources.squeeze / own, None
    # dp = beta (squeeze + alpha dT) and dT = heating + k dp are two linear equations.
    alpha = inside.expansion
    k = alpha * t / (inside.density * specific_heat(oil, t))
    dp = beta * (sources.squeeze + alpha * sources.heating) / (own - beta * alpha * k)
    return dp, sources.heating + k * dp
