"""Innovations: white with variance 1, the inverse Cholesky factor of the covariance, each sweep by itself."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.whitening import whiten, whiten_on_host, whitening_of


KINDS = [NoiseCorrelation(1.0, 0.6), NoiseCorrelation(0.6, 0.9), NoiseCorrelation(0.3, 0.3)]


def covariance(correlation: NoiseCorrelation, sweeps: np.ndarray) -> np.ndarray:
    lag = np.abs(np.arange(len(sweeps))[:, None] - np.arange(len(sweeps))[None, :])
    inside = sweeps[:, None] == sweeps[None, :]
    return np.where(inside, correlation.share * correlation.phi**lag, 0.0) + np.eye(len(sweeps)) * (
        1.0 - correlation.share
    )


def noise(rng: np.random.Generator, correlation: NoiseCorrelation, rows: int) -> np.ndarray:
    phi, share = correlation.phi, correlation.share
    memory = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], rng.standard_normal(rows + 500))[500:]
    return np.sqrt(share) * memory + np.sqrt(1.0 - share) * rng.standard_normal(rows)


@pytest.mark.parametrize("correlation", KINDS)
def test_is_the_inverse_cholesky_factor(correlation):
    sweeps = np.repeat([3, 7, 8], [20, 1, 12])
    factor = np.linalg.cholesky(covariance(correlation, sweeps))
    filter_ = whitening_of(correlation, sweeps, len(sweeps))
    np.testing.assert_allclose(whiten_on_host(filter_, np.eye(33)), np.linalg.inv(factor), atol=1e-12)


@pytest.mark.parametrize("correlation", KINDS)
def test_what_positions_add_to_steep_rows_is_remembered_by_no_other(correlation):
    sweeps = np.repeat([3, 7, 8], [20, 1, 12])
    memory = np.random.default_rng(7).uniform(size=33)
    memory[[5, 6, 25]] = 0.0
    shared = covariance(correlation, sweeps) * np.sqrt(np.outer(memory, memory))
    factor = np.linalg.cholesky(shared - np.diag(np.diag(shared)) + np.eye(33))
    filter_ = whitening_of(correlation, sweeps, 33, memory=memory)
    np.testing.assert_allclose(whiten_on_host(filter_, np.eye(33)), np.linalg.inv(factor), atol=1e-5)
    used = np.ones(33, bool)
    same = whitening_of(correlation, sweeps, 33, used, np.ones(33))
    np.testing.assert_allclose(
        whiten_on_host(same, np.eye(33)), whiten_on_host(whitening_of(correlation, sweeps, 33), np.eye(33))
    )


@pytest.mark.parametrize("correlation", KINDS)
def test_innovations_are_white(correlation):
    n = 20_000
    e = whiten_on_host(whitening_of(correlation, np.zeros(n, int), n), noise(np.random.default_rng(4), correlation, n))
    four_errors = 4.0 / np.sqrt(n)
    assert abs(np.mean(e**2) - 1.0) < four_errors * np.sqrt(2.0)
    for lag in (1, 2, 3, 5, 10):
        assert abs(np.mean(e[lag:] * e[:-lag])) < four_errors


@pytest.mark.parametrize("correlation", [*KINDS, NoiseCorrelation()])
def test_host_and_jax_agree_and_pads_pass(correlation):
    sweeps, padded = np.repeat([0, 1], [30, 25]), 64
    filter_ = whitening_of(correlation, sweeps, padded)
    values = np.random.default_rng(5).standard_normal((3, padded))
    compiled = np.asarray(whiten(filter_, jnp.asarray(values)))
    np.testing.assert_allclose(compiled, whiten_on_host(filter_, values.T).T, atol=1e-13)
    np.testing.assert_array_equal(compiled[:, 55:], values[:, 55:])


def test_sweeps_do_not_leak():
    correlation, sweeps = NoiseCorrelation(0.8, 0.95), np.repeat([0, 1], 20)
    filter_ = whitening_of(correlation, sweeps, 40)
    quiet = np.random.default_rng(6).standard_normal(40)
    loud = np.concatenate([1e9 * quiet[:20], quiet[20:]])
    for white in (whiten_on_host(filter_, loud), np.asarray(whiten(filter_, jnp.asarray(loud)))):
        np.testing.assert_allclose(white[20:], whiten_on_host(filter_, quiet)[20:], rtol=1e-13)


@pytest.mark.parametrize("correlation", [NoiseCorrelation(), NoiseCorrelation(0.0, 0.9), NoiseCorrelation(0.5, 0.0)])
def test_white_noise_is_left_alone(correlation):
    values = np.random.default_rng(7).standard_normal((10, 2))
    np.testing.assert_array_equal(whiten_on_host(whitening_of(correlation, np.zeros(10, int), 10), values), values)


@pytest.mark.parametrize("correlation", KINDS)
def test_rows_left_out_are_no_readings_of_zero(correlation):
    """The rows that stay are whitened as if the others had never been read."""
    sweeps = np.repeat([3, 7, 8], [20, 1, 12])
    used = np.ones(33, dtype=bool)
    used[[4, 5, 6, 20, 21, 30]] = False
    factor = np.linalg.cholesky(covariance(correlation, sweeps)[np.ix_(used, used)])
    found = whiten_on_host(whitening_of(correlation, sweeps, 33, used), np.diag(used.astype(float)))
    np.testing.assert_allclose(found[np.ix_(used, used)], np.linalg.inv(factor), atol=1e-12)
    assert not found[~used].any()
