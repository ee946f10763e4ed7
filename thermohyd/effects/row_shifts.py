"""Shifts of a model's places, row by row: what flows into a port, an edge's size, the oil's viscosity, the return's pressure.

No cause and no entry of the library: the hand by which a term of a model (`place` times a function of a variable) moves it, and
by which a fit asks what each place would do to each reading. All at 0 changes nothing.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.edge import MeteringEdge
from thermohyd.oil import Oil

from .edges import SMALLEST_CLEARANCE
from .effect import (
    AbstractConditionEffect,
    AbstractEdgeEffect,
    AbstractInflowEffect,
    AbstractOilEffect,
    Edges,
    as_amount,
)


# Edges in the order of their entries: two of the supply, two of the return.
EDGES = ("pa", "pb", "at", "bt")
_LENGTHS = ("edge_radius", "clearance", "underlap")
# What can be shifted: Pa, a share, m3/s, m; `edge_flow` a share of what the slots of an edge let through. Viscosity of all the oil,
# and of what passes one edge. A flow into a port may
# follow the port's own pressure, which `..._per_pressure` [m3/(s Pa)] says: held at what the pressure was, a flow that
# drains a blocked port would overshoot.
SHIFTS = (
    "return_pressure", "viscosity", "flow_into_a", "flow_into_b", "flow_into_a_per_pressure", "flow_into_b_per_pressure",
    *(f"{quantity}_{edge}" for quantity in (*_LENGTHS, "edge_flow", "viscosity") for edge in EDGES),
)  # fmt: skip


@final
class RowShifts(AbstractConditionEffect, AbstractOilEffect, AbstractEdgeEffect, AbstractInflowEffect):
    """Shifts (entries, rows) in the order of `SHIFTS`, SI; added, but shares, which multiply by 1 + share."""

    amount: Float[Array, "entries rows"] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 100

    def of(self, name: str) -> Float[Array, " rows"]:
        return self.amount[SHIFTS.index(name)]

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        return eqx.tree_at(lambda c: c.return_pressure, so_far, so_far.return_pressure + self.of("return_pressure"))

    def oil(self, nominal: Oil) -> Oil:
        factor = 1.0 + self.of("viscosity")
        own = nominal.viscosity_factor
        total = factor if own is None else own * factor
        return eqx.tree_at(lambda o: o.viscosity_factor, nominal, total, is_leaf=lambda leaf: leaf is None)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        pairs = zip((ideal.supply, ideal.return_), (EDGES[:2], EDGES[2:]), strict=True)
        supply, return_ = (self._shifted(edge, names) for edge, names in pairs)
        return Edges(supply=supply, return_=return_)

    def _shifted(self, edge: MeteringEdge, names: tuple[str, ...]) -> MeteringEdge:
        by = lambda quantity: jnp.stack([self.of(f"{quantity}_{name}") for name in names])
        thicker = 1.0 + by("viscosity")
        return eqx.tree_at(
            lambda e: (e.radius, e.clearance, e.underlap, e.slot_width, e.viscosity_factor),
            edge,
            (
                jnp.maximum(edge.radius + by("edge_radius"), 0.0),
                jnp.maximum(edge.clearance + by("clearance"), SMALLEST_CLEARANCE),
                edge.underlap + by("underlap"),
                edge.slot_width * (1.0 + by("edge_flow")),
                thicker if edge.viscosity_factor is None else edge.viscosity_factor * thicker,
            ),
            is_leaf=lambda leaf: leaf is None,
        )

    def inflow(self, pressure: Float[Array, "2 rows"], oil: Oil, conditions: Conditions) -> Float[Array, "2 #rows"]:
        constant, slope = (
            jnp.stack([self.of(f"flow_into_{port}{end}") for port in "ab"]) for end in ("", "_per_pressure")
        )
        return constant + slope * pressure
