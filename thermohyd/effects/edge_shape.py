"""Edges that are not as drawn: worn supply or return edges, return edges cut at another lap."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..conditions import Conditions
from ..effect import AbstractEdgeEffect, Edges, as_amount


@final
class SupplyEdgeWear(AbstractEdgeEffect):
    """Radius of the edges P-A and P-B: r + d.

    Source: erosion by particles, fastest where the drop is largest (Vaughan, Pomeroy, Tilley, Wear 216, 1998).
    Amount d >= 0 [m], typical 1 to 20 um. Shows in the leakage peak and raises the null pressure (p_A + p_B)/2.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.supply.radius, ideal, ideal.supply.radius + self.amount)


@final
class ReturnEdgeWear(AbstractEdgeEffect):
    """Radius of the edges A-T and B-T: r + d.

    Source: as for the supply edges; cavitating return flow does it too.
    Amount d >= 0 [m], typical 1 to 20 um. Shows in the leakage peak and lowers the null pressure (p_A + p_B)/2.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.return_.radius, ideal, ideal.return_.radius + self.amount)


@final
class UnequalUnderlap(AbstractEdgeEffect):
    """Underlap of the edges A-T and B-T: U + d.

    Source: the grinding tolerance of the spool's lands (null cut).
    Amount d [m], either sign, typical 1 to 10 um. Shows in the leakage peak and the null pressure (p_A + p_B)/2.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.return_.underlap, ideal, ideal.return_.underlap + self.amount)
