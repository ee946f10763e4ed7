"""Oil that is thinner at some edges than at others: the balance against the independent simulator, both laws of an edge."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.shifted_valve import X, plant_of, shifted_valve
from reference.balance import blocked, solve_ports
from reference.valve import Plant

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
    with quick_compile():
        found = blocked_port_readings(*shifted_valve(law, viscosity_at=-THINNER, viscosity_bt=-THINNER))
    plant = plant_of(WarmedPlant, law)
    state = solve_ports(plant, blocked, 2)
    np.testing.assert_allclose(found["pressure_a"], state.p_a, rtol=1e-9)
    np.testing.assert_allclose(found["pressure_b"], state.p_b, rtol=1e-9)
    volume = state.return_flow / plant.oil.rho(np.zeros(len(X)), state.return_temperature)
    np.testing.assert_allclose(found["leakage_flow"], volume, rtol=1e-9)
