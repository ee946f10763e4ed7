"""Local minima between kinks: the search is set down on the other side, and a minimum on a kink is believed."""

import jax.numpy as jnp
import numpy as np
from helpers.small_diagnosis import small_case

from thermohyd.identify.fitting import problem
from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import solve
from thermohyd.identify.fitting.starts import basin_hopping, on_a_kink


MICRON = 1e-6


def valleys(p, args):
    """Two valleys in the underlap, at 2 and 6 um, the second the deeper; the other parameter is plain."""
    u = p[0] / MICRON
    return jnp.stack([jnp.minimum(jnp.abs(u - 2.0) + 1.0, jnp.abs(u - 6.0)) + 0.5, p[1] - 3.0])


def kinked(p, args):
    """Lowest at 1 um, where the slope jumps and does not vanish."""
    u = p[0] / MICRON - 1.0
    scatter = jnp.asarray(np.resize([3.0, -3.0], 40))  # of the other readings, which do not move
    return jnp.concatenate([jnp.stack([2.0 + jnp.abs(u), 2.0 - 0.2 * u, p[1] - 3.0, 0.1 * p[1]]), scatter])


BOXES = [Box("underlap", 1.0 * MICRON, MICRON, -20 * MICRON, 20 * MICRON), Box("other", 0.0, 1.0)]


def test_the_deeper_valley_is_found_from_the_wrong_one():
    first = solve(valleys, BOXES)
    assert abs(first.p[0] / MICRON - 2.0) < 0.2
    best = basin_hopping(
        first, ("underlap", "other"), lambda start, enough: solve(valleys, BOXES, None, start, enough=enough)
    )
    assert abs(best.p[0] / MICRON - 6.0) < 0.2
    assert best.cost < first.cost


def test_a_narrow_valley_at_a_zero_lap_is_found_from_far():
    """No step from the wide one at 10.2 um ends in it."""

    def two(p, args):
        u = p[0] / MICRON
        return jnp.stack([jnp.minimum(2.0 * jnp.abs(u - 0.3), 1.5 + 0.1 * jnp.abs(u - 10.2)) + 0.5, p[1] - 3.0])

    solve_from = lambda start, enough: solve(two, BOXES, None, start, enough=enough)
    first = solve_from([10.0 * MICRON, 0.0], np.inf)
    assert abs(first.p[0] / MICRON - 10.2) < 0.2
    assert abs(basin_hopping(first, ("underlap", "other"), solve_from).p[0] / MICRON - 0.3) < 0.2
    near = basin_hopping(first, ("underlap", "other"), solve_from, places=())
    assert abs(near.p[0] / MICRON - 10.2) < 0.2


def test_a_limit_is_left_where_no_slope_says_that_there_is_more():
    """As of a transition number: at 1 every edge is turbulent, and stays so."""

    def flat_from_afar(p, args):
        off = p[0] - 60.0
        return jnp.stack([1.0 - jnp.exp(-((off / 15.0) ** 2)) + 1e-3 * p[0] / 60.0, p[1] - 3.0])

    boxes = [Box("transition_number", 1.0, 30.0, 1.0, 1e4), Box("other", 0.0, 1.0)]
    solve_from = lambda start, enough: solve(flat_from_afar, boxes, None, start, enough=enough)
    stuck = solve_from([1.0, 0.0], np.inf)
    assert stuck.p[0] == 1.0
    assert stuck.active[0] == -1
    names = ("transition_number", "other")
    assert basin_hopping(stuck, names, solve_from) is stuck
    left = basin_hopping(stuck, names, solve_from, usual={"transition_number": 80.0})
    assert abs(left.p[0] - 60.0) < 1.0


def test_without_the_underlap_there_is_no_basin_to_hop_to():
    first = solve(valleys, BOXES)
    assert basin_hopping(first, ("clearance", "other"), lambda start, enough: first) is first


def test_a_minimum_on_a_kink_is_believed_and_said_to_be_one():
    end = solve(kinked, BOXES, None, [3.0 * MICRON, 0.0])
    assert not end.converged
    assert end.exhausted
    believed = on_a_kink(end)
    assert believed.converged
    assert "kink" in believed.message
    assert abs(believed.p[0] / MICRON - 1.0) < 1e-3


def test_a_steep_end_is_not_taken_for_a_kink():
    end = solve(kinked, BOXES)
    steep = type(end)(**{**end.__dict__, "relative_offset": 3.0})
    assert on_a_kink(steep) is steep
    endless = type(end)(**{**end.__dict__, "exhausted": False})
    assert on_a_kink(endless) is endless
    assert np.isfinite(end.cost)


def test_hops_of_a_diagnosis_go_as_far_as_its_other_refits(monkeypatch):
    """They know the cost that they must promise, and stop where they can be compared: not after a step."""
    case = small_case("nothing")
    asked = []

    def noted(*args, **limits):
        asked.append((limits["tolerance"], limits["enough"]))
        return solve(*args, **limits)

    monkeypatch.setattr(problem, "solve", noted)
    fit = case.problem.fit(start=case.base.values, hop_basins=True)
    tolerances, enough = zip(*asked, strict=True)
    assert max(tolerances) <= problem.CLOSE_TO_COMPARE
    assert sum(np.isfinite(enough)) >= 2
    assert max(e for e in enough if np.isfinite(e)) < 2.0 * fit.chi2
