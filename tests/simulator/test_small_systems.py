"""Linear systems of a few unknowns: as LAPACK solves them, with their derivatives, and programs in time are free of it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.machines import actuator_of, inputs_of, valve_of
from jax.test_util import check_grads
from reference.conformance_dynamic import machine_of

from thermohyd.dynamics.integrate import Gradient
from thermohyd.dynamics.linear import frequency_response
from thermohyd.dynamics.simulate import simulate_step
from thermohyd.small_systems import inverse, inverses, solved


@pytest.mark.parametrize("n", [1, 2, 7, 10])
@pytest.mark.parametrize("kind", [float, complex])
def test_it_solves_what_lapack_solves(n, kind):
    draw = np.random.default_rng(n)
    matrix, right = (
        draw.normal(size=(*size, 2)) @ np.array([1.0, 1j if kind is complex else 0.0]) for size in ((40, n, n), (40, n))
    )
    matrix, right = (part if kind is complex else part.real for part in (matrix, right))
    found = solved(jnp.asarray(matrix), jnp.asarray(right))
    worst = np.linalg.cond(matrix) * 1e-14
    error = np.abs(np.asarray(found) - np.linalg.solve(matrix, right[..., None])[..., 0]).max(axis=1)
    assert np.all(error <= worst * (1.0 + np.abs(found).max(axis=1)))


def test_a_pivot_of_nothing_is_exchanged_and_a_singular_matrix_gives_no_numbers():
    np.testing.assert_array_equal(solved(jnp.array([[0.0, 1.0], [2.0, 0.0]]), jnp.array([2.0, 3.0])), [1.5, 2.0])
    assert not np.isfinite(np.asarray(solved(jnp.ones((2, 2)), jnp.array([1.0, 2.0])))).all()


def test_derivatives_forward_and_reverse():
    draw = np.random.default_rng(3)
    matrix, right = jnp.asarray(draw.normal(size=(5, 5))), jnp.asarray(draw.normal(size=5))
    as_arrays = lambda function: lambda *args: function(*map(jnp.asarray, args))  # it takes differences of NumPy's
    check_grads(as_arrays(solved), (matrix, right), order=2)
    check_grads(as_arrays(inverse), (matrix + 5.0 * jnp.eye(5),), order=1)


def test_many_inverses_side_by_side():
    matrices = np.eye(24) + 0.1 * np.random.default_rng(0).normal(size=(7, 24, 24))
    found = np.moveaxis(np.asarray(inverses(jnp.asarray(np.moveaxis(matrices, 0, -1)))), -1, 0)
    np.testing.assert_allclose(found @ matrices, np.broadcast_to(np.eye(24), matrices.shape), atol=1e-14)


def test_no_program_of_a_machine_in_time_calls_lapack():
    """Two of them at once would wait for each other's threads for ever: a step test, with its derivatives either way, a response."""
    given = machine_of("closed_isothermal")
    valve, jack, inputs = valve_of(given), actuator_of(given), inputs_of(given)

    def last_position(friction: jax.Array, gradient: Gradient) -> jax.Array:
        moved = replace(jack, viscous_friction=friction)
        return simulate_step(valve, moved, inputs, heat="isothermal", gradient=gradient, throw=False).piston_position[
            -1
        ]

    def ratio(friction: jax.Array) -> jax.Array:
        moved = replace(jack, viscous_friction=friction)
        return frequency_response(
            valve, moved, inputs, jnp.array([10.0, 150.0]), output="piston_velocity", heat="isothermal", throw=False
        ).amplitude_ratio[0]

    programs = {
        "forward": jax.jacfwd(lambda f: last_position(f, "forward")),
        "reverse": jax.grad(lambda f: last_position(f, "reverse")),
        "response": jax.jacfwd(ratio),
    }
    for name, program in programs.items():
        text = jax.jit(program).lower(jnp.asarray(2000.0)).as_text()
        assert "lapack" not in text, name
    assert "lapack" in jax.jit(jnp.linalg.inv).lower(jnp.eye(3)).as_text()  # it would be seen
