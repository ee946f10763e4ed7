"""Derivatives: forward = reverse = finite differences, at random points and where the law has its seams."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.valves import STROKE, random_conditions, random_parameters, seed_oil, seed_valve, temperature_at, valve_of
from hypothesis import given, settings, strategies as st

from thermohyd.conditions import operating_points
from thermohyd.edge import SERIES, MeteringEdge, at_opening, mass_flow, tanhc
from thermohyd.oil import at_temperature
from thermohyd.static_tests import (
    control_flow,
    flow_pressure_gain,
    leakage_flow,
    load_flow,
    load_pressure,
    pressure_gain,
)


TESTS = {"leakage": leakage_flow, "pressure_gain": load_pressure, "flow_gain": control_flow, "load_flow": load_flow}
SCALE = np.array([10e-6, 3e-6, 10e-6, 0.7, 100.0, 5e-6])


@functools.cache
def compiled(test: str, warm: bool):
    """A test's readings, and their forward and reverse Jacobian in the scaled parameters: two compiled functions."""

    def reading(z, eta, conditions, unit):
        return TESTS[test](valve_of(z * SCALE, eta if warm else None), conditions) / unit

    return quick_jit(reading), quick_jit(lambda *args: (jax.jacfwd(reading)(*args), jax.jacrev(reading)(*args)))


def agree(test, eta, values, conditions, step=1e-4, rtol=1e-6):
    """Forward, reverse and central differences (Richardson: fourth order) of a test's readings at a point of order one.

    The step of 1e-4 with fourth-order differences leaves about 1e-12 of rounding and 1e-14 of truncation.
    """
    reading, jacobians = compiled(test, eta is not None)
    heat, z = jnp.asarray(eta or 0.0), jnp.asarray(values / SCALE)
    unit = jnp.max(jnp.abs(reading(z, heat, conditions, jnp.asarray(1.0))))
    forward, reverse = (np.asarray(a) for a in jacobians(z, heat, conditions, unit))
    columns = []
    for e in np.eye(z.size):
        low, high = (
            (reading(z + s * e, heat, conditions, unit) - reading(z - s * e, heat, conditions, unit)) / (2 * s)
            for s in (step, 2 * step)
        )
        columns.append(np.asarray((4 * low - high) / 3))
    numeric = np.stack(columns, axis=-1)
    # A parameter that a reading does not depend on has a derivative of pure rounding: readings are of order one, so 1e-4.
    size = np.maximum(np.max(np.abs(numeric), axis=0, keepdims=True), 1e-4)
    assert np.all(np.isfinite(forward))
    np.testing.assert_array_less(np.abs(forward - reverse) / size, 1e-10)
    np.testing.assert_array_less(np.abs(forward - numeric) / size, rtol)


# One isothermal case: with heat the same law is passed, and more.
@pytest.mark.parametrize(("test", "eta"), [("flow_gain", None), *((test, 0.6) for test in TESTS)])
def test_random_points_and_seams(test, eta):
    rng = np.random.default_rng(5)
    for _ in range(3):
        agree(test, eta, random_parameters(rng), random_conditions(rng, 40, load=True))
    # Null, both ends of the stroke and beyond, overlapped and underlapped, thin and very thick oil.
    for underlap in (15e-6, -10e-6):
        for centistokes in (30, 4000):
            x = jnp.asarray(np.resize([0.0, STROKE, -STROKE, 2 * STROKE], 40))
            c = operating_points(x, supply_pressure=210e5, temperature=temperature_at(centistokes), load_pressure=20e5)
            agree(test, eta, np.array([15e-6, 2e-6, underlap, 0.7, 100.0, 0.3e-6]), c)


def edge_of(radius=5e-6, clearance=2e-6):
    a = jnp.asarray
    return MeteringEdge(a(12e-3), a(radius), a(clearance), a(0.0), a(0.7), a(100.0))


def flow_through(z):
    """Mass flow [kg/s] over opening [10 um] and pressure drop [bar]."""
    oil = at_temperature(seed_oil(), jnp.asarray(313.15))
    return mass_flow(at_opening(edge_of(), z[0] * 1e-5), oil, z[1] * 1e5, jnp.asarray(1e7))


@pytest.mark.parametrize("opening", [-2.0, -0.5, 0.5, 2.0])
def test_no_pressure_drop(opening):
    point = jnp.asarray([opening, 0.0])
    forward, reverse = jax.jacfwd(flow_through)(point), jax.jacrev(flow_through)(point)
    step = 1e-7
    numeric = (flow_through(point.at[1].set(step)) - flow_through(point.at[1].set(-step))) / (2 * step)
    assert float(forward[0]) == 0.0 == float(reverse[0])
    assert float(forward[1]) == pytest.approx(float(numeric), rel=1e-6)
    assert float(reverse[1]) == pytest.approx(float(numeric), rel=1e-6)


