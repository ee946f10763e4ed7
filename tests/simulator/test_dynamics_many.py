"""Many step tests at once against each alone."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.commands import refusal_in_single_precision
from helpers.machines import actuator_of, inputs_of, valve_of
from helpers.quick_compile import QUICKEST, quick_jit
from reference.actuator import Machine, Run
from reference.conformance_dynamic import machine_of

from thermohyd import simulate_many
from thermohyd.dynamics.batch import over_batch
from thermohyd.dynamics.integrate import NO_EQUILIBRIUM
from thermohyd.dynamics.simulate import simulate_step
from thermohyd.effects.library import with_effects


READINGS = ("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity", "temperature_a")
TOLERANCE = 1e-8
# Times the actuator's external force; the third is beyond what the supply pressure holds.
FORCES = np.array([1.0, 1.3, 400.0, 0.7, 1.1])


def machine() -> Machine:
    base = machine_of("closed_isothermal")
    time = np.linspace(0.0, 0.02, 9)
    full = lambda value: np.full(len(time), value)
    setpoint = np.interp(time, time[[0, 2, 3, 8]], [0.0, 0.0, 5e-4, 5e-4])
    return replace(base, run=Run("setpoint", time, setpoint, full(210e5), full(2e5), full(313.15), full(0.0)))


def inputs():
    return replace(inputs_of(machine()), forced=False)


def of(force):
    """(valve, actuator) under an external force, other parameters along with it."""
    given = machine()
    valve, jack = valve_of(given), actuator_of(given)
    valve = replace(valve, edge_radius=valve.edge_radius * (1.0 + 0.1 * jnp.tanh(force)))
    return valve, replace(jack, external_force=1000.0 * force, bulk_modulus_factor=1.0 + 0.02 * jnp.tanh(force))


@pytest.fixture(scope="module")
def together():
    """In two chunks of three, the last one padded."""
    valves, jacks = jax.vmap(of)(jnp.asarray(FORCES))
    run = lambda throw: simulate_many(
        valves,
        jacks,
        inputs(),
        heat="isothermal",
        rtol=TOLERANCE,
        atol=TOLERANCE,
        chunk=3,
        throw=throw,
        compiler_options=QUICKEST,
    )
    return run


def test_equal_to_each_alone(together):
    found = together(False)
    alone = quick_jit(
        lambda force: simulate_step(
            *of(force), inputs(), heat="isothermal", rtol=TOLERANCE, atol=TOLERANCE, throw=False
        )
    )
    for row, force in enumerate(FORCES):
        single = alone(force)
        assert int(single.failure) == int(found.failure[row])
        for name in READINGS:
            expected = np.asarray(getattr(single, name))
            own = np.asarray(getattr(found, name))
            assert own.shape == (len(FORCES), found.time.shape[1])
            # Not to rounding: at rest the estimated error is rounding itself, and so is what the next step makes of it.
            np.testing.assert_allclose(own[row], expected, rtol=1e-7, atol=1e-7 * np.max(np.abs(expected)))


def test_effects_in_many():
    """A jack of unequal sides, a play with a state of its own, air, flow forces. (Lines and walls fit too, and take minutes to
    compile.)"""
    areas = {"piston_area": None, "piston_area_a": 13e-4, "piston_area_b": 9e-4}
    volumes = {"chamber_volume": None, "chamber_volume_a": 55e-6, "chamber_volume_b": 40e-6}
    given = machine()
    given = replace(given, jack=replace(given.jack, **areas, **volumes))
    effects = {"backlash": 2e-6, "entrained_air": 0.01, "flow_force": 1e-7}

    def one(factor):
        valve = with_effects(valve_of(given), {name: amount * factor for name, amount in effects.items()})
        return valve, replace(actuator_of(given), external_force=1000.0 * factor)

    factors = jnp.array([0.5, 1.0, 1.5])
    valves, jacks = jax.vmap(one)(factors)
    step = replace(inputs_of(given), forced=False)
    run = {"heat": "isothermal", "rtol": TOLERANCE, "atol": TOLERANCE, "throw": False}
    found = simulate_many(valves, jacks, step, compiler_options=QUICKEST, **run)
    alone = quick_jit(lambda factor: simulate_step(*one(factor), step, **run))
    for row, factor in enumerate(factors):
        single = alone(factor)
        for name in READINGS:
            expected = np.asarray(getattr(single, name))
            own = np.asarray(getattr(found, name))[row]
            np.testing.assert_allclose(own, expected, rtol=1e-6, atol=1e-6 * np.max(np.abs(expected)))


def test_an_impossible_scenario_in_the_middle(together):
    found = together(False)
    assert found.failure.tolist() == [0, 0, NO_EQUILIBRIUM, 0, 0]
    assert np.all(np.isnan(found.pressure_a[2]))
    assert np.all(np.isfinite(np.delete(np.asarray(found.pressure_a), 2, axis=0)))
    with pytest.raises(RuntimeError, match="scenario 2: no equilibrium"):
        together(True)


def test_stacks_must_fit():
    valves, _ = jax.vmap(of)(jnp.ones(2))
    _, jacks = jax.vmap(of)(jnp.ones(3))
    with pytest.raises(ValueError, match="same axis of scenarios"):
        simulate_many(valves, jacks, inputs())
    with pytest.raises(ValueError, match="in_axes"):
        simulate_many(valves, jacks, inputs(), in_axes=(1, 0, None))


def test_single_precision_is_refused():
    said = refusal_in_single_precision("simulate_many(None, None, None)")
    assert said.startswith("simulate_many needs double precision")


def test_batch_of_any_program():
    """What the vector fields do not use today as well: loops, products, branches, comparisons, indexing."""

    def function(x, y, shared):
        total = jax.lax.fori_loop(0, 3, lambda i, s: s * 0.5 + x[i], y)
        picked = jax.lax.dynamic_slice(x, (1,), (2,))
        mixed = jnp.where(x > 0.0, x @ shared, jnp.cumsum(x)) + jnp.eye(4)[2] * y + jnp.max(x) - jnp.stack([y, y, y, y])
        turned = jnp.concatenate([x[::-1], jnp.sort(x), jnp.clip(x, -0.5, y), jnp.pad(picked, 1)])
        slope = jax.jvp(lambda x: jnp.sum(jnp.square(x) * shared[0]) / y, (x,), (np.array([1.0, 0.0, 0.0, 2.0]),))[1]
        return (
            total,
            mixed.reshape(2, 2),
            turned,
            slope,
            jnp.sum(shared, axis=1),
            jax.lax.cond(y > 0, jnp.sin, jnp.cos, y),
        )

    draw = np.random.default_rng(0).normal
    x, y, shared = jnp.asarray(draw(size=(5, 4))), jnp.asarray(draw(size=5)), jnp.asarray(draw(size=(4, 4)))
    same_as_vmap(function, x, y, shared)


def test_a_primitive_that_nobody_listed_is_left_to_vmap():
    """Equal shapes in and out, and yet every number depends on its neighbours: a window, a running logarithm, an FFT."""

    def function(x, y, shared):
        window = jax.lax.reduce_window(x, 0.0, jax.lax.add, (3,), (1,), "SAME")
        return window * y, jax.lax.cumlogsumexp(x), jnp.real(jnp.fft.fft(x)), shared[0] + x

    draw = np.random.default_rng(1).normal
    same_as_vmap(function, *(jnp.asarray(draw(size=size)) for size in ((5, 4), 5, (4, 4))))


def same_as_vmap(function, x, y, shared):
    expected = jax.vmap(function, in_axes=(0, 0, None))(x, y, shared)
    found = over_batch(function, [x.T, y, shared], [True, True, False], 5)
    for one, entries in zip(expected, found, strict=True):
        own = [np.broadcast_to(np.asarray(entry), (5,)) for entry in entries.ravel()]
        np.testing.assert_allclose(np.stack(own), np.reshape(one, (5, -1)).T, rtol=1e-13, atol=1e-14)
