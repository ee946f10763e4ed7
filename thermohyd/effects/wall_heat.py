"""Heat from the chambers' oil into the metal around it."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class WallHeat(AbstractMotionEffect):
    """Each chamber exchanges h_w A_w (T_w - T) with its walls, held at the supply's temperature T_w = T_s.

    Source: Newton's law of cooling; between the adiabatic chamber (0) and the isothermal one (large). Without part in an
    isothermal run. Amount h_w A_w >= 0 [W/K], typical 1 to 100. Shows in the pressures: warmer oil is thinner and expands.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("wall_heat", self.amount)
