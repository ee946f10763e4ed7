"""Play between the command and the spool."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class Backlash(AbstractMotionEffect):
    """Play of width b on the spool's command: y' = (x_c - y - w)/tau_p, w = clip(x_c - y, +-b/2), passes x_c - w on.

    Source: feedback wire, ball and linkage of a mechanical-feedback stage; the play operator (Krasnoselskii, Pokrovskii 1983),
    relaxed over tau_p = 0.1 ms. Amount b >= 0 [m] of spool travel, typical 0.5 to 10 um. Shows as a loop that hunts: a limit
    cycle about the setpoint, and a dead zone where the command turns. It has no small-signal response.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("backlash", self.amount)
