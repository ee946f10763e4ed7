"""Dry friction of the piston's seals and of its load: while it slides, and more where it nearly sticks."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..dynamics.motion import AbstractMotionEffect, Motion
from ..effect import as_amount


@final
class CoulombFriction(AbstractMotionEffect):
    """Dry friction F_c tanh(v/v_ref) against the piston's motion, v_ref = 1 mm/s; adds to the record's own.

    Source: Coulomb friction, smoothed about rest (Merritt, section 6-7; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica
    30, 1994). Amount F_c >= 0 [N], typical 20 to 1000. Shows in the pressures, which step by 2 F_c/S where the piston turns, and
    in a piston that stays where it was.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("coulomb_friction", self.amount)


@final
class StribeckFriction(AbstractMotionEffect):
    """More friction near rest: (F_s - F_c) exp(-(v/v_s)^2) tanh(v/v_ref), v_s = 10 mm/s, v_ref = 1 mm/s.

    Source: Stribeck (1902); the exponential form of Bo and Pavelescu, Wear 82 (1982).
    Amount F_s - F_c >= 0 [N], typical 20 to 1000. Shows as stick-slip: pressure peaks where the piston breaks away.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("stribeck_friction", self.amount)
