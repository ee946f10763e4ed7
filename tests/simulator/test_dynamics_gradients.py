"""Derivatives of a step test: forward and reverse against each other and against finite differences."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from helpers.commands import refusal_in_single_precision
from helpers.machines import actuator_of, inputs_of, valve_of
from helpers.quick_compile import quick_jit
from reference.actuator import Machine, Run
from reference.conformance_dynamic import machine_of

from thermohyd.dynamics.integrate import Gradient
from thermohyd.dynamics.simulate import simulate_step
from thermohyd.effects.library import with_effects


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


def bends(setpoint: np.ndarray) -> jax.Array:
    """Changes of slope at every row."""
    slopes = np.diff(setpoint) / np.diff(machine().run.time)
    return jnp.asarray(np.diff([0.0, *slopes, 0.0])[:, None])


STEP = bends(machine().run.command)
TO_AND_FRO = bends(np.array([0.0, *np.tile([1.0, -1.0], 5), 0.0]))  # to and fro


def weighted(theta, tolerance, larger, stroke, gradient: Gradient, swing=0.0):
    """One number of all readings that the parameters, a dynamic effect and the delay move; order 1 throughout.

    stroke [m]: the piston's. swing [m]: of a setpoint that goes to and fro, beside the step.
    """
    given = machine()
    valve, jack = valve_of(given), actuator_of(given)
    valve = replace(valve, **{name: getattr(valve, name) * theta[i] for i, name in enumerate(NAMES)})
    jack = replace(jack, **{name: getattr(jack, name) * theta[3 + i] for i, name in enumerate(JACK_NAMES)})
    jack = replace(jack, piston_stroke=stroke)
    valve = with_effects(valve, {"spool_delay": 2e-3 * theta[6], "jack_leakage": 2e-12 * theta[7]})
    inputs = inputs_of(given)
    command = (jnp.asarray(given.run.time), STEP * larger + TO_AND_FRO * swing)
    inputs = eqx.tree_at(lambda i: (i.command.knots, i.command.bends), inputs, command)
    found = simulate_step(
        valve, jack, inputs, heat="isothermal", gradient=gradient, rtol=tolerance, atol=tolerance, throw=False
    )
    table = jnp.stack([found.spool_position / 1e-5, found.pressure_a / 1e7, found.piston_velocity / 0.01], axis=1)
    return jnp.sum(table * WEIGHTS) / larger


AT = jnp.ones(8)
SWING = 2e-3  # m
# Strokes of the piston [m], which comes to 0.96 mm: without stops in reach and with one on the way.
LONG, SHORT = 50e-3, 1e-3


@quick_jit
def forward(theta, tolerance, larger, stroke=LONG, swing=0.0):
    return jax.jacfwd(weighted)(theta, tolerance, larger, stroke, "forward", swing)


@quick_jit
def plainly(theta, tolerance, larger, stroke=LONG, swing=0.0):
    """The number itself: differences ask for it 64 times, and its program is a small one."""
    return weighted(theta, tolerance, larger, stroke, "forward", swing)


@quick_jit
def reverse(theta, tolerance, larger, stroke=LONG):
    return jax.grad(weighted)(theta, tolerance, larger, stroke, "reverse")


def differences(step: float, larger: float, stroke: float = LONG, swing: float = 0.0) -> np.ndarray:
    number = lambda theta: float(plainly(theta, 1e-11, larger, stroke, swing))
    return np.array([(number(AT + unit) - number(AT - unit)) / (2.0 * step) for unit in step * np.eye(8)])


def test_forward_reverse_and_finite_differences():
    """Forward solves the variational equations, reverse differentiates the steps: they meet as the steps become small."""
    expected = differences(1e-4, 1.0)
    size = np.max(np.abs(expected))
    close = {}
    for tolerance in (1e-9, 1e-11):
        found = np.asarray(forward(AT, tolerance, 1.0))
        close[tolerance] = np.max(np.abs(found - np.asarray(reverse(AT, tolerance, 1.0)))) / size
        print(
            f"at {tolerance}: apart {close[tolerance]:.1e}, from differences", np.max(np.abs(found - expected)) / size
        )
        np.testing.assert_allclose(found, expected, atol=1e-5 * size)
    assert close[1e-9] < 1e-5
    assert close[1e-11] < 2e-7


def test_derivatives_across_kinks():
    """A step so large that edges close on the way."""
    expected = differences(1e-4, 30.0)
    size = np.max(np.abs(expected))
    for tolerance in (1e-7, 1e-9):
        found = np.asarray(forward(AT, tolerance, 30.0))
        print(f"at {tolerance}: from differences", np.max(np.abs(found - expected)) / size)
        np.testing.assert_allclose(found, expected, atol=1e-5 * size)


def test_derivatives_behind_a_blow_on_the_end_stop():
    """The piston runs into its stop on the way to a setpoint behind it, and stays there."""
    # Differences over 1e-5 and 3e-5 are off by 2e-5: a run's steps change with the parameters, and with them its rounding.
    expected = differences(1e-4, 30.0, SHORT)
    size = np.max(np.abs(expected))
    assert not np.allclose(expected, differences(1e-4, 30.0))  # the stop is met
    for tolerance in (1e-8, 1e-10):
        found = np.asarray(forward(AT, tolerance, 30.0, SHORT))
        print(f"at {tolerance}: from differences", np.max(np.abs(found - expected)) / size)
        np.testing.assert_allclose(found, expected, atol=1e-5 * size)


def test_derivatives_across_more_kinks_than_a_block_has_room_for():
    """Edges open and close with every swing of the setpoint: 34 times in the first block of steps, at the loosest tolerance."""
    expected = differences(1e-4, 1.0, swing=SWING)
    size = np.max(np.abs(expected))
    # Without the kinks beyond the sixteenth of a block: 6e-3 and 1e-4.
    for tolerance, bound in ((1e-4, 2e-4), (1e-5, 3e-5)):
        found = np.asarray(forward(AT, tolerance, 1.0, swing=SWING))
        print(f"at {tolerance}: from differences", np.max(np.abs(found - expected)) / size)
        np.testing.assert_allclose(found, expected, atol=bound * size)


def test_single_precision_is_refused():
    said = refusal_in_single_precision("simulate_step(None, None, None)")
    assert said.startswith("simulate_step needs double precision")
