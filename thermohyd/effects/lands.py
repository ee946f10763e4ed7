"""Flow over lands that the concentric, slotted ideal does not have: an eccentric spool, lands between the slots."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..conditions import Conditions
from ..edge import MeteringEdge
from ..effect import AbstractEdgeEffect, Edges, as_amount


def on_both(ideal: Edges, field: str, value) -> Edges:
    """Both pairs of edges with one of their fields replaced by value(its present content)."""

    def changed(edge: MeteringEdge) -> MeteringEdge:
        return eqx.tree_at(
            lambda e: getattr(e, field), edge, value(getattr(edge, field)), is_leaf=lambda leaf: leaf is None
        )

    return Edges(supply=changed(ideal.supply), return_=changed(ideal.return_))


@final
class Eccentricity(AbstractEdgeEffect):
    """Flow of an overlapped land times 1 + 1.5 e^2 (laminar flow in an eccentric annulus).

    Source: Piercy, Hooper, Winny, Phil. Mag. 15 (1933); Merritt, Hydraulic Control Systems, eq. 3-39.
    Amount 0 <= e <= 1 (1: the spool lies on its sleeve), typical 0.3 to 1. Even in e: the derivative at neutral is zero,
    so look at it in finite steps. Shows in the leakage away from null and in the pressure gain of overlapped edges.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        factor = 1.0 + 1.5 * jnp.square(self.amount)
        return on_both(ideal, "land_factor", lambda own: factor if own is None else own * factor)


@final
class LandLeakage(AbstractEdgeEffect):
    """Parallel to every edge, over the lands between its slots: G = k c^3/(12 mu), k = (pi d - w)/L_land.

    Source: Poiseuille flow between parallel plates (Merritt, section 3-4); c is the clearance with its own effects.
    Amount k >= 0 [-], typical 1 to 30. Shows in the leakage at all positions, laminar: it grows with temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return on_both(ideal, "land_leakage", lambda own: self.amount if own is None else own + self.amount)
