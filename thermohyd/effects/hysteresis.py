"""A position reading that depends on the way it was reached, or on how fast."""

from typing import ClassVar, final

import equinox as eqx
import jax
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions, sweep_direction

from .effect import AbstractConditionEffect, as_amount


@final
class Hysteresis(AbstractConditionEffect):
    """True x = read x - (H/2) sign(dx/dt): a loop of constant width H, after the scale of the position.

    Source: play or friction between spool and transducer, magnetic hysteresis where x is a command (ISO 10770-1).
    The direction is that of the conditions, or that of the positions where they have none.
    Amount H >= 0 [m], typical 0.2 to 5 um. Shows as a loop, whatever the rate of the sweep; in the pressure gain first.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 10

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        direction = read.direction
        if direction is None:
            # From the positions as read: a repeated one would not stay exactly repeated through a scale.
            direction = jax.lax.stop_gradient(sweep_direction(read.position, read.run))
        return eqx.tree_at(lambda c: c.position, so_far, so_far.position - 0.5 * self.amount * direction)


@final
class PositionLag(AbstractConditionEffect):
    """True x = read x - tau dx/dt: the spool (or what it does to the readings) comes a time tau behind the position read.

    Source: first order in tau of a pure delay or of a first-order element (filters and sampling of the bench, a command
    taken for the position); Ljung, System Identification, 2nd ed., section 4.2. The rate is that of the position as read.
    Amount tau >= 0 [s], typical 0.05 to 2. Shows as a loop whose width grows with the rate of the sweep. At a single rate
    it cannot be told from hysteresis of width H = 2 tau |dx/dt|: only sweeps of several rates separate the two.
    Raises ValueError where the conditions have no rate.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 10

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        if read.rate is None:
            raise ValueError("position_lag needs conditions with the rate of every row")
        return eqx.tree_at(lambda c: c.position, so_far, so_far.position - self.amount * read.rate)
