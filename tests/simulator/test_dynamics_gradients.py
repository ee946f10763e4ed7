"""Derivatives of a step test: forward and reverse against each other and against finite differences; refusals."""

import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.machines import actuator_of, inputs_of, valve_of
from helpers.quick_compile import quick_compile
from reference.actuator import Machine, Run
from reference.conformance_dynamic import machine_of

from thermohyd.actuator import Actuator
from thermohyd.dynamics.inputs import step_inputs
from thermohyd.dynamics.integrate import Gradient
from thermohyd.dynamics.simulate import simulate_step
from thermohyd.effects.registry import with_effects


NAMES = ("edge_radius", "clearance", "null_bias")
JACK_NAMES = ("spool_frequency", "bulk_modulus_factor", "viscous_friction")
WEIGHTS = np.random.default_rng(0).normal(size=(12, 3))


def machine() -> Machine:
    """A step so small that no edge closes: where one does, its law has a kink, and derivatives taken across it by two
    programs that step a little differently agree to 1e-7 only."""
    base = machine_of("closed_isothermal")
    time = np.linspace(0.0, 0.03, 12)
    full = lambda value: np.full(len(time), value)
    setpoint = np.interp(time, time[[0, 2, 3, 11]], [0.0, 0.0, 1e-4, 1e-4])
    return replace(base, run=Run("setpoint", time, setpoint, full(210e5), full(2e5), full(313.15), full(1000.0)))


def weighted(theta, gradient: Gradient):
    """One number of all readings that the parameters, a dynamic effect and the delay move; order 1 throughout."""
    given = machine()
    valve, jack = valve_of(given), actuator_of(given)
    valve = replace(valve, **{name: getattr(valve, name) * theta[i] for i, name in enumerate(NAMES)})
    jack = replace(jack, **{name: getattr(jack, name) * theta[3 + i] for i, name in enumerate(JACK_NAMES)})
    valve = with_effects(valve, {"spool_delay": 2e-3 * theta[6], "jack_leakage": 2e-12 * theta[7]})
    found = simulate_step(
        valve, jack, inputs_of(given), heat="isothermal", gradient=gradient, rtol=1e-9, atol=1e-9, throw=False
    )
    table = jnp.stack([found.spool_position / 1e-5, found.pressure_a / 1e7, found.piston_velocity / 0.01], axis=1)
    return jnp.sum(table * WEIGHTS)


@pytest.fixture(autouse=True, scope="module")
def quickly():
    with quick_compile():
        yield


def test_forward_reverse_and_finite_differences():
    at = jnp.ones(8)
    forward = np.asarray(jax.jit(jax.jacfwd(lambda theta: weighted(theta, "forward")))(at))
    reverse = np.asarray(jax.jit(jax.grad(lambda theta: weighted(theta, "reverse")))(at))
    value = jax.jit(lambda theta: weighted(theta, "forward"))
    # Steps of 1e-4 leave 1e-8 of curvature and, with runs exact to about 1e-9, 1e-5 of noise.
    steps = 1e-4 * np.eye(8)
    differences = np.array([float(value(at + step) - value(at - step)) / 2e-4 for step in steps])
    size = np.max(np.abs(differences))
    print("apart, as a share of the largest:", np.max(np.abs(forward - reverse)) / size, end=", ")
    print(np.max(np.abs(forward - differences)) / size)
    np.testing.assert_allclose(forward, reverse, atol=1e-9 * size)
    np.testing.assert_allclose(forward, differences, atol=3e-5 * size)


def test_what_cannot_be_run_is_said():
    time = np.array([0.0, 0.01])
    hold = lambda force: step_inputs(
        time, 0.0, "setpoint", supply_pressure=210e5, temperature=313.15, external_force=force
    )
    valve = valve_of(machine())
    with pytest.raises(RuntimeError, match="no equilibrium under the first row"):
        simulate_step(valve, Actuator(), hold(40e3), heat="isothermal")
    with pytest.raises(RuntimeError, match="more than max_steps steps"):
        simulate_step(valve, Actuator(), hold(1e3), heat="isothermal", max_steps=1)
    with pytest.raises(ValueError, match="strictly rise"):
        step_inputs(time * 0.0, 0.0, "setpoint", supply_pressure=210e5, temperature=313.15)


def test_single_precision_is_refused():
    code = (
        "import thermohyd\n"
        "try:\n    thermohyd.simulate_step(None, None, None)\n"
        "except RuntimeError as error:\n    print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.startswith("simulate_step needs double precision")
