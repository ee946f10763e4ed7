"""Heat in the chambers: a closed volume that is warmed, walls with a capacity of their own, and the limits of both."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.machines import DYNAMIC, actuator_of, apart, as_table, inputs_of, simulated, valve_of
from helpers.quick_compile import quick_jit
from reference.actuator import Dynamic, volumes
from reference.conformance_dynamic import machine_of, readings_of

from thermohyd.dynamics.machine import State, Surroundings, Walls, plant_of
from thermohyd.dynamics.vector_field import rates_at


MACHINE = machine_of("closed_adiabatic")
TS, TAMB = 313.15, 290.0
PSI = 6894.757


@quick_jit
def rates(walls: Walls, state: State, supply: jax.Array, back: jax.Array) -> State:
    """Of the bare machine under its first row's setpoint, at other pressures."""
    plant = plant_of(
        valve_of(MACHINE), actuator_of(MACHINE), inputs_of(MACHINE), heat="adiabatic", walls=walls, polarity=1
    )
    return rates_at(
        plant, state, Surroundings(supply, back, jnp.asarray(TS), jnp.zeros(()), jnp.zeros(())), jnp.zeros(())
    )


def at_rest(pressure, temperature, wall, position: float = 0.0, velocity: float = 0.0) -> State:
    pair = lambda value: jnp.broadcast_to(jnp.asarray(value, dtype=float), (2,))
    zero = jnp.zeros(())
    return State(zero, zero, pair(pressure), pair(temperature), zero + position, zero + velocity, wall=pair(wall))


def metal(conductance: float, capacity: float, ambient: float, at: float = TAMB) -> Walls:
    return Walls(conductance, capacity, ambient, at)


@pytest.mark.parametrize("start", [263.15, 288.15])
def test_closed_volume_that_is_warmed(start):
    """With one pressure everywhere nothing flows: dp = alpha beta dT, and 50 degF make 5000 to 6200 psi (docs/physics.md section 13).

    From cold and from room temperature; warmer oil is softer, from 40 degC on they make 4700 psi and less.
    """
    walls, oil = metal(20.0, 500.0, 0.0), MACHINE.oil
    slope = lambda p, t: rates(walls, at_rest(p, t, t + 30.0), jnp.asarray(p), jnp.asarray(p))
    for pressure in (0.0, 200e5):
        found = slope(pressure, start)
        warmer, higher = np.asarray(found.temperature), np.asarray(found.pressure)
        assert np.all(warmer > 0.0)
        expected = oil.alpha(pressure, start) * oil.beta(pressure, start) * warmer
        np.testing.assert_allclose(higher, expected, rtol=1e-10)
    pressure, step = 0.0, 50.0 / 1.8 / 20
    for middle in start + step * (np.arange(20) + 0.5):
        found = slope(pressure, middle)
        pressure += step * float(found.pressure[0] / found.temperature[0])
    print(f"from {start} K: {pressure / PSI:.0f} psi")
    assert 5000.0 < pressure / PSI < 6200.0


@pytest.mark.parametrize("seed", range(3))
def test_heat_of_oil_and_wall_closes(seed):
    """What walls take from the oil is what they gain, less what they lose: any flows, any motion."""
    rng = np.random.default_rng(seed)
    p, warm, wall = rng.uniform(20e5, 190e5, 2), rng.uniform(300.0, 330.0, 2), rng.uniform(280.0, 340.0, 2)
    z, v = rng.uniform(-5e-3, 5e-3), rng.uniform(-0.1, 0.1)
    state = at_rest(p, warm, wall, z, v)
    supply, back = jnp.asarray(210e5), jnp.asarray(2e5)
    with_heat = rates(metal(30.0, 80.0, 7.0), state, supply, back)
    without = rates(metal(0.0, 80.0, 7.0), state, supply, back)
    volume, oil = np.stack(volumes(MACHINE, z)), MACHINE.oil
    warmer = np.asarray(with_heat.temperature) - np.asarray(without.temperature)
    higher = np.asarray(with_heat.pressure) - np.asarray(without.pressure)
    taken = volume * (oil.rho(p, warm) * oil.cp(warm) * warmer - oil.alpha(p, warm) * warm * higher)
    assert with_heat.wall is not None
    gained = 80.0 * np.asarray(with_heat.wall)
    np.testing.assert_allclose(taken, 30.0 * (wall - warm), rtol=1e-8, atol=1e-6)
    np.testing.assert_allclose(taken + gained, 7.0 * (TAMB - wall), rtol=1e-8, atol=1e-6)


def test_limits_of_a_wall_are_the_fixed_one_s():
    """A wall of huge capacity, or tied to its surroundings, stays at its temperature: here at T_s, as `wall_heat` has it."""
    given = replace(machine_of("wall_heat"), dynamic=Dynamic())
    run = lambda walls: as_table(simulated(given, DYNAMIC, 8, walls))
    expected = readings_of("wall_heat")
    heavy, tied = run(metal(20.0, 1e9, 1e8, TS)), run(metal(20.0, 1.0, 1e8, TS))
    light, elsewhere = run(metal(20.0, 1.0, 0.0, TS)), run(metal(20.0, 1.0, 1e8, TAMB))
    assert np.max(apart(heavy, expected)) < 1e-5
    assert np.max(apart(tied, expected)) < 1e-5
    # Neither limit is reached by doing nothing.
    assert np.max(apart(light, expected)) > 1e-4
    assert np.max(apart(elsewhere, expected)) > 1e-4
