"""Forces on the piston beside the pressures': friction and end stops (MODEL section 7)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .motion import Motion


SLIDING_SPEED = 1e-3  # m/s, v_ref: above it dry friction is fully there
STRIBECK_SPEED = 10e-3  # m/s, v_s
STOP_STIFFNESS = 1e8  # N/m
STOP_DAMPING = 1e5  # N s/m


def dry_friction(motion: Motion, velocity: Float[Array, ""]) -> Float[Array, ""]:
    """F_c tanh(v/v_ref) + (F_s - F_c) exp(-(v/v_s)^2) tanh(v/v_ref) [N], against the motion."""
    sliding = jnp.tanh(velocity / SLIDING_SPEED)
    force = motion.coulomb_friction * sliding
    if motion.stribeck_friction is not None:
        force = force + motion.stribeck_friction * jnp.exp(-jnp.square(velocity / STRIBECK_SPEED)) * sliding
    return force


def end_stops(stroke: Float[Array, ""], position: Float[Array, ""], velocity: Float[Array, ""]) -> Float[Array, ""]:
    """Force of the stops at +-stroke/2 [N], against z: a spring and a damper that push while pushed in and never pull."""
    high, low = position - 0.5 * stroke, -0.5 * stroke - position
    push = jnp.where(high > 0.0, jnp.maximum(STOP_STIFFNESS * high + STOP_DAMPING * velocity, 0.0), 0.0)
    return push - jnp.where(low > 0.0, jnp.maximum(STOP_STIFFNESS * low - STOP_DAMPING * velocity, 0.0), 0.0)
