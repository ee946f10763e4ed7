"""A valve whose places are shifted at all rows alike, and its twin of the independent simulator: blocked or joined ports about null."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from reference.oil import Oil as ReferenceOil
from reference.valve import Effects, Plant, Valve as ReferenceValve

from helpers.valves import STROKE
from thermohyd.conditions import Conditions
from thermohyd.edge import EdgeLaw
from thermohyd.effects.row_shifts import SHIFTS, RowShifts
from thermohyd.oil import oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.valve import Valve


POINTS = OilDefinition(9.0, 3.6)
X = np.linspace(-60e-6, 60e-6, 25)
TRUTH = {
    "edge_radius": 8e-6, "clearance": 2.5e-6, "underlap": 6e-6, "discharge_coefficient": 0.68, "transition_number": 90.0,
    "null_bias": 0.0,
}  # fmt: skip


def shifted_valve(law: EdgeLaw = "orifice", **shifts: float) -> tuple[Valve, Conditions]:
    """shifts: of `SHIFTS`, SI."""
    rows = len(X)
    moved = jnp.stack([jnp.full(rows, shifts.get(name, 0.0)) for name in SHIFTS])
    valve = Valve(oil=oil_from_definition(POINTS), stroke=STROKE, slot_width=12e-3, edge_law=law, **TRUTH)
    at = Conditions(
        position=jnp.asarray(X), supply_pressure=jnp.full(rows, 210e5), return_pressure=jnp.zeros(rows),
        temperature=jnp.full(rows, 313.15),
    )  # fmt: skip
    return replace(valve, effects=(RowShifts(moved),)), at


def plant_of[P: Plant](kind: type[P], law: EdgeLaw = "orifice", **more: Any) -> P:
    """The same valve, nothing shifted, of a class that does to its edges what the test asks."""
    ones = np.ones(len(X))
    valve = ReferenceValve(slot_width=12e-3, **TRUTH, edge_law=law)
    oil = ReferenceOil(POINTS.viscosity_a, POINTS.viscosity_b)
    return kind(valve, Effects(), oil, X, 210e5 * ones, 0.0 * ones, 313.15 * ones, **more)
