"""Oil that passes the piston."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class JackLeakage(AbstractMotionEffect):
    """Past the piston, from A to B: Q = a (p_A - p_B), mass at the mean pressure and upstream temperature; adds to the record's.

    Source: laminar gap of the seal (Merritt, section 6-1). At one temperature it cannot be told from `cross_port_leakage`.
    Amount a >= 0 [m3/(s Pa)], typical 1e-14 to 1e-11. Shows as damping of the resonance, and as an error under load.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("jack_leakage", self.amount)
