"""A pure delay of the command."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class SpoolDelay(AbstractMotionEffect):
    """The command acts a time tau later; before its start it was what it was at the start.

    Source: sampling and computing of a digital controller, the first stage's transport. In closed loop the setpoint is delayed,
    not the loop. Amount tau >= 0 [s], typical 0.2 to 10 ms. Shows as a response that begins late, and as a phase -360 deg f tau.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("spool_delay", self.amount)
