"""An effect of amount 0 changes nothing, and its derivative there is finite."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import STROKE, seed_valve

from thermohyd.conditions import Conditions
from thermohyd.effects.library import EFFECTS, with_effects
from thermohyd.static_tests import blocked_port_readings, control_flow, leakage_flow, load_flow


ROWS = 12


def points() -> Conditions:
    """A sweep through null, both ends and a turning point, with a repeated position and the null itself."""
    rng = np.random.default_rng(3)
    position = STROKE * np.array([-1.0, -0.3, -0.02, 0.0, 0.01, 0.01, 0.2, 1.0, 0.5, 0.03, -0.04, -0.5])
    return Conditions(
        position=jnp.asarray(position),
        supply_pressure=jnp.asarray(rng.uniform(60e5, 200e5, ROWS)),
        return_pressure=jnp.asarray(rng.uniform(1e5, 5e5, ROWS)),
        temperature=jnp.asarray(rng.uniform(283.15, 343.15, ROWS)),
        load_pressure=jnp.asarray(rng.uniform(-30e5, 30e5, ROWS)),
        time=jnp.asarray(np.arange(ROWS) * 0.5),
        run=jnp.asarray(np.repeat([0.0, 1.0], ROWS // 2)),
        rate=jnp.asarray(rng.uniform(-1e-5, 1e-5, ROWS)),
    )


def readings(valve, conditions):
    """Every channel: (channels, rows)."""
    blocked = blocked_port_readings(valve, conditions)
    return jnp.stack([*blocked.values(), control_flow(valve, conditions), load_flow(valve, conditions)])


# Not bitwise. These add operations inside the loop that solves the balance, which is compiled and rounds anew:
INSIDE_THE_BALANCE = ("pressure_clearance", "pressure_viscosity", "throttle_heating")
# and these are solved with the ports: blocked and connected ports are left where the plain balance put them, the load
# flow is found once more from a start of its own.
COUPLED = ("flow_saturation", "supply_droop", "return_back_pressure", "cross_port_leakage")
# and these take every row through one more step of a search.
STORED = ("port_compliance_a", "port_compliance_b")
EXACT = tuple(name for name in EFFECTS if name not in (*INSIDE_THE_BALANCE, *COUPLED, *STORED))


@pytest.mark.parametrize(
    "names", [EXACT, INSIDE_THE_BALANCE, COUPLED[:3], COUPLED[3:], STORED], ids=lambda names: names[0]
)
def test_neutral_is_the_ideal_valve(names):
    # Not optimised: two optimised programs may round differently for reasons of their own.
    with quick_compile():
        found = np.asarray(readings(with_effects(seed_valve(underlap=8e-6), dict.fromkeys(names, 0.0)), points()))
    size = np.max(np.abs(ideal_parts()), axis=1, keepdims=True)
    print(names, "differ by", np.max(np.abs(found - ideal_parts()) / size, axis=1))
    if names == EXACT:
        np.testing.assert_array_equal(found, ideal_parts())
    np.testing.assert_array_less(np.abs(found - ideal_parts()) / size, 1e-13)
    if names[0] in COUPLED:
        np.testing.assert_array_less(np.abs(found - ideal_parts())[:-1] / size[:-1], 1e-15)


@functools.cache
def ideal_parts():
    with quick_compile():
        return np.asarray(readings(seed_valve(underlap=8e-6), points()))


def test_derivative_at_neutral_is_finite_with_heat_and_coupling():
    # The largest program there is; test_effects_derivatives.py compares the derivatives of smaller ones.
    names = (*COUPLED, "throttle_heating")

    def leakage(amounts):
        valve = with_effects(seed_valve(underlap=8e-6), dict(zip(names, amounts, strict=True)))
        return leakage_flow(valve, points())

    zero = jnp.zeros(len(names))
    scales = jnp.asarray([EFFECTS[name].scale for name in names])
    with quick_compile():
        slope = np.asarray(jax.jit(lambda z: jax.jvp(leakage, (z,), (scales,))[1])(zero))
    assert np.all(np.isfinite(slope))
