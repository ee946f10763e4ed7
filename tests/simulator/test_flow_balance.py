"""Coupled balances that have no root answer NaN, row by row, and leave their neighbours and those derivatives alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.flow_balance import coupled_root, falling_root, state_at_root


def solved(height):
    """Roots of z^2 + height = 0 beside those of z^3 + height = 0, a row per height."""
    return coupled_root(lambda z: jnp.stack([z[0] ** 2 + height, z[1] ** 3 + height]), jnp.full((2, 4), 0.7))


def test_rows_without_a_root_are_not_a_number():
    height = jnp.array([-1.0, 1.0, -4.0, 1e-3])
    found = np.asarray(solved(height))
    np.testing.assert_allclose(found[:, [0, 2]], [[1.0, 2.0], [1.0, 4.0 ** (1 / 3)]], rtol=1e-14)
    assert np.all(np.isnan(found[:, [1, 3]]))


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_their_neighbours_keep_their_derivatives(mode):
    height = jnp.array([-1.0, 1.0, -4.0, 1e-3])
    slopes = np.asarray(mode(lambda h: solved(h)[0])(height))
    np.testing.assert_allclose(slopes[[0, 2]][:, [0, 2]], np.diag([-0.5, -0.25]), rtol=1e-14)


def test_a_row_ends_where_it_would_alone():
    """Rows that are done wait for the last one without moving."""
    height = jnp.array([-1.0, -4.0, -1e-6, -0.49])
    together = np.asarray(solved(height))
    for i in range(4):
        alone = np.asarray(solved(jnp.full(4, height[i])))[:, 0]
        np.testing.assert_allclose(together[:, i], alone, rtol=1e-15)


HEIGHT, FACTOR = jnp.asarray([1.0, 2.0, 3.0]), jnp.asarray(2.0)


def test_derivatives_of_a_state_are_those_of_the_root_that_it_is_at():
    at_root = lambda a, b: state_at_root(lambda q: (a - q - q**3, b * q**2), jnp.zeros(3))
    behind = lambda a, b: b * falling_root(lambda q: a - q - q**3, jnp.zeros(3)) ** 2
    for of in (at_root, behind):
        np.testing.assert_allclose(of(HEIGHT, FACTOR), FACTOR * behind(HEIGHT, jnp.ones(())), rtol=1e-15)
    total = lambda of: lambda a: jnp.sum(of(a, FACTOR))
    for derivative in (jax.grad, jax.jacfwd, jax.hessian):
        found, expected = (derivative(total(of))(HEIGHT) for of in (at_root, behind))
        np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_what_moves_the_state_alone_leaves_the_root():
    state = lambda b: state_at_root(lambda q: (HEIGHT - q - q**3, {"root": q, "square": b * q**2}), jnp.zeros(3))
    for derivative in (jax.jacfwd, jax.jacrev):
        found = derivative(state)(FACTOR)
        np.testing.assert_array_equal(found["root"], 0.0)
        np.testing.assert_allclose(found["square"], state(FACTOR)["root"] ** 2, rtol=1e-15)
