"""Coupled balances that have no root answer NaN, row by row, and leave their neighbours and those derivatives alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.flow_balance import coupled_root


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