@pytest.mark.parametrize("drop", [-50.0, 1.0, 100.0])
def test_no_opening(drop):
    # The land starts at u = 0, where the slope jumps: both modes give the mean of the sides, as a central difference.
    point = jnp.asarray([0.0, drop])
    forward, reverse = jax.jacfwd(flow_through)(point), jax.jacrev(flow_through)(point)
    step = 1e-7
    numeric = (flow_through(point.at[0].set(step)) - flow_through(point.at[0].set(-step))) / (2 * step)
    assert float(forward[0]) == pytest.approx(float(reverse[0]), rel=1e-12)
    assert float(forward[0]) == pytest.approx(float(numeric), rel=2e-6)


def test_tanhc_is_smooth_across_the_series():
    y = jnp.asarray([0.0, 1e-300, 1e-12, 0.0199999, 0.02, 0.0200001, 1.0, 1e4, 1e12])
    s = np.sqrt(np.asarray(y))
    np.testing.assert_allclose(np.asarray(tanhc(y))[1:], np.tanh(s[1:]) / s[1:], rtol=4e-16)
    slope = jax.vmap(jax.grad(tanhc))(y)
    assert float(slope[0]) == pytest.approx(-1 / 3)
    assert float(slope[3]) == pytest.approx(float(slope[5]), rel=1e-6)
    assert np.all(np.isfinite(np.asarray(jax.vmap(jax.grad(jax.grad(tanhc)))(y))))


def test_derivatives_of_tanhc_on_both_sides_of_the_series():
    """Its rule is a closed form; the series, and far out the plain derivatives of 1/sqrt y, say what is right."""
    slope, bend = (jax.vmap(f) for f in (jax.grad(tanhc), jax.grad(jax.grad(tanhc))))
    series, near = np.polynomial.Polynomial(SERIES), np.array([0.0, 1e-3, 0.0199999, 0.0200001, 0.025])
    np.testing.assert_allclose(slope(jnp.asarray(near)), series.deriv(1)(near), rtol=1e-12)
    np.testing.assert_allclose(bend(jnp.asarray(near)), series.deriv(2)(near), rtol=1e-10)
    far = np.array([1e4, 1e12])
    np.testing.assert_allclose(slope(jnp.asarray(far)), -0.5 * far**-1.5, rtol=1e-14)
    np.testing.assert_allclose(bend(jnp.asarray(far)), 0.75 * far**-2.5, rtol=1e-14)


def test_second_derivatives_of_a_gain():
    c = operating_points(jnp.asarray([1e-6, 8e-6]), supply_pressure=70e5, temperature=300.0)

    def gain(temperature):
        return pressure_gain(seed_valve(1.0), eqx.tree_at(lambda c: c.temperature, c, temperature))

    slope = quick_jit(lambda t: jax.jvp(gain, (t,), (jnp.ones_like(t),))[1])(c.temperature)
    at = quick_jit(gain)
    numeric = (at(c.temperature + 0.01) - at(c.temperature - 0.01)) / 0.02
    np.testing.assert_allclose(np.asarray(slope), np.asarray(numeric), rtol=1e-6)


def test_flow_pressure_gain_is_the_ratio_of_the_other_two_at_null():
    # K_QP = K_QX / K_PX along the blocked-port line, exact where the load flow vanishes (Merritt, section 5-3).
    c = operating_points(0.0, supply_pressure=210e5, temperature=313.15)
    valve = seed_valve()
    loaded = eqx.tree_at(lambda c: c.load_pressure, c, jnp.zeros(1), is_leaf=lambda leaf: leaf is None)

    @jax.jit
    def all_gains(x):
        slope = jax.jvp(lambda x: load_flow(valve, eqx.tree_at(lambda c: c.position, loaded, x)), (x,), (jnp.ones(1),))[
            1
        ]
        return slope[0] / pressure_gain(valve, c)[0], flow_pressure_gain(valve, c)[0]

    ratio, gain = all_gains(c.position)
    assert float(gain) == pytest.approx(float(ratio), rel=1e-6)


unit_interval = st.floats(0.0, 1.0, allow_nan=False)


@settings(max_examples=100)
@given(*([unit_interval] * 9), st.booleans())
def test_no_nan_anywhere_in_the_box(r, c, u, cq, lam, x, ps, pl, t, heat):
    def to(low, high, share):
        return low + (high - low) * share

    half = 0.5 * STROKE
    values = [to(0, 200e-6, r), to(0.05e-6, 50e-6, c), to(-half, half, u), to(0.05, 2, cq), to(1, 1e4, lam), 0.0]
    conditions = operating_points(
        to(-2 * STROKE, 2 * STROKE, x),
        supply_pressure=to(1e5, 350e5, ps),
        temperature=to(233.15, 393.15, t),
        load_pressure=to(-1.0, 1.0, pl) * to(1e5, 350e5, ps),
    )
    reading, slope = _all_readings(jnp.asarray(values), jnp.asarray(float(heat)), conditions)
    assert np.all(np.isfinite(np.asarray(reading)))
    assert np.all(np.isfinite(np.asarray(slope)))


@jax.jit
def _all_readings(values, eta, conditions):
    def of(p):
        valve = eqx.tree_at(lambda v: v.heat_retention, valve_of(p), eta, is_leaf=lambda leaf: leaf is None)
        return jnp.concatenate([TESTS[name](valve, conditions) for name in TESTS])

    return of(values), jax.jacfwd(of)(values)
