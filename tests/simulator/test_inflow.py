"""A flow that enters a port by no edge: the balances with it against the independent simulator, and its size and sign alone."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import STROKE
from reference.balance import blocked, connected, solve_ports
from reference.oil import Oil as ReferenceOil
from reference.valve import Effects, Plant, Valve as ReferenceValve

from thermohyd.conditions import Conditions
from thermohyd.effects.row_shifts import SHIFTS, RowShifts
from thermohyd.oil import oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import Valve


POINTS = OilDefinition(9.0, 3.6)
X = np.linspace(-60e-6, 60e-6, 25)
TRUTH = {
    "edge_radius": 8e-6, "clearance": 2.5e-6, "underlap": 6e-6, "discharge_coefficient": 0.68, "transition_number": 90.0,
    "null_bias": 0.0,
}  # fmt: skip


@dataclass(frozen=True)
class FedPlant(Plant):
    """Oil [m3/s, at the port's own state] enters port A beside edge P-A."""

    fed: float = 0.0

    def edge(self, name, drop, p_mean, temperature):
        more = self.oil.rho(p_mean - 0.5 * drop, temperature) * self.fed if name == "PA" else 0.0
        return Plant.edge(self, name, drop, p_mean, temperature) + more


def fed_valve(flow: float) -> tuple[Valve, Conditions]:
    rows = len(X)
    shifts = jnp.zeros((len(SHIFTS), rows)).at[SHIFTS.index("flow_into_a")].set(flow)
    valve = Valve(oil=oil_from_definition(POINTS), stroke=STROKE, slot_width=12e-3, **TRUTH)
    at = Conditions(
        position=jnp.asarray(X), supply_pressure=jnp.full(rows, 210e5), return_pressure=jnp.zeros(rows),
        temperature=jnp.full(rows, 313.15),
    )  # fmt: skip
    return replace(valve, effects=(RowShifts(shifts),)), at


def fed_plant(flow: float) -> FedPlant:
    valve = ReferenceValve(slot_width=12e-3, **TRUTH, edge_law="orifice")
    rows = np.full(len(X), 1.0)
    oil = ReferenceOil(POINTS.viscosity_a, POINTS.viscosity_b)
    return FedPlant(valve, Effects(), oil, X, 210e5 * rows, 0.0 * rows, 313.15 * rows, fed=flow)


@pytest.mark.parametrize("flow", [0.0, 2e-6, 3e-7])
def test_blocked_ports_balance_with_what_enters(flow):
    with quick_compile():
        found = blocked_port_readings(*fed_valve(flow))
    state = solve_ports(fed_plant(flow), blocked, 2)
    # To rounding of the drop: what enters is more than edge P-A lets through, and p_A stands a thousandth below the supply.
    np.testing.assert_allclose(found["pressure_a"], state.p_a, rtol=1e-8)
    np.testing.assert_allclose(found["pressure_b"], state.p_b, rtol=1e-9)
    volume = state.return_flow / fed_plant(flow).oil.rho(np.zeros(len(X)), state.return_temperature)
    np.testing.assert_allclose(found["leakage_flow"], volume, rtol=1e-9)


@pytest.mark.parametrize("flow", [0.0, 2e-6])
def test_connected_ports_hand_on_what_enters(flow):
    with quick_compile():
        found = control_flow(*fed_valve(flow))
    state = solve_ports(fed_plant(flow), connected, 1)
    np.testing.assert_allclose(
        found, state.load_flow / fed_plant(flow).oil.rho(state.p_a, state.t_a), rtol=1e-9, atol=1e-15
    )


def test_what_leaves_a_port_lowers_its_pressure():
    with quick_compile():
        none, out = (blocked_port_readings(*fed_valve(flow)) for flow in (0.0, -3e-7))
    assert np.all(np.asarray(out["pressure_a"]) < np.asarray(none["pressure_a"]))
    np.testing.assert_allclose(out["pressure_b"], none["pressure_b"], rtol=1e-12)
