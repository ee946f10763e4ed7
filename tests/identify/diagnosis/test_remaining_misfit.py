"""Where a misfit remains: sizes of curves, the choice by runs left out, and error bars that hold the truth."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_fit, linear_problem
from helpers.short_servo import short_servo_problem
from helpers.small_bench import REACH, VALVE, conditions_only
from helpers.small_diagnosis import small_case, small_diagnosis

from thermohyd.identify.diagnosis import conclusion
from thermohyd.identify.diagnosis.diagnose import diagnose_case
from thermohyd.identify.diagnosis.remaining_misfit import (
    MOST_CURVES,
    Beside,
    Remaining,
    _fitted,
    _on_paper,
    curves_of,
    errors_on_paper,
    kernel_curves,
    left_out_errors,
    likeliest_sizes,
    remaining_misfit,
    runs_left_out,
)
from thermohyd.identify.fitting.discrepancy import Discrepancy
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_solution import gls_covariance, misfit_scale
from thermohyd.identify.noise.correlation import NoiseCorrelation


def test_a_discrepancy_whitens_by_the_inverse_root_of_its_covariance() -> None:
    generator = np.random.default_rng(3)
    columns = generator.normal(size=(12, 4)) * [0.0, 0.1, 2.0, 30.0]
    values = generator.normal(size=(5, 12))
    got = Discrepancy(columns).whitened(values)
    covariance = np.eye(12) + columns @ columns.T
    assert got @ got.T == pytest.approx(values @ np.linalg.solve(covariance, values.T), rel=1e-10)
    assert Discrepancy(0.0 * columns).whitened(values) == pytest.approx(values, abs=0.0)


@pytest.mark.parametrize(("length", "count"), [(0.05, 24), (0.15, 12), (0.5, 6)])
def test_curves_have_unit_variance_and_the_kernels_correlation(length: float, count: int) -> None:
    place = np.linspace(0.0, 1.0, 101)
    curves = kernel_curves(place, length, count)
    covariance = curves @ curves.T
    assert np.diag(covariance) == pytest.approx(1.0, abs=0.12)  # what the points between which it is laid miss
    assert np.diag(covariance).mean() == pytest.approx(1.0, abs=0.07)
    away = np.sqrt(3.0) * 0.1 / length
    seen = np.mean(np.diag(covariance, 10))
    assert seen == pytest.approx((1.0 + away) * np.exp(-away), abs=0.01)


def test_many_short_sweeps_share_curves() -> None:
    """Supply pressures that are read with noise cut a sweep into hundreds."""
    tests = {name: conditions_only(name) for name in REACH}
    tests = {name: replace(test, run=np.arange(test.rows)) for name, test in tests.items()}
    problem = linear_problem(NoiseCorrelation(), tests)
    rows = sum(test.rows * len(test.channels) for test in tests.values())
    for columns in curves_of(problem, 0.05, rows):
        assert columns.shape[1] <= MOST_CURVES
        assert np.isfinite(columns).all()


def test_sizes_of_curves_are_found_beside_parameters_that_take_a_part_of_them() -> None:
    generator = np.random.default_rng(5)
    place = np.linspace(0.0, 1.0, 400)
    curves = [
        kernel_curves(place, 0.05, 24),
        np.roll(kernel_curves(place, 0.05, 24), 200, axis=0),
        kernel_curves(place, 0.15, 12),
    ]
    truth, found = np.array([25.0, 4.0, 0.0]), []
    columns, which = np.concatenate(curves, axis=1), np.repeat([0, 1, 2], [24, 24, 12])
    nuisance = np.stack([np.ones(400), place], axis=1)
    for _ in range(20):
        coefficients = np.sqrt(truth)[which] * generator.normal(size=60)
        fit = linear_fit(columns @ coefficients + generator.normal(size=400) + 30.0 * place, nuisance)
        padded = np.concatenate([columns, np.zeros((len(fit.residual) - 400, 60))])
        found.append(likeliest_sizes(fit, padded, which, np.ones(3)))
    assert np.exp(np.mean(np.log(found), axis=0)[:2]) == pytest.approx(truth[:2], rel=0.3)
    assert np.median(found, axis=0)[2] < 0.5


@pytest.mark.nightly  # a whole diagnosis
def test_error_bars_beside_a_misfit_hold_what_the_model_misses() -> None:
    result = small_diagnosis("outside")
    assert {(found.test, found.channel) for found in result.discrepancy} == {
        (c.test, c.channel) for c in result.after.channels
    }
    assert all(found.std >= 0.0 and 0.0 <= found.of_each_sweep <= 1.0 for found in result.discrepancy)
    assert "readings count as known to" in result.summary()
    assert [found["channel"] for found in result.to_dict()["discrepancy"]] == [f.channel for f in result.discrepancy]
    for name, estimate in result.after.parameters.items():
        if estimate.std:
            assert abs(estimate.value - getattr(VALVE, name)) < 4.0 * estimate.std, name


def test_nothing_is_added_to_the_error_where_nothing_remains() -> None:
    result = small_diagnosis("pilot")
    assert result.discrepancy == ()
    assert result.to_dict()["discrepancy"] == []


@pytest.mark.nightly  # a whole diagnosis
def test_weights_whose_fit_ends_at_no_optimum_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the real valve they once predicted runs left out best, with parameters that no search had settled on."""
    case = small_case("outside")
    found = remaining_misfit(case.problem, case.base)
    assert found.weighed.discrepancy is not None
    fit = Problem.fit

    def ends_nowhere(self, effects=(), start=None, **how):
        return replace(fit(self, effects, start, **how), converged=not how.get("hop_basins"))

    monkeypatch.setattr(Problem, "fit", ends_nowhere)
    again = remaining_misfit(case.problem, case.base)
    assert again.believed.length == found.believed.length
    assert again.weighed.discrepancy is None
    assert again.fit is case.base


