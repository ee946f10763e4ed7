"""The actuator's equations of motion: rates of change of a state at a time (docs/physics.md sections 9.1 and 9.4).

From the command to the spool: controller, clip, play, flow force, the spool's own second order. On the piston, beside the
pressures' force: friction and end stops. Flows and chambers come from `flows`.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .circuit import NOTHING, Added, added_at
from .flows import Flows, Sources, chamber_rates, chamber_sources, flows_at
from .machine import Motion, Plant, State, Surroundings, asked_position


PLAY_TIME = 1e-4  # s, tau_p: how fast the play follows


def through_play(
    plant: Plant, asked: Float[Array, ""], play: Float[Array, ""] | None
) -> tuple[Float[Array, ""], Float[Array, ""] | None]:
    """(what a play of width b passes on [m], dy/dt of its state [m/s]); all of it where the play is a memory alone."""
    width = plant.play_width
    if width is None or play is None:
        return asked, None
    ahead = asked - play
    within = jnp.clip(ahead, -0.5 * width, 0.5 * width)
    passed = asked if plant.motion.backlash is None else asked - within
    return passed, (ahead - within) / PLAY_TIME


def against_flow_force(plant: Plant, passed: Float[Array, ""], flows: Flows) -> Float[Array, ""]:
    """x_c - k F [m]: the jets close the spool against a stage of finite stiffness."""
    if plant.motion.flow_force is None or flows.force is None:
        return passed
    return passed - plant.motion.flow_force * flows.force


def spool_acceleration(
    plant: Plant, target: Float[Array, ""], spool: Float[Array, ""], speed: Float[Array, ""]
) -> Float[Array, ""]:
    """x'' = omega^2 (x_c - x) - 2 xi omega x' [m/s2]."""
    omega = 2.0 * jnp.pi * plant.actuator.spool_frequency
    return jnp.square(omega) * (target - spool) - 2.0 * plant.actuator.spool_damping * omega * speed


SLIDING_SPEED = 1e-3  # m/s, v_ref: above it dry friction is fully there
STRIBECK_SPEED = 10e-3  # m/s, v_s
STOP_STIFFNESS = 1e8  # N/m
STOP_DAMPING = 1e5  # N s/m
STOP_CUSHION = 10e-6  # m, how deep the piston is in a stop when its damper acts fully: a blow has no jump of the force


def dry_friction(motion: Motion, velocity: Float[Array, ""]) -> Float[Array, ""]:
    """F_c tanh(v/v_ref) + (F_s - F_c) exp(-(v/v_s)^2) tanh(v/v_ref) [N], against the motion."""
    sliding = jnp.tanh(velocity / SLIDING_SPEED)
    force = motion.coulomb_friction * sliding
    if motion.stribeck_friction is not None:
        force = force + motion.stribeck_friction * jnp.exp(-jnp.square(velocity / STRIBECK_SPEED)) * sliding
    return force


def end_stops(stroke: Float[Array, ""], position: Float[Array, ""], velocity: Float[Array, ""]) -> Float[Array, ""]:
    """Force of the stops at +-stroke/2 [N], against z: a spring and a damper that push while pushed in and never pull."""
    depth, _ = stop_depths(stroke, position)
    push = jnp.maximum(stop_pushes(depth, velocity), 0.0)
    return push[0] - push[1]


def stop_depths(
    stroke: Float[Array, ""], position: Float[Array, ""]
) -> tuple[Float[Array, " stops"], Float[Array, " stops"]]:
    """(how deep the piston is in the upper and the lower stop, how much deeper than their cushions) [m]; negative outside."""
    depth = jnp.stack([position - 0.5 * stroke, -0.5 * stroke - position])
    return depth, depth - STOP_CUSHION


def stop_pushes(depth: Float[Array, " stops"], velocity: Float[Array, ""]) -> Float[Array, " stops"]:
    """What spring and damper of each stop would do [N], pull included; negative outside."""
    damping = STOP_DAMPING * jnp.clip(depth / STOP_CUSHION, 0.0, 1.0)
    return STOP_STIFFNESS * depth + damping * velocity * jnp.array([1.0, -1.0])


def thrust(plant: Plant, around: Surroundings, state: State, added: Added = NOTHING) -> Float[Array, ""]:
    """Force on the moving mass [N]: S_a p_A - S_b p_B - f v - dry friction - end stops - forces of effects - F_e + what is `added`."""
    j, v = plant.actuator, state.velocity
    force = j.push(state.pressure) - j.viscous_friction * v
    force = force - dry_friction(plant.motion, v) - end_stops(j.piston_stroke, state.position, v)
    for effect in plant.forces:
        force = force - effect.force(v)
    force = force - around.external_force
    return force if added.piston_force is None else force + added.piston_force


class Instant(eqx.Module):
    """What one state under one command leads to. target: where the spool is driven to [m]. added: what effects of the circuit do."""

    flows: Flows
    sources: Sources
    target: Float[Array, ""]
    play_rate: Float[Array, ""] | None
    added: Added


def instant(plant: Plant, state: State, around: Surroundings, command: Float[Array, ""]) -> Instant:
    """Flows, their sources and the command chain at a state."""
    more = added_at(plant, around, state)
    flows = flows_at(plant, plant.at(around), around, state, more)
    asked = asked_position(plant, command, state.position)
    passed, play_rate = through_play(plant, asked, state.play)
    sources = chamber_sources(plant, around, state, flows, more)
    target = against_flow_force(plant, passed, flows)
    target = target if more.spool_target is None else target + more.spool_target
    return Instant(flows, sources, target, play_rate, more)


def rates_at(plant: Plant, state: State, around: Surroundings, command: Float[Array, ""]) -> State:
    """Rates of change, per second, of a state under a command."""
    now = instant(plant, state, around, command)
    dp, dt = chamber_rates(plant, state, now.sources)
    wall = None
    if state.wall is not None:
        assert state.temperature is not None
        wall = plant.walls.rate(state.temperature, state.wall)
    return State(
        spool=state.spool_speed,
        spool_speed=spool_acceleration(plant, now.target, state.spool, state.spool_speed),
        pressure=dp,
        temperature=dt,
        position=state.velocity,
        velocity=thrust(plant, around, state, now.added) / plant.actuator.moving_mass,
        wall=wall,
        play=now.play_rate,
    )


def vector_field(plant: Plant, time: Float[Array, ""], state: State) -> State:
    """Rates of change of the state at a time [s]."""
    return rates_at(plant, state, plant.surroundings(time), plant.command(time))
