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
    "film that keeps heat": ("lubrication", {"throttle_heating": 0.5}),
    "lines and a path between": (
        "orifice",
        {"supply_droop": 3e9, "return_back_pressure": 3e9, "cross_port_leakage": 1e-14},
    ),
}


def valve(kind: str):
    law, effects = VALVES[kind]
    return with_effects(replace(seed_valve(), edge_law=law), effects)


def at(supply, load=None) -> Conditions:
    full = lambda value: jnp.full(ROWS, value)
    return Conditions(jnp.asarray(POSITION), supply, full(2e5), full(313.15), load_pressure=load)


@pytest.mark.parametrize("kind", VALVES)
def test_derivatives_at_no_pressure(kind):
    of, still = valve(kind), jnp.full(ROWS, 2e5)

    @jax.jit
    def read(supply, load, position):
        points = replace(at(supply, load), position=position)
        closed = blocked_port_readings(of, points)
        # What has effects takes long to compile.
        more = () if of.effects else (control_flow(of, points), load_flow(of, points))
        return jnp.stack(
            [closed["pressure_a"], closed["pressure_b"], closed["leakage_flow"], closed["supply_flow"], *more]
        )

    here, one = (jnp.zeros(ROWS), jnp.asarray(POSITION)), jnp.ones(ROWS)
    value, forward = jax.jvp(lambda supply: read(supply, *here), (still,), (one,))
    np.testing.assert_allclose(value[:2], 2e5)
    np.testing.assert_array_equal(value[2:], 0.0)
    _, back = jax.vjp(read, still, *here)
    units = jnp.broadcast_to(jnp.eye(len(value))[:, :, None], (len(value), *value.shape))
    by_supply, by_load, by_position = jax.vmap(back)(units)
    np.testing.assert_allclose(by_supply, forward, rtol=1e-9, atol=1e-24)
    np.testing.assert_array_equal(by_position, 0.0)
    assert jnp.isfinite(by_load).all()
    differences = (read(still + STEP, *here) - read(still - STEP, *here)) / (2.0 * STEP)
    scale = np.abs(np.asarray(differences)).max(axis=1, keepdims=True)
    np.testing.assert_allclose(forward / scale, differences / scale, atol=1e-5)
    assert float(forward[2].min()) > 0.0


def test_a_load_at_no_pressure_has_its_gain():
    of, still, one = valve("orifice"), jnp.full(ROWS, 2e5), jnp.ones(ROWS)
    read = lambda load: load_flow(of, at(still, load))
    forward = jax.jvp(read, (jnp.zeros(ROWS),), (one,))[1]
    np.testing.assert_allclose(forward, (read(STEP * one) - read(-STEP * one)) / (2.0 * STEP), rtol=1e-5)
    assert float(forward.max()) < 0.0


def test_second_derivatives_are_finite():
    of, still, one = valve("orifice"), jnp.full(ROWS, 2e5), jnp.ones(ROWS)
    slope = lambda supply: jax.jvp(lambda s: control_flow(of, at(s)), (supply,), (one,))[1]
    assert jnp.isfinite(jax.jvp(slope, (still,), (one,))[1]).all()
