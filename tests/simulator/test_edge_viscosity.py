"""Oil that is thinner at some edges than at others: the balance against the independent simulator, both laws of an edge."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from reference.balance import blocked, solve_ports
from reference.oil import Oil as ReferenceOil
from reference.valve import Effects, Plant, Valve as ReferenceValve
from simulator.test_inflow import POINTS, TRUTH, X, fed_valve

from thermohyd.effects.row_shifts import SHIFTS, RowShifts
from thermohyd.static_tests import blocked_port_readings


THINNER = 0.3  # share that the viscosity is lower at the return edges


@dataclass(frozen=True)
class WarmedPlant(Plant):
    """The oil of the return edges has lost a share of its viscosity, and nothing else."""

    def edge(self, name, drop, p_mean, temperature):
        factor = 1.0 - THINNER if name[1] == "T" else 1.0
        oil = replace(self.oil, viscosity_factor=self.oil.viscosity_factor * factor)
        return Plant.edge(replace(self, oil=oil), name, drop, p_mean, temperature)


@pytest.mark.parametrize("law", ["orifice", "lubrication"])
def test_oil_that_is_thinner_at_the_return_edges(law):
    valve, at = fed_valve(0.0)
    rows = len(X)
    shifts = jnp.zeros((len(SHIFTS), rows))
    for edge in ("at", "bt"):
        shifts = shifts.at[SHIFTS.index(f"viscosity_{edge}")].set(-THINNER)
    with quick_compile():
        found = blocked_port_readings(replace(valve, effects=(RowShifts(shifts),), edge_law=law), at)
    ones = np.ones(rows)
    plant = WarmedPlant(
        ReferenceValve(slot_width=12e-3, **TRUTH, edge_law=law),
        Effects(), ReferenceOil(POINTS.viscosity_a, POINTS.viscosity_b), X, 210e5 * ones, 0.0 * ones, 313.15 * ones,
    )  # fmt: skip
    state = solve_ports(plant, blocked, 2)
    np.testing.assert_allclose(found["pressure_a"], state.p_a, rtol=1e-9)
    np.testing.assert_allclose(found["pressure_b"], state.p_b, rtol=1e-9)
    volume = state.return_flow / plant.oil.rho(np.zeros(rows), state.return_temperature)
    np.testing.assert_allclose(found["leakage_flow"], volume, rtol=1e-9)
