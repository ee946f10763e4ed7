"""Error bars: SciPy's for white noise, honest coverage for correlated noise, and words where there is none."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from scipy.special import stdtrit

from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import solve
from thermohyd.identify.fitting.uncertainty import Block, covariance_of
from thermohyd.identify.noise.correlation import NoiseCorrelation, correlated_sum, noise_correlation


WHITE = NoiseCorrelation()
NONE = slice(0, 0)


def one_block(rows: int, variance: float = 1.0) -> list[Block]:
    return [Block(slice(None), np.zeros(rows, dtype=int), WHITE, variance)]


def std_of(jacobian: np.ndarray, blocks: list[Block] | None = None, active: np.ndarray | None = None) -> np.ndarray:
    n, p = jacobian.shape
    names = tuple("abcdef"[:p])
    active = np.zeros(p, dtype=int) if active is None else active
    return np.sqrt(np.diag(covariance_of(jacobian, names, active, blocks or one_block(n), NONE).matrix))


@pytest.mark.parametrize("absolute", [True, False])
def test_white_noise_gives_what_curve_fit_gives(absolute: bool) -> None:
    rng = np.random.default_rng(5)
    x, sigma = np.linspace(0.0, 4.0, 60), rng.uniform(0.01, 0.03, 60)
    y = 2.0 * np.exp(-0.7 * x) + 0.3 + sigma * rng.normal(size=60)
    model = lambda x, a, b, c: a * np.exp(-b * x) + c
    best, expected = scipy.optimize.curve_fit(
        model, x, y, [1.0, 1.0, 0.0], sigma, absolute_sigma=absolute, xtol=1e-14, ftol=1e-14
    )

    def residual(p: jax.Array, data: tuple[jax.Array, ...]) -> jax.Array:
        x, y, sigma = data
        return (p[0] * jnp.exp(-p[1] * x) + p[2] - y) / sigma

    boxes = [Box("a", 1.0, 1.0, 0.0), Box("b", 1.0, 1.0, 1e-3, 1e3, logarithmic=True), Box("c", 0.0, 1.0)]
    result = solve(residual, boxes, (jnp.asarray(x), jnp.asarray(y), jnp.asarray(sigma)))
    variance = 1.0 if absolute else result.cost / (60 - 3)
    found = covariance_of(result.jacobian, ("a", "b", "c"), result.active, one_block(60, variance), NONE)
    np.testing.assert_allclose(result.p, best, rtol=1e-7)
    # curve_fit differentiates by differences: 1e-5 is what its Jacobian is good for.
    np.testing.assert_allclose(found.matrix, expected, rtol=1e-5, atol=1e-5 * np.max(np.abs(expected)))


def stationary(rng: np.random.Generator, length: int, noise: NoiseCorrelation) -> np.ndarray:
    """AR(1) plus white noise of unit variance, one draw at a time so that it owes nothing to the code under test."""
    shocks = rng.normal(size=length) * np.sqrt(1.0 - noise.phi**2)
    slow = np.empty(length)
    slow[0] = rng.normal()
    for i in range(1, length):
        slow[i] = noise.phi * slow[i - 1] + shocks[i]
    return np.sqrt(noise.share) * slow + np.sqrt(1.0 - noise.share) * rng.normal(size=length)


def coverage(noise: NoiseCorrelation, sweeps: int, length: int, repeats: int) -> float:
    """Share of 95 % intervals of a four-parameter linear model, a sweep's curve, that hold the truth."""
    rng = np.random.default_rng(20)
    x, n = np.tile(np.linspace(-1.0, 1.0, length), sweeps), sweeps * length
    sweep = np.repeat(np.arange(sweeps), length)
    jacobian = np.stack([np.exp(-((4 * x) ** 2)), np.tanh(4 * x), np.ones(n), x**2], axis=1)
    project = np.linalg.pinv(jacobian)
    inside = []
    for _ in range(repeats):
        reading = np.concatenate([stationary(rng, length, noise) for _ in range(sweeps)])
        error = project @ reading
        residual = reading - jacobian @ error
        correlation = noise_correlation(residual, sweep, 4)
        variance = float(np.sum(residual**2)) / (n - 4)
        std = std_of(jacobian, [Block(slice(None), sweep, correlation, variance)])
        inside.append(np.abs(error) < stdtrit(max(n / correlation.inflation - 4, 1.0), 0.975) * std)
    return float(np.mean(inside))