@pytest.mark.nightly  # a whole diagnosis
def test_weights_that_predict_worse_than_the_ideal_valve_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    judged, asked = conclusion.held_out_figures, []

    def weighed_beside_the_misfit(problem, fit, *say):
        found = remaining_misfit(problem, fit, *say)
        assert found.believed.discrepancy is not None
        asked.append(fit)
        return replace(found, weighed=found.believed)

    def worse_with_these_weights(*of):
        found, remaining = judged(*of), of[-2]
        beside = isinstance(remaining, Remaining) and remaining.weighed.discrepancy is not None
        return replace(found, after=found.before + 1.0) if beside else found

    monkeypatch.setattr(conclusion, "remaining_misfit", weighed_beside_the_misfit)
    monkeypatch.setattr(conclusion, "held_out_figures", worse_with_these_weights)
    result = diagnose_case(small_case("outside"))
    assert result.held_out is not None
    assert result.held_out.after <= result.held_out.before
    for name, estimate in result.after.parameters.items():
        assert estimate.value == asked[0].values[name]
    assert result.discrepancy


def test_one_gauss_newton_step_predicts_runs_left_out_about_as_refits_do() -> None:
    case = small_case("outside")
    beside, _ = _on_paper(case.problem, case.base, 0.15)
    again, _ = _fitted(case.problem, case.base, 0.15)
    shown = np.asarray(again.sizes) > 1.0
    assert np.asarray(beside.sizes)[shown] == pytest.approx(np.asarray(again.sizes)[shown], rel=0.5)
    parts = runs_left_out(case.problem.tests)
    alone = Beside(case.base, misfit_scale(case.problem, case.base))
    white = case.problem.with_noise(case.problem.noise.white).evaluate(case.base.values)
    seen = replace(white, free=case.base.free, active=case.base.active)
    on_paper, refitted = errors_on_paper(case.problem, alone, seen, parts), left_out_errors(case.problem, alone, parts)
    assert on_paper == pytest.approx(refitted, rel=0.3)


def test_what_a_model_of_motion_misses_is_a_part_of_the_error() -> None:
    problem = short_servo_problem()
    plain = problem.fit()
    found = remaining_misfit(problem, plain)
    assert found.believed.discrepancy is not None
    assert {(c.test, c.channel) for c in found.channels} == set(problem.rows())
    priors = len(problem.parameters)
    noise_alone = gls_covariance(plain, misfit_scale(problem, plain), priors)
    alive = noise_alone.alive  # without pressures the oil's stiffness ends at a limit
    assert len(alive) >= 3
    held = found.by_noise(problem, plain).covariance(plain, priors).matrix
    ratio = np.diag(held)[alive] / np.diag(noise_alone.matrix)[alive]
    assert np.all(ratio > 0.0)
    assert np.exp(np.mean(np.log(ratio))) > 1.0


def test_curves_in_motion_go_by_the_time_within_each_run() -> None:
    problem = short_servo_problem()
    key, place = next(iter(problem.rows().items()))
    shared, own = list(curves_of(problem, 0.5, len(problem.fit().residual)))[:2]
    run = problem.tests[key[0]].run
    first, second = (shared[place][run == code] for code in np.unique(run)[:2])
    rows = min(len(first), len(second))
    assert first[:rows] == pytest.approx(second[:rows], rel=0.1, abs=0.05)
    of_first = own[place][run == np.unique(run)[0]]
    assert np.any(of_first != 0.0, axis=0).sum() == own.shape[1] // len(np.unique(run))
