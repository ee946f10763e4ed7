"""From the command to the spool: controller, clip, play, flow force, and the spool's own second order (MODEL section 7)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .flows import Flows
from .plant import Plant


PLAY_TIME = 1e-4  # s, tau_p: how fast the play follows


def loop_gain(plant: Plant) -> Float[Array, ""]:
    """Spool command per position error X_n K_A K_p/I_rated [-]."""
    j = plant.actuator
    return plant.valve.stroke * j.amplifier_gain * j.sensor_gain / j.rated_current


def wanted_position(plant: Plant, command: Float[Array, ""], position: Float[Array, ""]) -> Float[Array, ""]:
    """The spool position [m] that the controller or the command asks for, however far."""
    if plant.kind == "setpoint":
        return loop_gain(plant) * (command - position)
    if plant.kind == "current":
        return plant.polarity * plant.valve.stroke * command / plant.actuator.rated_current
    return command


def asked_position(plant: Plant, command: Float[Array, ""], position: Float[Array, ""]) -> Float[Array, ""]:
    """The same before the chain: x_c clipped to +-X_n."""
    return jnp.clip(wanted_position(plant, command, position), -plant.valve.stroke, plant.valve.stroke)


def through_play(
    plant: Plant, asked: Float[Array, ""], play: Float[Array, ""] | None
) -> tuple[Float[Array, ""], Float[Array, ""] | None]:
    """(what a play of width b passes on [m], dy/dt of its state [m/s])."""
    width = plant.motion.backlash
    if width is None or play is None:
        return asked, None
    ahead = asked - play
    within = jnp.clip(ahead, -0.5 * width, 0.5 * width)
    return asked - within, (ahead - within) / PLAY_TIME


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
