"""The appendix's formulas against a numerical linearisation of the same loop, and what docs/physics.md section 11 says of them."""

import doctest
from dataclasses import replace
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import seed_valve, temperature_at
from reference.linear_actuator import Bench, Jack, jacobian, some
from reference.oil import seed_oil as reference_oil
from reference.valve import Effects, Valve as ReferenceValve

from thermohyd import control_loop as closed_loop
from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import Performance, performance
from thermohyd.conditions import operating_points
from thermohyd.effects.library import with_effects
from thermohyd.static_tests import flow_gain, flow_pressure_gain, leakage_flow, pressure_gain


CENTISTOKES = (30, 300, 4000)
SUPPLY, BACK = 210e5, 4e5
LEAK = 3e-13
CHAMBERS = {False: "pa pb", True: "pa pb ta tb"}


@pytest.fixture(autouse=True, scope="module")
def quickly():
    with quick_compile():
        yield


@cache
def found(heat: float | None, leak: float = LEAK, frequency: float = 100.0) -> Performance:
    """All viscosities in one call."""
    return performance(
        seed_valve(),
        Actuator(jack_leakage=leak, spool_frequency=frequency, coulomb_friction=80.0, external_force=1000.0),
        temperature=jnp.array([temperature_at(nu) for nu in CENTISTOKES]),
        supply_pressure=SUPPLY,
        return_pressure=BACK,
        heat=heat,
    )


def bench(i: int, adiabatic: bool = False, **jack) -> Bench:
    """The same actuator in the independent model."""
    jack = Jack(**({"jack_leakage": LEAK} | jack))
    return Bench(ReferenceValve(), reference_oil(), jack, temperature_at(CENTISTOKES[i]), SUPPLY, BACK, adiabatic)


def oscillation(matrix: np.ndarray) -> tuple[float, float]:
    """(pulsation, damping ratio) of the fastest oscillating pair of eigenvalues."""
    pole = max(np.linalg.eigvals(matrix), key=lambda s: s.imag)
    return abs(pole), -pole.real / abs(pole)


@pytest.mark.parametrize("i", range(3))
def test_hydraulic_mode_isothermal(i):
    jack = some(jacobian(bench(i)), "pa pb v", "pa pb v")
    omega, xi = oscillation(jack)
    # The model's states are the mean pressure, which does not move the piston, and the oscillation.
    assert float(found(0.0).natural_frequency[i]) == pytest.approx(omega, rel=1e-7)
    assert float(found(0.0).damping_ratio[i]) == pytest.approx(xi, rel=1e-6)
    force = np.array([0.0, 0.0, -1.0 / 50.0])
    assert float(found(0.0).load_factor[i]) == pytest.approx(np.linalg.solve(jack, force)[-1], rel=1e-7)


@pytest.mark.parametrize("i", range(3))
def test_static_and_load_error(i):
    full = jacobian(bench(i))
    # At rest in the loop under 1000 N; temperatures are no states here.
    states = "x vx pa pb z v"
    push = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1000.0 / 50.0])
    moved = np.linalg.solve(some(full, states, states), push)[4]
    assert float(found(0.0).load_error[i]) == pytest.approx(-moved, rel=1e-6)
    # A piston that sticks: what the loop's error must be for the pressures to reach the friction of 80 N.
    held = some(full, "x vx pa pb", "x vx pa pb")
    by_position = np.linalg.solve(held, -some(full, "x vx pa pb", "z")[:, 0])
    error = 80.0 / (12e-4 * (by_position[3] - by_position[2]))
    assert float(found(0.0).static_error[i]) == pytest.approx(error, rel=1e-6)
    assert float(found(0.0).static_error_voltage[i]) == pytest.approx(error * 100.0, rel=1e-6)


@pytest.mark.parametrize("i", range(3))
def test_loop_gain_limit_is_critical_for_a_fast_spool(i):
    own = float(found(0.0).stability_ratio[i])

    def growth(share: float) -> float:
        gain = 0.01 * share / own
        full = jacobian(bench(i, spool_frequency=20e3, amplifier_gain=gain))
        states = "x vx pa pb z v"
        return max(s.real for s in np.linalg.eigvals(some(full, states, states)) if abs(s.imag) > 1.0)

    assert growth(0.999) < 0.0 < growth(1.001)