@pytest.mark.parametrize(
    ("share", "phi", "sweeps", "length"),
    [
        (0.0, 0.0, 6, 100),
        (1.0, 0.5, 6, 100),
        (1.0, 0.8, 6, 100),
        (0.5, 0.9, 6, 100),
        (0.1, 0.95, 6, 100),
        (1.0, 0.7, 20, 15),
    ],
)
def test_intervals_cover_the_truth_under_correlated_noise(share: float, phi: float, sweeps: int, length: int) -> None:
    found = coverage(NoiseCorrelation(share, phi), sweeps, length, repeats=200)
    # 800 intervals that share their data in fours: two standard errors of the share are 0.025.
    print(f"share {share}, phi {phi}, {sweeps} x {length}: coverage {found:.3f}")
    assert 0.92 <= found <= 0.99


def test_taking_correlated_noise_for_white_would_not_cover() -> None:
    """The check can fail: the same intervals without the correlation hold the truth far too seldom."""
    rng = np.random.default_rng(20)
    jacobian = np.ones((300, 1))
    errors = [np.mean(stationary(rng, 300, NoiseCorrelation(1.0, 0.8))) for _ in range(300)]
    assert np.mean(np.abs(errors) < 1.96 * std_of(jacobian)) < 0.6


def test_the_recursion_equals_the_dense_sum() -> None:
    rng = np.random.default_rng(1)
    columns, sweeps = rng.normal(size=(50, 3)), rng.integers(0, 4, 50)
    noise = NoiseCorrelation(0.7, 0.9)
    dense = np.eye(50)
    for s in range(4):
        rows = np.flatnonzero(sweeps == s)  # rows of a sweep may be interleaved with others'
        steps = np.abs(np.subtract.outer(np.arange(len(rows)), np.arange(len(rows))))
        dense[rows[:, None], rows] = np.where(steps == 0, 1.0, noise.share * noise.phi**steps)
    np.testing.assert_allclose(
        correlated_sum(columns, sweeps, noise), columns.T @ dense @ columns, rtol=1e-12, atol=1e-12
    )


def test_blocks_and_exact_rows_add_up() -> None:
    rng = np.random.default_rng(2)
    jacobian = rng.normal(size=(41, 2))
    blocks = [Block(slice(0, 25), np.zeros(25), WHITE, 4.0), Block(slice(25, 40), np.zeros(15), WHITE, 1.0)]
    found = covariance_of(jacobian, ("a", "b"), np.zeros(2), blocks, slice(40, 41)).matrix
    bread = np.linalg.inv(jacobian.T @ jacobian)
    weight = np.concatenate([np.full(25, 4.0), np.ones(16)])
    np.testing.assert_allclose(found, bread @ (jacobian.T * weight) @ jacobian @ bread, rtol=1e-12)


def test_a_dead_parameter_and_one_at_its_bound_say_why_and_the_rest_keep_theirs() -> None:
    rng = np.random.default_rng(3)
    jacobian = rng.normal(size=(30, 4))
    jacobian[:, 1] = 0.0
    found = covariance_of(jacobian, ("a", "b", "c", "d"), np.array([0, 0, -1, 0]), one_block(30), NONE)
    assert found.why == {
        1: "no reading depends on b",
        2: "at its lower bound: held there while the others are estimated",
    }
    np.testing.assert_allclose(
        found.matrix[np.ix_([0, 3], [0, 3])], np.linalg.inv(jacobian[:, [0, 3]].T @ jacobian[:, [0, 3]])
    )
    assert np.all(found.matrix[1] == 0.0)
    assert np.all(found.matrix[:, 2] == 0.0)


def test_a_flat_direction_takes_its_members_error_bars_and_leaves_the_others_theirs() -> None:
    """b and c act only through b + 2c: a's error bar must be the one with that combination free, not held."""
    rng = np.random.default_rng(4)
    effect = rng.normal(size=(30, 2))
    jacobian = np.column_stack([effect[:, 0], effect[:, 0] + effect[:, 1], 2.0 * (effect[:, 0] + effect[:, 1])])
    found = covariance_of(jacobian, ("a", "b", "c"), np.zeros(3), one_block(30), NONE)
    assert set(found.why) == {1, 2}
    assert all("flat direction" in words and "b" in words and "c" in words for words in found.why.values())
    expected = np.linalg.inv(jacobian[:, :2].T @ jacobian[:, :2])[0, 0]
    assert found.matrix[0, 0] == pytest.approx(expected, rel=1e-10)


def test_units_do_not_matter() -> None:
    rng = np.random.default_rng(6)
    jacobian, units = rng.normal(size=(40, 3)), np.array([1e-9, 1.0, 1e12])
    np.testing.assert_allclose(std_of(jacobian / units), std_of(jacobian) * units, rtol=1e-12)


def test_white_residuals_are_mostly_called_white() -> None:
    rng = np.random.default_rng(7)
    sweeps = np.repeat(np.arange(5), 60)
    called = [noise_correlation(rng.normal(size=300), sweeps, 0.0).share == 0.0 for _ in range(200)]
    assert np.mean(called) > 0.95
