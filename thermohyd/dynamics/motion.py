"""What only shows in motion: the physics that a dynamic effect may add to an actuator, and how such an effect joins.

The fields of `Motion` start at the record's own values, or None where a record has none; an effect adds to one of them.
Which are None is known while tracing, so that absent physics is not even compiled.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..actuator import Actuator
from ..effect import AbstractEffect


class Motion(eqx.Module):
    """Optional physics of the actuator, SI units.

    coulomb_friction F_c [N]; stribeck_friction F_s - F_c [N]; jack_leakage a [m3/(s Pa)]; backlash b [m] of spool command;
    entrained_air phi [-]; flow_force k [m/N] of spool command; spool_delay tau [s]; wall_heat h_w A_w [W/K] per chamber.
    """

    coulomb_friction: Float[Array, "..."]
    jack_leakage: Float[Array, "..."]
    stribeck_friction: Float[Array, "..."] | None = None
    backlash: Float[Array, "..."] | None = None
    entrained_air: Float[Array, "..."] | None = None
    flow_force: Float[Array, "..."] | None = None
    spool_delay: Float[Array, "..."] | None = None
    wall_heat: Float[Array, "..."] | None = None

    def plus(self, field: str, amount: Float[Array, "..."]) -> "Motion":
        """The same with an amount added to a field."""
        own = getattr(self, field)
        total = amount if own is None else own + amount
        return eqx.tree_at(lambda m: getattr(m, field), self, total, is_leaf=lambda leaf: leaf is None)


class AbstractMotionEffect(AbstractEffect):
    """An effect that only an actuator in motion shows; static tests pass it by."""

    @abc.abstractmethod
    def motion(self, so_far: Motion) -> Motion:
        """The motion's physics with one more effect."""


def motion_of(actuator: Actuator, effects: tuple[AbstractEffect, ...]) -> Motion:
    """The actuator's own physics and that of its dynamic effects."""
    motion = Motion(
        coulomb_friction=jnp.asarray(actuator.coulomb_friction), jack_leakage=jnp.asarray(actuator.jack_leakage)
    )
    for effect in effects:
        if isinstance(effect, AbstractMotionEffect):
            motion = effect.motion(motion)
    return motion