@pytest.mark.parametrize("frequency", [60.0, 250.0, 500.0])
def test_critical_loop_gain_with_the_spool(frequency):
    for i in range(3):
        own = found(0.0, frequency=frequency)
        for share, unstable in ((1.0 - 1e-6, False), (1.0 + 1e-6, True)):
            gain = 0.01 * share * float(own.gain_margin[i])
            full = jacobian(bench(i, spool_frequency=frequency, amplifier_gain=gain))
            states = "x vx pa pb z v"
            growth = max(s.real for s in np.linalg.eigvals(some(full, states, states)) if abs(s.imag) > 1.0)
            assert (growth > 0.0) == unstable


@pytest.mark.parametrize("i", range(3))
def test_adiabatic(i):
    names = f"{CHAMBERS[True]} v"
    jack = some(jacobian(bench(i, adiabatic=True)), names, names)
    omega, xi = oscillation(jack)
    thm = found(1.0)
    share = float(found(0.0).natural_frequency[i]) / omega - 1.0
    print(f"isothermal omega_h against the adiabatic jack at {CENTISTOKES[i]} cSt: {share:+.1%}; ", end="")
    print(f"omega_h at eta = 1: {float(thm.natural_frequency[i]) / omega - 1.0:+.1e}")
    # With the isentropic modulus only the chambers' slow temperatures are left out.
    assert float(thm.natural_frequency[i]) == pytest.approx(omega, rel=5e-5)
    assert float(thm.damping_ratio[i]) == pytest.approx(xi, rel=0.04)
    assert -0.12 < share < -0.05
    force = np.zeros(5)
    force[-1] = -1.0 / 50.0
    assert float(thm.load_factor[i]) == pytest.approx(np.linalg.solve(jack, force)[-1], rel=2e-3)


def test_away_from_mid_stroke():
    # docs/physics.md section 11: 4.6 % at z = 15 mm of a +-25 mm jack. The chambers in series are stiffer there.
    omega, _ = oscillation(some(jacobian(bench(0), 15e-3), "pa pb v", "pa pb v"))
    share = float(found(0.0).natural_frequency[0]) / omega - 1.0
    print(f"omega_h of the formula at z = 15 mm: {share:+.2%}")
    assert share == pytest.approx(-0.046, abs=1e-3)


def test_half_way_between_heat_models():
    hm, half, thm = (np.asarray(found(eta).natural_frequency) for eta in (0.0, 0.5, 1.0))
    assert np.all((hm < half) & (half < thm))
    np.testing.assert_allclose(found(None).natural_frequency, hm, rtol=1e-12)
    np.testing.assert_allclose(found(None).static_error, found(0.0).static_error, rtol=1e-12)


@pytest.mark.parametrize(
    "amounts",
    [{}, {"throttle_heating": 0.7}, {"cross_port_leakage": 1e-12, "supply_droop": 1e9, "bushing_leakage": 1e-13}],
)
def test_gains_are_those_of_the_static_tests(amounts):
    valve = with_effects(seed_valve(), amounts)
    own = performance(valve, Actuator(), temperature=300.0, supply_pressure=SUPPLY, return_pressure=BACK)
    null = operating_points(0.0, supply_pressure=SUPPLY, return_pressure=BACK, temperature=300.0)
    assert float(own.flow_gain) == pytest.approx(float(flow_gain(valve, null)[0]), rel=1e-9)
    assert float(own.pressure_gain) == pytest.approx(float(pressure_gain(valve, null)[0]), rel=1e-9)
    assert float(own.flow_pressure_gain) == pytest.approx(float(flow_pressure_gain(valve, null)[0]), rel=1e-9)
    assert float(own.null_leakage) == pytest.approx(float(leakage_flow(valve, null)[0]), rel=1e-12)
    assert float(own.flow_current_gain) == pytest.approx(float(own.flow_gain) * 213e-6 / 25e-3, rel=1e-12)


def test_the_bench_stays_behind():
    at = {"temperature": 300.0, "supply_pressure": SUPPLY}
    plain = performance(seed_valve(), Actuator(), **at)
    amounts: dict[str, Any] = {
        "flowmeter_scale": 0.05,
        "flowmeter_offset": 1e-7,
        "temperature_offset": 5.0,
        "pressure_offset": 1e5,
    }
    amounts |= {"position_scale": 0.03, "hysteresis": 3e-6, "flowmeter_lag": 1.0}
    read = performance(with_effects(seed_valve(null_bias=2e-6), amounts), Actuator(), **at)
    assert float(read.null_consumption) == float(plain.null_consumption)
    assert float(read.loop_gain) == float(plain.loop_gain)


