"""Derivatives of a step test: forward and reverse against each other and against finite differences."""

import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from helpers.machines import actuator_of, inputs_of, valve_of
from helpers.quick_compile import quick_jit
from reference.actuator import Machine, Run
from reference.conformance_dynamic import machine_of

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


def test_forward_reverse_and_finite_differences():
    at = jnp.ones(8)
    both = lambda theta: (weighted(theta, "forward"),) * 2
    # One program for the derivatives and, evaluated beside, for their differences.
    along = quick_jit(jax.jacfwd(both, has_aux=True))
    forward = np.asarray(along(at)[0])
    reverse = np.asarray(quick_jit(jax.grad(lambda theta: weighted(theta, "reverse")))(at))
    # Steps of 1e-4 leave 1e-8 of curvature and, with runs exact to about 1e-9, 1e-5 of noise.
    steps = 1e-4 * np.eye(8)
    differences = np.array([float(along(at + step)[1] - along(at - step)[1]) / 2e-4 for step in steps])
    size = np.max(np.abs(differences))
    print("apart, as a share of the largest:", np.max(np.abs(forward - reverse)) / size, end=", ")
    print(np.max(np.abs(forward - differences)) / size)
    np.testing.assert_allclose(forward, reverse, atol=1e-9 * size)
    np.testing.assert_allclose(forward, differences, atol=3e-5 * size)


def test_single_precision_is_refused():
    code = (
        "import thermohyd\n"
        "try:\n    thermohyd.simulate_step(None, None, None)\n"
        "except RuntimeError as error:\n    print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.startswith("simulate_step needs double precision")
