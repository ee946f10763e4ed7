"""A flow that enters a port by no edge: the balances with it against the independent simulator, and its size and sign alone."""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.shifted_valve import X, plant_of, shifted_valve
from reference.balance import blocked, connected, solve_ports
from reference.valve import Plant

from thermohyd.static_tests import blocked_port_readings, control_flow


@dataclass(frozen=True)
class FedPlant(Plant):
    """Oil [m3/s, at the port's own state] enters port A beside edge P-A."""

    fed: float = 0.0

    def edge(self, name, drop, p_mean, temperature):
        more = self.oil.rho(p_mean - 0.5 * drop, temperature) * self.fed if name == "PA" else 0.0
        return Plant.edge(self, name, drop, p_mean, temperature) + more


@pytest.mark.parametrize("flow", [0.0, 2e-6, 3e-7])
def test_blocked_ports_balance_with_what_enters(flow):
    with quick_compile():
        found = blocked_port_readings(*shifted_valve(flow_into_a=flow))
    state = solve_ports(plant_of(FedPlant, fed=flow), blocked, 2)
    # To rounding of the drop: what enters is more than edge P-A lets through, and p_A stands a thousandth below the supply.
    np.testing.assert_allclose(found["pressure_a"], state.p_a, rtol=1e-8)
    np.testing.assert_allclose(found["pressure_b"], state.p_b, rtol=1e-9)
    volume = state.return_flow / plant_of(FedPlant, fed=flow).oil.rho(np.zeros(len(X)), state.return_temperature)
    np.testing.assert_allclose(found["leakage_flow"], volume, rtol=1e-9)


@pytest.mark.parametrize("flow", [0.0, 2e-6])
def test_connected_ports_hand_on_what_enters(flow):
    with quick_compile():
        found = control_flow(*shifted_valve(flow_into_a=flow))
    state = solve_ports(plant_of(FedPlant, fed=flow), connected, 1)
    np.testing.assert_allclose(
        found, state.load_flow / plant_of(FedPlant, fed=flow).oil.rho(state.p_a, state.t_a), rtol=1e-9, atol=1e-15
    )


def test_what_leaves_a_port_lowers_its_pressure():
    with quick_compile():
        none, out = (blocked_port_readings(*shifted_valve(flow_into_a=flow)) for flow in (0.0, -3e-7))
    assert np.all(np.asarray(out["pressure_a"]) < np.asarray(none["pressure_a"]))
    np.testing.assert_allclose(out["pressure_b"], none["pressure_b"], rtol=1e-12)
