"""Intervals from profiles of chi-square: exact where a profile is known, lopsided, cut off at limits, across valleys."""

import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import solve
from thermohyd.identify.fitting.profile_intervals import covariance_holds, profile_intervals


def line(p, args):
    """A straight line: chi-square is exactly quadratic."""
    x = jnp.linspace(-1.0, 1.0, 20)
    return p[0] + p[1] * x - args


def inverse(p, args):
    """A reading that is 1/p: chi-square rises faster below than above."""
    return jnp.concatenate([(1.0 / p[0] - 1.0)[None] / 0.2, (p[1] - 2.0)[None]])


def valleys(p, args):
    """In the underlap two valleys of nearly the same depth, each with its own value of the other parameter."""
    u = p[0] / 1e-6
    return jnp.stack([jnp.minimum(jnp.abs(u), jnp.abs(u - 3.0) + 0.2), p[1] - jnp.where(u < 1.5, 0.0, 2.0)])


def held(residual, boxes, args=None):
    def solve_held(start, values):
        own = list(boxes)
        for i, value in values.items():
            own[i] = Box(boxes[i].name, value, boxes[i].scale, value, value, held=True)
        return solve(residual, own, args, start)

    return solve_held


def covariance_of(best):
    return np.linalg.inv(best.jacobian.T @ best.jacobian)


def test_a_quadratic_chi_square_gives_the_covariances_interval():
    data = jnp.asarray(np.random.default_rng(1).normal(size=20))
    boxes = [Box("a", 0.1, 1.0, -50.0, 50.0), Box("b", 0.1, 1.0, -50.0, 50.0)]
    best = solve(line, boxes, data)
    covariance = covariance_of(best)
    solve_held = held(line, boxes, data)
    assert covariance_holds(best, boxes, covariance, 1.96, solve_held)
    std = np.sqrt(np.diag(covariance))
    found = profile_intervals(best, boxes, std, np.full(2, 1.96**2), solve_held).intervals
    for i in range(2):
        assert found[i].low == pytest.approx(best.p[i] - 1.96 * std[i], rel=0.02)
        assert found[i].high == pytest.approx(best.p[i] + 1.96 * std[i], rel=0.02)
        assert not found[i].open_low
        assert not found[i].open_high


def test_a_lopsided_chi_square_gives_a_lopsided_interval():
    boxes = [Box("p", 0.9, 1.0, 0.01, 50.0), Box("other", 0.0, 1.0, -50.0, 50.0)]
    best = solve(inverse, boxes)
    solve_held = held(inverse, boxes)
    covariance = covariance_of(best)
    assert not covariance_holds(best, boxes, covariance, 1.96, solve_held)
    rise = np.full(2, 1.96**2)
    found = profile_intervals(best, boxes, np.sqrt(np.diag(covariance)), rise, solve_held).intervals[0]
    assert found.low == pytest.approx(1.0 / (1.0 + 1.96 * 0.2), rel=0.02)
    assert found.high == pytest.approx(1.0 / (1.0 - 1.96 * 0.2), rel=0.03)


def test_an_interval_ends_at_a_limit_and_says_so():
    boxes = [Box("p", 0.9, 1.0, 0.01, 1.2), Box("other", 0.0, 1.0, -50.0, 50.0)]
    best = solve(inverse, boxes)
    covariance = covariance_of(best)
    assert not covariance_holds(best, boxes, covariance, 1.96, held(inverse, boxes))
    rise = np.full(2, 1.96**2)
    found = profile_intervals(best, boxes, np.sqrt(np.diag(covariance)), rise, held(inverse, boxes)).intervals[0]
    assert found.high == 1.2
    assert found.open_high
    assert not found.open_low


def test_the_other_valley_belongs_to_the_interval():
    boxes = [Box("underlap", 0.5e-6, 1e-6, -50e-6, 50e-6), Box("other", 0.0, 1.0, -50.0, 50.0)]
    best = solve(valleys, boxes)
    assert abs(best.p[0]) < 1e-9
    rise = np.full(2, 1.96**2)
    found = profile_intervals(best, boxes, np.array([1e-6, 1.0]), rise, held(valleys, boxes)).intervals[1]
    assert found.low < -1.9
    assert found.high > 3.8  # 2 + 1.95 of the other valley, less than 0.1 of chi-square above this one


def test_a_deeper_optimum_on_the_way_is_handed_back():
    boxes = [Box("underlap", 3.2e-6, 1e-6, -50e-6, 50e-6), Box("other", 2.0, 1.0, -50.0, 50.0)]
    shallow = solve(valleys, boxes)
    assert shallow.p[0] == pytest.approx(3e-6, abs=1e-8)
    found = profile_intervals(shallow, boxes, np.array([1e-6, 1.0]), np.full(2, 1.96**2), held(valleys, boxes))
    assert found.better is not None
    assert found.better.cost < shallow.cost
