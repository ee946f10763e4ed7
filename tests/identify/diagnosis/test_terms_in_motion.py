"""A term inside a run: fitted with the parameters, its column the derivative, and what is learned predicts what the fit did."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.short_servo import short_servo_problem

from thermohyd.identify.diagnosis.term_fit import FittedTerm, columns_of, fitted_inside
from thermohyd.identify.fitting.library import Library
from thermohyd.identify.fitting.parameters import IN_MOTION
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.predict_motion import as_static, predict_motion
from thermohyd.identify.model.typed_terms import TypedTerm, with_covariance


@pytest.fixture(scope="module")
def problem() -> Problem:
    return short_servo_problem()


@pytest.fixture(scope="module")
def plain(problem) -> Fit:
    return problem.fit()


@pytest.fixture(scope="module")
def fitted(problem, plain) -> FittedTerm:
    """A force on the spool that follows the piston: no parameter does the same."""
    term = TypedTerm("force_on_spool", "velocity", "proportional", (0.0,), -0.3, 0.3, moving=True)
    return fitted_inside(problem, plain, term)


@pytest.mark.nightly  # a whole diagnosis
def test_it_is_fitted_inside_the_run(plain, fitted):
    (lag,), (std,) = fitted.term.coefficients, fitted.std
    assert fitted.fit.chi2 < 0.97 * plain.chi2
    assert fitted.gain == pytest.approx(plain.chi2 - fitted.fit.chi2, rel=1e-6)
    assert abs(lag) > 3.0 * std


def test_its_column_is_the_derivative(fitted):
    term, fit, step = fitted.term, fitted.fit, 0.3 * float(fitted.std[0])
    columns, _ = columns_of(fitted.problem, fit, term)
    moved = []
    for sign in (1.0, -1.0):
        other = replace(term, coefficients=(term.coefficients[0] + sign * step,))
        moved.append(fitted.problem.with_terms(other).evaluate(fit.values, fit.effects).residual)
    difference = 0.5 * (moved[0] - moved[1]) / step
    assert np.max(np.abs(difference - columns[:, 0])) < 0.05 * np.max(np.abs(difference))


@pytest.mark.nightly  # a whole diagnosis
def test_a_term_of_the_last_turn_is_found_and_has_a_derivative(problem, plain):
    """A play of the command, 4 um wide, is a shift by half of it against the way the command went last."""
    with_play = replace(problem, library=Library(("backlash",), {}))
    played = with_play.evaluate(plain.values | {"backlash": 4e-6}, ("backlash",)).residual - plain.residual
    term = TypedTerm("force_on_spool", "direction", "proportional", (-2e-6,), -1.0, 1.0, moving=True)
    with_term = problem.with_terms(term).evaluate(plain.values, ())
    moved = with_term.residual - plain.residual
    assert np.linalg.norm(moved - played) < 0.35 * np.linalg.norm(played)
    columns, _ = columns_of(problem.with_terms(term), with_term, term)
    step, found = 1e-8, []
    for sign in (1.0, -1.0):
        other = replace(term, coefficients=(-2e-6 + sign * step,))
        found.append(problem.with_terms(other).evaluate(plain.values, ()).residual)
    difference = 0.5 * (found[0] - found[1]) / step
    assert np.max(np.abs(difference - columns[:, 0])) < 0.05 * np.max(np.abs(difference))


def test_a_lag_of_the_command_has_a_derivative(problem, plain):
    """Also from 0, where a fit begins, and across the rows where the command bends."""
    for late in (0.0, 1e-3):
        term = TypedTerm("command_lag", "command_rate", "proportional", (late,), -1.0, 1.0, moving=True)
        with_term = problem.with_terms(term).evaluate(plain.values, ())
        columns, _ = columns_of(problem.with_terms(term), with_term, term)
        step, found = 1e-5, []
        for sign in (1.0, -1.0):
            other = replace(term, coefficients=(late + sign * step,))
            found.append(problem.with_terms(other).evaluate(plain.values, ()).residual)
        difference = 0.5 * (found[0] - found[1]) / step
        assert np.max(np.abs(difference - columns[:, 0])) < 0.05 * np.max(np.abs(difference))


def test_the_learned_model_predicts_what_the_fit_did(problem, fitted):
    record, fit, joint = problem.record, fitted.fit, fitted.joint
    assert joint is not None
    count = len(fitted.names)
    term = with_covariance(fitted.term, fitted.names, joint)
    parameters = {n: plan.start for n, plan in problem.plans.items() if n not in IN_MOTION}
    model = Model(
        record.valve, record.oil, parameters, fitted.names, joint[:count, :count], learned=(term,), actuator=record.actuator,
        dynamics={n: fit.values[n] for n in IN_MOTION},
    )  # fmt: skip
    assert as_static(model).learned == ()
    predicted = predict_motion(model, record)
    for (name, channel), rows in problem.rows().items():
        value, std = predicted[name, channel]
        read = problem.tests[name].channel(channel).value
        noise = problem.noise.std[name, channel]
        np.testing.assert_allclose((value - read) / noise, fit.residual[rows], atol=1e-6)
        assert np.all(np.isfinite(std))
        assert np.max(std) > 0.0
