"""Linear recursions along rows against a plain loop, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.chain_in_time import along_rows
from thermohyd.numerics import linear_recursion


def plain(keep: np.ndarray, source: np.ndarray) -> np.ndarray:
    keep = np.broadcast_to(keep, source.shape)
    out, y = np.empty_like(source), np.zeros(source.shape[:-1])
    for i in range(source.shape[-1]):
        y = keep[..., i] * y + source[..., i]
        out[..., i] = y
    return out


@pytest.mark.parametrize("rows", [1, 2, 3, 8, 9, 100])
def test_against_a_plain_loop(rows):
    rng = np.random.default_rng(rows)
    keep, source = rng.uniform(-1.0, 1.0, rows), rng.standard_normal((2, 3, rows))
    np.testing.assert_allclose(
        linear_recursion(jnp.asarray(keep), jnp.asarray(source)), plain(keep, source), atol=1e-13
    )


def test_each_lead_may_have_its_own_keep():
    rng = np.random.default_rng(1)
    keep, source = rng.uniform(0.0, 1.0, (2, 20)), rng.standard_normal((2, 20))
    np.testing.assert_allclose(
        linear_recursion(jnp.asarray(keep), jnp.asarray(source)), plain(keep, source), atol=1e-13
    )


@pytest.mark.parametrize("rows", [1, 2, 7, 30])
def test_two_ports_that_follow_each_other(rows):
    rng = np.random.default_rng(rows)
    carried, source = rng.uniform(-0.7, 0.7, (2, 2, rows)), rng.standard_normal((2, rows))
    y, expected = np.zeros(2), []
    for row in range(rows):
        y = carried[..., row] @ y + source[:, row]
        expected.append(y)
    found = along_rows(jnp.asarray(carried), jnp.asarray(source))
    np.testing.assert_allclose(found, np.transpose(expected), atol=1e-13)


def test_nothing_passes_a_keep_of_zero():
    keep = jnp.full(10, 0.9).at[5].set(0.0)
    source = jnp.ones(10).at[:5].set(1e6)
    np.testing.assert_allclose(linear_recursion(keep, source)[5:], plain(np.full(5, 0.9), np.ones(5)), rtol=1e-14)


def test_derivatives_forward_reverse_and_by_differences():
    rng = np.random.default_rng(2)
    keep, source = jnp.asarray(rng.uniform(0.2, 0.95, 13)), jnp.asarray(rng.standard_normal(13))
    forward = jax.jacfwd(linear_recursion, (0, 1))(keep, source)
    reverse = jax.jacrev(linear_recursion, (0, 1))(keep, source)
    step = 1e-6  # balances truncation (step^2) against rounding (1e-16/step)
    for place, (f, r) in enumerate(zip(forward, reverse, strict=True)):
        np.testing.assert_allclose(f, r, rtol=1e-12, atol=1e-14)
        for i in range(13):
            low, high = [keep, source], [keep, source]
            low[place], high[place] = low[place].at[i].add(-step), high[place].at[i].add(step)
            difference = (plain(*map(np.asarray, high)) - plain(*map(np.asarray, low))) / (2 * step)
            np.testing.assert_allclose(f[:, i], difference, rtol=1e-7, atol=1e-8)
