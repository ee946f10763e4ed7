"""Profile, posterior and coverage of one small record against the reference simulator's likelihood on a grid of two parameters.

Two valves, one shape, so one set of programs: a worn edge, where the problem is nearly linear and all must equal the covariance, and a
sharp one, whose radius is heaped up at its limit 0, where the covariance says nothing and all others must equal the grid.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.records import POINTS, synthetic_record
from reference.isothermal import IsothermalRows, simulate
from reference.oil import Oil, walther
from reference.valve import Rows, Valve
from scipy.stats import chi2

from thermohyd.identify.bench.record import StartValue
from thermohyd.identify.fitting.fit import fit_and_fitted
from thermohyd.identify.fitting.outcome import uncertainty_of
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.uncertainty.coverage import coverage_of
from thermohyd.identify.uncertainty.finished_fit import FinishedFit
from thermohyd.identify.uncertainty.posterior import Sampling, posterior_of
from thermohyd.identify.uncertainty.predictions import predictions_of
from thermohyd.identify.uncertainty.profiles import profile_of
from thermohyd.identify.uncertainty.result import ProfileOf
from thermohyd.identify.uncertainty.rows import known_parameter


VALVE = Valve(12e-3, 8e-6, 2.5e-6, 6e-6, 0.68, 90.0, 0.0)
NOISE = {8e-6: 1.0, 0.0: 20.0}  # of that of a good bench
RADIUS, UNDERLAP = "edge_radius", "underlap"


def record_of(radius, prior_std=None):
    held: dict[str, Any] = {name: StartValue(getattr(VALVE, name), fixed=True) for name in
            ("clearance", "discharge_coefficient", "transition_number", "null_bias")}  # fmt: skip
    prior: dict[str, Any] = {} if prior_std is None else {RADIUS: StartValue(8e-6, prior_std=prior_std)}
    made = replace(VALVE, edge_radius=radius)
    return synthetic_record(
        made, np.random.default_rng(5), points=13, noise=NOISE[radius], temperatures=(313.15,), supplies=(210e5,),
        tests=("leakage",), **held, **prior,
    )  # fmt: skip


@cache
def fitted_of(radius, prior_std=None):
    result, fitted = fit_and_fitted(record_of(radius, prior_std), starts=1)
    known = uncertainty_of(fitted)
    # The noise is known: of this size and white, whatever a few dozen residuals look like.
    blocks = {key: replace(b, correlation=NoiseCorrelation(), variance=1.0) for key, b in known.blocks.items()}
    return result, fitted, replace(known, blocks=blocks, inflation=np.ones(2), independent=1e9)


@cache
def posterior(radius):
    _, fitted, known = fitted_of(radius)
    return posterior_of(fitted, known, Sampling(warmup=200, draws=1200, seed=1))


def profile(radius, name):
    _, fitted, known = fitted_of(radius)
    found = profile_of(FinishedFit(fitted, known), name)
    assert isinstance(found, ProfileOf)
    return found


@cache
def grid(radius):
    """(radii, underlaps, chi-square of the reference simulator's readings)."""
    (test,) = fitted_of(radius)[1].tests.values()
    rows = Rows(test.spool_position, test.supply_pressure, test.return_pressure, test.temperature, test.direction)
    fast = IsothermalRows.of(rows, Oil(*walther(POINTS)))
    (channel,) = test.channels
    fitted = fitted_of(radius)[1]
    std = np.sqrt(np.diag(np.linalg.inv(fitted.solution.jacobian.T @ fitted.solution.jacobian)))
    if radius > 0.0:
        radii, underlaps = (
            np.linspace(v - 4.0 * s, v + 4.0 * s, 61) for v, s in zip(fitted.solution.p, std, strict=True)
        )
    else:
        radii, underlaps = np.linspace(0.0, 3.5e-6, 61), np.linspace(4.8e-6, 9.8e-6, 61)
    cost, roots = np.empty((61, 61)), None
    for i, r in enumerate(radii):
        for j, u in enumerate(underlaps):
            p = np.array([r, VALVE.clearance, u, VALVE.discharge_coefficient, VALVE.transition_number, 0.0])
            found, roots = simulate("leakage", fast, 12e-3, p, start=roots)
            cost[i, j] = np.sum(((found - channel.value) / channel.std) ** 2)
    assert np.all(np.concatenate([cost[-1], cost[:, 0], cost[:, -1]]) > cost.min() + 8.0), "the grid is too narrow"
    return radii, underlaps, cost


def quantile(values, weight, share):
    below = np.concatenate([[0.0], np.cumsum(0.5 * (weight[1:] + weight[:-1]))])
    return float(np.interp(share, below / below[-1], values))


@pytest.mark.nightly  # draws
def test_where_the_problem_is_nearly_linear_profile_and_posterior_are_the_covariances():
    result, fitted, _ = fitted_of(8e-6)
    std = np.sqrt(np.diag(np.linalg.inv(fitted.solution.jacobian.T @ fitted.solution.jacobian)))
    for i, name in enumerate(fitted.free):
        value, own = fitted.values[name], posterior(8e-6).parameters[name]
        by_profile = profile(8e-6, name)
        assert by_profile.shape == "bounded"
        assert own.mean == pytest.approx(value, abs=0.25 * std[i])
        assert own.std == pytest.approx(std[i], rel=0.15)
        for level in (0.68, 0.95):
            reach = np.sqrt(chi2.ppf(level, 1))
            for end, side in ((by_profile.at(level).low, -1), (by_profile.at(level).high, 1)):
                assert end == pytest.approx(value + side * reach * std[i], abs=0.12 * reach * std[i])
        row = known_parameter(result, fitted, name, by_profile)
        assert row.verdict == "identified"
        assert row.prior_share == 0.0
        assert row.trades_with is not None


@pytest.mark.nightly  # draws
@pytest.mark.parametrize("radius", [8e-6, 0.0])
def test_profile_and_posterior_are_the_grids(radius):
    radii, underlaps, cost = grid(radius)
    weight = np.exp(-0.5 * (cost - cost.min()))
    for name, values, by_value in ((RADIUS, radii, weight.sum(axis=1)), (UNDERLAP, underlaps, weight.sum(axis=0))):
        own = posterior(radius).parameters[name]
        spread = quantile(values, by_value, 0.84) - quantile(values, by_value, 0.16)
        for level in (0.68, 0.95):
            low, high = (quantile(values, by_value, 0.5 + side * 0.5 * level) for side in (-1, 1))
            # Three standard errors of a quantile in the tail of 1,500 effective draws.
            assert own.at(level).low == pytest.approx(low, abs=0.15 * spread)
            assert own.at(level).high == pytest.approx(high, abs=0.15 * spread)
        least = cost.min(axis=1 if name == RADIUS else 0)
        reached = least - cost.min() <= chi2.ppf(0.95, 1)
        found = profile(radius, name).at(0.95)
        step = values[1] - values[0]
        assert found.low == pytest.approx(values[reached][0], abs=1.5 * step)
        assert found.high == pytest.approx(values[reached][-1], abs=1.5 * step)


def null_leakage(p, temperature):
    rows = Rows(np.zeros(1), np.array([210e5]), np.zeros(1), np.array([temperature]), np.zeros(1))
    return float(simulate("leakage", IsothermalRows.of(rows, Oil(*walther(POINTS))), 12e-3, p)[0][0])


@pytest.mark.nightly  # draws
@pytest.mark.parametrize("radius", [8e-6, 0.0])
def test_intervals_of_a_figure_are_the_grids(radius):
    radii, underlaps, cost = grid(radius)
    _, fitted, known = fitted_of(radius)
    found, notes = predictions_of(FinishedFit(fitted, known), lambda _: None)
    assert not notes
    assert [round(figure.temperature - 313.15, 6) for figure in found] == [-25.0, 0.0, 25.0]
    allowed = np.argwhere(cost - cost.min() <= chi2.ppf(0.95, 1))
    for figure in found:
        leakage = [
            null_leakage(
                np.array(
                    [radii[i], VALVE.clearance, underlaps[j], VALVE.discharge_coefficient, VALVE.transition_number, 0.0]
                ),
                figure.temperature,
            )
            for i, j in allowed
        ]
        assert (figure.name, figure.unit, figure.supply_pressure) == ("null leakage", "m3/s", 210e5)
        spread = max(leakage) - min(leakage)
        assert figure.profile.low == pytest.approx(min(leakage), abs=0.06 * spread)
        assert figure.profile.high == pytest.approx(max(leakage), abs=0.06 * spread)
        if radius > 0.0:  # nearly linear: the covariance says the same
            assert figure.std is not None
            assert figure.ci95 == pytest.approx((figure.profile.low, figure.profile.high), abs=0.06 * spread)


def test_at_its_limit_a_radius_has_an_upper_end_and_no_error_bar():
    result, fitted, _ = fitted_of(0.0)
    by_profile = profile(0.0, RADIUS)
    assert by_profile.shape == "one-sided"
    row = known_parameter(result, fitted, RADIUS, by_profile)
    assert row.verdict == "practically not"
    assert "an upper limit only" in row.why


def test_half_of_the_information_is_a_prior_as_wide_as_the_readings_error():
    _, fitted, _ = fitted_of(8e-6)
    std = float(np.sqrt(np.linalg.inv(fitted.solution.jacobian.T @ fitted.solution.jacobian)[0, 0]))
    assert fitted.free[0] == RADIUS
    result, with_prior, _ = fitted_of(8e-6, std)
    row = known_parameter(result, with_prior, RADIUS)
    assert row.prior_share == pytest.approx(0.5, abs=0.03)
    assert known_parameter(result, with_prior, UNDERLAP).prior_share == pytest.approx(0.0, abs=0.5)


@pytest.mark.nightly  # draws
def test_intervals_hold_the_truth_of_simulated_records_as_often_as_they_say():
    _, fitted, known = fitted_of(8e-6)
    found, failed = coverage_of(FinishedFit(fitted, known), 60, seed=2)
    assert failed == 0
    for name in fitted.free:
        assert found[name].records == 60
        assert found[name].low <= 0.95 <= found[name].high