def test_shapes_and_identities():
    valve, jack = seed_valve(), Actuator(jack_leakage=LEAK)
    grid = performance(valve, jack, temperature=jnp.array([[280.0], [330.0]]), supply_pressure=jnp.array([70e5, 210e5]))
    assert grid.loop_gain.shape == (2, 2)
    g = 1.0 + grid.leakage_coefficient * jack.viscous_friction / jack.areas**2
    np.testing.assert_allclose(grid.loop_gain, 0.01 * 100.0 * grid.flow_current_gain / (g * jack.areas), rtol=1e-12)
    np.testing.assert_allclose(grid.time_constant * grid.loop_gain, 1.0, rtol=1e-12)
    np.testing.assert_allclose(grid.pressure_gain * grid.flow_pressure_gain, grid.flow_gain, rtol=1e-12)
    closer = performance(valve, jack, temperature=280.0, supply_pressure=70e5, gamma=1.0)
    assert float(closer.stability_ratio) == pytest.approx(2.0 * float(grid.stability_ratio[0, 0]), rel=1e-12)


def test_margins_of_python_control():
    own = found(0.0)
    jack = Actuator(jack_leakage=LEAK)
    ideal = closed_loop.loop_margins(own, jack, spool=False)
    # Eq. 1 with gamma = 2 is the gain margin of a loop whose spool follows at once.
    np.testing.assert_allclose(ideal.gain_margin, 1.0 / own.stability_ratio, rtol=1e-7)
    np.testing.assert_allclose(ideal.phase_crossover, own.natural_frequency, rtol=1e-7)
    real = closed_loop.loop_margins(own, jack)
    np.testing.assert_allclose(real.gain_margin, own.gain_margin, rtol=1e-7)
    assert np.all((real.phase_margin > 0.0) & (real.phase_margin < 90.0))
    # Warm oil: the flow gain at null rises, and with it the loop gain.
    assert real.gain_margin[0] < real.gain_margin[1] < real.gain_margin[2]


@pytest.mark.parametrize("i", range(3))
def test_transfer_functions_are_those_of_the_linearisation(i):
    full, states = jacobian(bench(i)), "x vx pa pb z v"
    a = some(full, states, states)
    entry = np.zeros((6, 2))
    entry[1, 0] = -a[1, 4]  # the setpoint enters where the position leaves the loop
    entry[5, 1] = -1.0 / 50.0
    loop = closed_loop.loops(found(0.0), Actuator(jack_leakage=LEAK))[i]
    to_setpoint, to_force = closed_loop.closed_loop(loop), closed_loop.load_response(loop)
    for omega in (0.1, 10.0, 600.0, 1300.0):
        expected = np.linalg.solve(1j * omega * np.eye(6) - a, entry)[4]
        np.testing.assert_allclose([to_setpoint(1j * omega), to_force(1j * omega)], expected, rtol=1e-5)
    poles = closed_loop.state_space(loop).poles()
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(to_setpoint.poles()), rtol=1e-6)


def test_bode_data():
    own, jack = found(0.0), Actuator(jack_leakage=LEAK)
    coarse = closed_loop.loop_frequency_response(own, jack, [1e-3, 1e5])
    fine = closed_loop.loop_frequency_response(own, jack, np.geomspace(1e-3, 1e5, 2000))
    np.testing.assert_allclose(fine.phase[:, [0, -1]], coarse.phase, rtol=1e-12)
    np.testing.assert_allclose(coarse.phase, [[-90.0, -450.0]] * 3, atol=2.0)
    assert np.all(np.diff(fine.phase) < 0.0)
    shut = closed_loop.loop_frequency_response(own, jack, [1e-3], closed=True)
    np.testing.assert_allclose(shut.magnitude, 1.0, atol=1e-4)


def test_unequal_edges_keep_the_formulas():
    # Worn return edges move the null pressure off the middle: the formulas hold, as both chambers still share it.
    worn: dict[str, Any] = {"return_edge_wear": 8e-6}
    own = performance(
        with_effects(seed_valve(), worn), Actuator(), temperature=300.0, supply_pressure=SUPPLY, return_pressure=BACK
    )
    peer = Bench(ReferenceValve(), reference_oil(), Jack(), 300.0, SUPPLY, BACK)
    omega, xi = oscillation(some(jacobian(replace(peer, effects=Effects(**worn))), "pa pb v", "pa pb v"))
    assert float(own.natural_frequency) == pytest.approx(omega, rel=1e-7)
    assert float(own.damping_ratio) == pytest.approx(xi, rel=1e-6)


def test_examples():
    result = doctest.testmod(closed_loop)
    assert result.attempted
    assert not result.failed
