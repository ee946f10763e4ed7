"""The jets' force on the spool."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class FlowForce(AbstractMotionEffect):
    """Jets close the spool against a stage of finite stiffness: x_c - k F, F = cos 69 deg sum of +-|Q| sqrt(2 rho |dp|).

    Plus for the edges that open with +x. Source: steady flow force of sharp orifices (Merritt, section 5-6); leakage over the
    lands between the slots makes no jet. Amount k >= 0 [m/N], typical 1e-8 to 2e-6. Shows as less flow gain, the more the
    larger the pressure drop.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("flow_force", self.amount)
