"""Heat exchange with a wall: its limits are THM and HM, its energy balances, its derivatives are finite everywhere."""

import doctest
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import seed_valve

from thermohyd import heat as heat_exchange, wall_tests
from thermohyd.conditions import operating_points
from thermohyd.effects.library import with_effects
from thermohyd.heat import HeatExchange, effectiveness, eta_from_ntu, wall_state
from thermohyd.identify import heat_study as identifiability
from thermohyd.oil import specific_heat, throttling_rise
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import true_oil
from thermohyd.wall_tests import wall_readings


X = np.array([-30e-6, -5e-6, 0.0, 2e-6, 15e-6, 213e-6])
T = np.array([243.15, 263.15, 283.15, 303.15, 323.15, 343.15])
CONDITIONS = operating_points(jnp.asarray(X), supply_pressure=210e5, return_pressure=2e5, temperature=jnp.asarray(T))
INF = float("inf")


@pytest.fixture(autouse=True, scope="module")
def quickly():
    with quick_compile():
        yield


def exchange(wall, ambient, air=None):
    """One entry per row, so that every test shares a program."""
    given = T if air is None else air
    return HeatExchange(*(jnp.broadcast_to(jnp.asarray(v, dtype=float), X.shape) for v in (wall, ambient, given)))


@pytest.mark.parametrize(
    ("wall", "ambient", "eta"), [(0.0, 3.0, 1.0), (0.0, 0.0, 1.0), (0.0, INF, 1.0), (INF, INF, 0.0)]
)
def test_limits_are_the_two_models(wall, ambient, eta):
    found = wall_readings(seed_valve(), exchange(wall, ambient), CONDITIONS)
    closed = blocked_port_readings(seed_valve(eta), CONDITIONS)
    np.testing.assert_allclose(found.leakage_flow, closed["leakage_flow"], rtol=1e-11)
    np.testing.assert_allclose(found.load_pressure, closed["load_pressure"], rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(found.flow, control_flow(seed_valve(eta), CONDITIONS), rtol=1e-11, atol=1e-18)
    np.testing.assert_allclose(found.eta, eta, atol=1e-12)


def test_a_finite_contact_nears_its_limits():
    hm, thm = (wall_readings(seed_valve(), exchange(h, INF), CONDITIONS) for h in (INF, 0.0))
    for h, limit in ((1e-6, thm), (1e6, hm)):
        near = wall_readings(seed_valve(), exchange(h, INF), CONDITIONS)
        np.testing.assert_allclose(near.leakage_flow, limit.leakage_flow, rtol=1e-3)
        np.testing.assert_allclose(near.eta, limit.eta, atol=1e-2)
    middle = wall_readings(seed_valve(), exchange(0.3, INF), CONDITIONS)
    # At -30 um and -30 degC the flow is so slow that the wall takes everything.
    assert np.all(hm.leakage_flow <= middle.leakage_flow * (1.0 + 1e-12))
    assert np.all(hm.leakage_flow[1:] < middle.leakage_flow[1:])
    assert np.all(middle.leakage_flow < thm.leakage_flow)
    # More flow, less time at the wall: eta rises with temperature and away from a closed valve.
    at_null = wall_readings(seed_valve(), exchange(0.3, INF), replace(CONDITIONS, position=jnp.zeros(X.size)))
    assert np.all(np.diff(at_null.eta) > 0.0)


@pytest.mark.parametrize("wall", [1e-3, 0.1, 10.0, 1e3, INF])
@pytest.mark.parametrize("joined", [False, True])
def test_an_insulated_wall_is_adiabatic_overall(wall, joined):
    valve = seed_valve()
    state = wall_state(valve, true_oil(valve), exchange(wall, 0.0), CONDITIONS, joined=joined)
    c, oil, ports = CONDITIONS, true_oil(valve), state.ports
    # What both throttlings release, by mass, is what the return carries away; the wall hands heat on to the ports.
    drop = c.supply_pressure - ports.pressure
    first = throttling_rise(oil, drop, c.supply_pressure - 0.5 * drop, c.temperature)
    back = ports.pressure - c.return_pressure
    second = throttling_rise(oil, back, c.return_pressure + 0.5 * back, ports.temperature)
    flow = jnp.sum(ports.outflow, axis=0)
    released = jnp.sum(ports.inflow * first + ports.outflow * second, axis=0) / flow
    np.testing.assert_allclose(state.return_temperature - c.temperature, released, rtol=1e-9)
    np.testing.assert_allclose(jnp.sum(ports.inflow, axis=0), flow, rtol=1e-12)


@pytest.mark.parametrize(("wall", "ambient", "air"), [(0.2, 0.5, 293.15), (5.0, 0.02, 213.15), (INF, 3.0, 353.15)])
def test_what_the_oil_gives_the_air_takes(wall, ambient, air):
    valve = seed_valve()
    state = wall_state(valve, true_oil(valve), exchange(wall, ambient, air), CONDITIONS, joined=False)
    c, oil, ports = CONDITIONS, true_oil(valve), state.ports
    drop = c.supply_pressure - ports.pressure
    entering = c.temperature + throttling_rise(oil, drop, c.supply_pressure - 0.5 * drop, c.temperature)
    heat = specific_heat(oil, c.temperature)
    expected = state.wall_temperature + (entering - state.wall_temperature) * state.eta
    np.testing.assert_allclose(ports.temperature, expected, rtol=1e-12)
    back = ports.pressure - c.return_pressure
    second = throttling_rise(oil, back, c.return_pressure + 0.5 * back, ports.temperature)
    flow = jnp.sum(ports.outflow, axis=0)
    released = jnp.sum(ports.inflow * (entering - c.temperature) + ports.outflow * second, axis=0)
    lost = heat * (released - flow * (state.return_temperature - c.temperature))
    scale = heat * flow * 20.0
    np.testing.assert_allclose(lost / scale, ambient * (state.wall_temperature - air) / scale, atol=1e-9)
    if np.isfinite(wall):
        np.testing.assert_allclose(state.eta, eta_from_ntu(wall / (ports.inflow * heat)), rtol=1e-9, atol=1e-14)


@jax.jit
def outputs(h, g, air, radius):
    valve, exchange = replace(seed_valve(), edge_radius=radius), HeatExchange(h, g, air)
    closed, joined = (
        wall_state(valve, true_oil(valve), exchange, CONDITIONS, joined=joined) for joined in (False, True)
    )
    load = (closed.ports.pressure[0] - closed.ports.pressure[1]) * 1e-5
    leakage, flow = (jnp.sum(state.ports.outflow, axis=0) * 1e3 for state in (closed, joined))
    return jnp.stack([leakage, load, flow, closed.wall_temperature])


slopes = jax.jit(lambda at, tangent: jax.jvp(outputs, at, tangent)[1])


@pytest.mark.parametrize(
    ("wall", "ambient"),
    [(0.0, 0.0), (0.0, 1.0), (0.3, 0.0), (0.3, 0.7), (0.3, INF), (INF, 0.0), (INF, 0.7), (INF, INF)],
)
def test_derivatives_are_finite_and_those_of_differences(wall, ambient):
    at = [jnp.broadcast_to(jnp.asarray(v, dtype=float), X.shape) for v in (wall, ambient, T - 20.0)] + [
        seed_valve().edge_radius
    ]
    for i, (step, moves) in enumerate(
        ((1e-4, np.isfinite(wall)), (1e-4, np.isfinite(ambient)), (1e-2, True), (1e-9, True))
    ):
        tangent = [jnp.ones_like(a) if j == i else jnp.zeros_like(a) for j, a in enumerate(at)]
        slope = slopes(at, tangent)
        assert np.all(np.isfinite(slope))
        if not moves:
            np.testing.assert_array_equal(slope, 0.0)
            continue
        if wall == 0.0 and ambient == 0.0 and i < 2:
            continue  # a wall that nothing touches: no temperature, hence no derivative of it on either side
        above, below = (outputs(*(a + s * step * t for a, t in zip(at, tangent, strict=True))) for s in (1.0, 0.0))
        twice = outputs(*(a + 2.0 * step * t for a, t in zip(at, tangent, strict=True)))
        one_sided = (4.0 * above - 3.0 * below - twice) / (2.0 * step)  # conductances do not go below zero
        size = np.maximum(np.abs(one_sided), np.max(np.abs(below), axis=1, keepdims=True) * 1e-6 / step)
        np.testing.assert_array_less(np.abs(slope - one_sided), 2e-3 * size)


def test_reverse_mode_at_the_limits():
    valve = seed_valve()

    def total(h, g):
        exchange = HeatExchange(h, g, jnp.asarray(T - 20.0))
        state = wall_state(valve, true_oil(valve), exchange, CONDITIONS, joined=False)
        return jnp.sum(state.ports.outflow) * 1e3 + jnp.sum(state.wall_temperature)

    both = jax.jit(lambda h, g, dh, dg: (jax.jvp(total, (h, g), (dh, dg))[1], jax.grad(total, (0, 1))(h, g)))
    for wall, ambient in ((0.0, 1.0), (0.3, 0.0), (INF, INF)):
        at = [jnp.full(X.shape, v) for v in (wall, ambient)]
        for i in range(2):
            forward, reverse = both(*at, *(jnp.full(X.size, float(j == i)) for j in range(2)))
            np.testing.assert_allclose(float(jnp.sum(reverse[i])), float(forward), rtol=1e-8, atol=1e-12)


def test_effectiveness_and_refusals():
    np.testing.assert_allclose(1.0 - effectiveness(2.0, 1e-3, 2000.0), eta_from_ntu(1.0), rtol=1e-14)
    for h, slope in ((0.0, 0.5), (INF, 0.0)):
        assert float(jax.grad(lambda h: effectiveness(h, 1e-3, 2000.0))(jnp.asarray(h))) == pytest.approx(slope)
    tied = with_effects(seed_valve(), {"supply_droop": 1e9})
    with pytest.raises(ValueError, match="SupplyDroop"):
        wall_readings(tied, exchange(1.0, 1.0), CONDITIONS)


def test_eta_is_told_by_cold_leakage_and_hides_behind_the_geometry():
    found = identifiability.eta_identifiability(
        seed_valve(),
        temperature=[243.15, 303.15, 343.15],
        supply_pressure=[70e5, 210e5],
        position=np.linspace(-40e-6, 40e-6, 41),
    )
    assert found.slope.shape == (3, 2, 3, 41)
    assert np.all(found.held <= found.free)
    # Three times the pressure, three times the heat; turbulent flow answers less to it.
    np.testing.assert_allclose(found.held[:2, 0] / found.held[:2, 1], 3.0, rtol=0.35)
    assert np.all(found.held[:, 0] > found.held[:, 1])
    leakage = found.tests.index("leakage")
    # Cold oil's viscosity answers most to a kelvin.
    assert np.all(np.diff(found.held[leakage, 1]) > 0.0)
    # More sweeps never say less.
    assert np.all(found.all_tests <= np.min(found.free, axis=0))
    assert np.all(found.all_temperatures <= np.min(found.free, axis=-1))
    # The error follows the noise.
    double = identifiability.eta_identifiability(
        seed_valve(),
        temperature=[243.15, 303.15, 343.15],
        supply_pressure=[70e5, 210e5],
        position=np.linspace(-40e-6, 40e-6, 41),
        noise={"leakage": 2.0 * float(found.noise[leakage, 1, 0])},
    )
    assert double.held[leakage, 1, 0] == pytest.approx(2.0 * found.held[leakage, 1, 0], rel=1e-12)


def test_standard_error_is_that_of_the_inverse_information():
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(30, 4)) * [1.0, 1e6, 1e-6, 1.0]
    expected = np.sqrt(np.linalg.inv((columns / [1.0, 1e6, 1e-6, 1.0]).T @ (columns / [1.0, 1e6, 1e-6, 1.0]))[0, 0])
    assert identifiability.standard_error(columns) == pytest.approx(expected, rel=1e-9)
    assert identifiability.standard_error(np.column_stack([columns[:, 1], columns])) == np.inf


@pytest.mark.parametrize("module", [heat_exchange, wall_tests, identifiability])
def test_examples(module):
    result = doctest.testmod(module)
    assert result.attempted
    assert not result.failed
