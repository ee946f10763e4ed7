"""Air bubbles in the oil of the chambers."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class EntrainedAir(AbstractMotionEffect):
    """Share phi of the volume at atmospheric pressure as bubbles, polytropic n = 1.4; softens the oil where pressure is low.

    Source: Merritt, section 2-4; Manring, Hydraulic Control Systems, section 2.3. The air's mass and heat are neglected.
    Amount phi >= 0 [-], typical 0.002 to 0.05. Shows as a slower, lower resonance; the lower the chamber's pressure, the more.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("entrained_air", self.amount)
