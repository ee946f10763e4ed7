"""A whole profile: nested intervals, its shape, and where another parameter comes to its limit, on functions whose profile is known."""

import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import LeastSquaresResult, solve
from thermohyd.identify.fitting.profile_intervals import profile_curve
from thermohyd.identify.uncertainty.profiles import as_profile
from thermohyd.identify.uncertainty.result import LEVELS


RISES = (0.99, 3.84, 6.63)  # of chi-square with one degree of freedom at these levels


def curves(p, args):
    """chi-square = args 0 (p0 - args 1)^2 + (p1 - p0)^2 25 + args 2 (1/p0 - 1)^2."""
    strength, centre, lopsided = args
    return jnp.stack(
        [jnp.sqrt(strength) * (p[0] - centre), 5.0 * (p[1] - p[0]), jnp.sqrt(lopsided) * (1.0 / p[0] - 1.0)]
    )


def profiled(args, boxes):
    data = jnp.asarray(args)

    def held(start, values):
        own = list(boxes)
        for i, value in values.items():
            own[i] = Box(boxes[i].name, value, boxes[i].scale, value, value, held=True)
        return solve(curves, own, data, start)

    best = solve(curves, boxes, data)
    found = profile_curve(best, boxes, 0, 0.3, RISES, held)
    assert not isinstance(found, LeastSquaresResult)
    return best, as_profile("p", found, LEVELS, RISES)


def wide(start=1.0):
    return [Box("p", start, 1.0, 0.05, 50.0), Box("q", start, 1.0, -50.0, 50.0)]


def test_of_a_parabola_every_interval_is_the_covariances():
    best, profile = profiled((4.0, 3.0, 0.0), wide())
    assert profile.shape == "bounded"
    for interval, rise in zip(profile.intervals, RISES, strict=True):
        assert interval.low == pytest.approx(3.0 - np.sqrt(rise) / 2.0, rel=5e-3)
        assert interval.high == pytest.approx(3.0 + np.sqrt(rise) / 2.0, rel=5e-3)
    values = [point.value for point in profile.points]
    assert values == sorted(values)
    assert float(best.p[0]) in values
    assert not any(point.pressed for point in profile.points)
    for point in profile.points:
        assert point.rise == pytest.approx(4.0 * (point.value - 3.0) ** 2, abs=1e-3)


def test_of_a_reading_of_the_inverse_every_interval_is_lopsided_as_its_formula_says():
    _, profile = profiled((0.0, 1.0, 25.0), wide())
    for interval, rise in zip(profile.intervals[:2], RISES[:2], strict=True):
        assert interval.low == pytest.approx(1.0 / (1.0 + np.sqrt(rise) / 5.0), rel=0.02)
        assert interval.high == pytest.approx(1.0 / (1.0 - np.sqrt(rise) / 5.0), rel=0.02)


def test_intervals_are_nested():
    _, profile = profiled((2.0, 0.4, 1.0), wide())
    first, second, third = profile.intervals
    assert third.low <= second.low <= first.low < first.high <= second.high <= third.high


def test_at_a_limit_a_profile_is_one_sided():
    boxes = [Box("p", 1.0, 1.0, 0.5, 50.0), Box("q", 1.0, 1.0, -50.0, 50.0)]
    best, profile = profiled((4.0, 0.2, 0.0), boxes)
    assert best.p[0] == 0.5
    assert profile.shape == "one-sided"
    assert profile.at(0.95).open_low
    assert profile.at(0.95).low == 0.5
    # chi-square rises from the limit on, not from where it would be least
    assert profile.at(0.95).high == pytest.approx(0.2 + np.sqrt(0.3**2 + RISES[1] / 4.0), rel=0.02)


def test_what_no_reading_depends_on_is_flat():
    _, profile = profiled((0.0, 1.0, 0.0), [Box("p", 1.0, 1.0, 0.5, 5.0), Box("q", 1.0, 1.0, -50.0, 50.0)])
    assert profile.shape == "flat"
    assert profile.seen < 1e-6
    assert (profile.at(0.99).low, profile.at(0.99).high) == (0.5, 5.0)


def test_points_where_another_parameter_is_at_its_limit_are_marked_and_chi_square_rises_faster_there():
    boxes = [Box("p", 3.0, 1.0, 0.05, 50.0), Box("q", 3.0, 1.0, -50.0, 3.2)]
    _, profile = profiled((1.0, 3.0, 0.0), boxes)
    for point in profile.points:
        assert point.pressed == (("q",) if point.value > 3.2 else ())
    free, pressed = 3.0 - profile.at(0.95).low, profile.at(0.95).high - 3.0
    assert free == pytest.approx(np.sqrt(RISES[1]), rel=0.02)
    ends = np.roots([26.0, -2.0 * 25.0 * 0.2, 25.0 * 0.04 - RISES[1]])  # x^2 + 25 (x - 0.2)^2 = rise
    assert pressed == pytest.approx(float(ends.max()), rel=0.02)
