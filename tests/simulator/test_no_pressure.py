"""Where supply equals return nothing flows, and every reading has the derivatives of its limit: forward, reverse, and by differences."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.conditions import Conditions
from thermohyd.effects.library import with_effects
from thermohyd.seed_paper import seed_valve
from thermohyd.static_tests import blocked_port_readings, control_flow, load_flow


POSITION = np.array([0.0, 3e-6, -40e-6, 100e-6])
ROWS = len(POSITION)
STEP = 0.1  # Pa: flows are laminar there to a millionth
VALVES = {
    "orifice": ("orifice", {}),
    "film": ("lubrication", {}),
    "heat": ("orifice", {"throttle_heating": 0.5}),
    "lines": ("orifice", {"supply_droop": 3e9, "return_back_pressure": 3e9}),
    "crossing": ("orifice", {"port_leakage": 1e-13}),
}


def valve(kind: str):
    law, effects = VALVES[kind]
    return with_effects(replace(seed_valve(), edge_law=law), effects)


def at(supply, load=None) -> Conditions:
    full = lambda value: jnp.full(ROWS, value)
    return Conditions(jnp.asarray(POSITION), supply, full(2e5), full(313.15), load_pressure=load)


READINGS = {
    "leakage_flow": lambda of, c: blocked_port_readings(of, c)["leakage_flow"],
    "pressure_a": lambda of, c: blocked_port_readings(of, c)["pressure_a"],
    "load_pressure": lambda of, c: blocked_port_readings(of, c)["load_pressure"],
    "flow": control_flow,
    "load_flow": load_flow,
}


@pytest.mark.parametrize("kind", VALVES)
def test_derivatives_at_no_pressure(kind):
    of, still, none = valve(kind), jnp.full(ROWS, 2e5), jnp.zeros(ROWS)

    @jax.jit
    def read(supply, load, position):
        points = replace(at(supply, load), position=position)
        return jnp.stack([reading(of, points) for reading in READINGS.values()])

    here = (still, none, jnp.asarray(POSITION))
    one = jnp.ones(ROWS)
    value, forward = jax.jvp(lambda supply: read(supply, *here[1:]), (still,), (one,))
    np.testing.assert_allclose(value[1], 2e5)
    np.testing.assert_array_equal(value[jnp.array([0, 2, 3, 4])], 0.0)
    _, back = jax.vjp(read, *here)
    for index, name in enumerate(READINGS):
        by_supply, by_load, by_position = back(jnp.zeros_like(value).at[index].set(1.0))
        np.testing.assert_allclose(by_supply, forward[index], rtol=1e-9, atol=1e-24, err_msg=name)
        assert jnp.isfinite(by_load).all()
        np.testing.assert_array_equal(by_position, 0.0, err_msg=name)
    differences = (read(still + STEP, *here[1:]) - read(still - STEP, *here[1:])) / (2.0 * STEP)
    scale = np.abs(np.asarray(differences)).max(axis=1, keepdims=True)
    np.testing.assert_allclose(forward / scale, differences / scale, atol=1e-5)
    assert float(forward[0].min()) > 0.0
    second = jax.jvp(lambda s: jax.jvp(lambda supply: read(supply, *here[1:]), (s,), (one,))[1], (still,), (one,))[1]
    assert jnp.isfinite(second).all()


def test_a_load_at_no_pressure_has_its_gain():
    of, still, one = valve("orifice"), jnp.full(ROWS, 2e5), jnp.ones(ROWS)
    read = lambda load: load_flow(of, at(still, load))
    forward = jax.jvp(read, (jnp.zeros(ROWS),), (one,))[1]
    np.testing.assert_allclose(forward, (read(STEP * one) - read(-STEP * one)) / (2.0 * STEP), rtol=1e-5)
    assert float(forward.max()) < 0.0
