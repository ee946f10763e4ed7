"""Smooth variations of a model quantity: none in noise, the planted one first, and learned as it was planted."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.records import POINTS
from helpers.small_bench import VALVE, small_record
from helpers.small_diagnosis import DRIFT, MIDDLE, opened, small_case
from reference.oil import Oil, walther
from reference.valve import Rows

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.diagnosis.left_over import (
    CurvesBeside,
    learn,
    misfit_left,
    smooth_block,
    term_columns,
    variations_of,
)
from thermohyd.identify.model.learned_terms import LearnedTerm, term_values


def test_noise_asks_for_none():
    case = small_case("nothing")
    assert variations_of(case.problem, case.base) == ()


def test_the_planted_one_comes_first():
    case = small_case("outside")
    found = variations_of(case.problem, case.base, most=5)
    assert (found[0].quantity, found[0].variable) == ("null_bias", "temperature")
    assert all(variation.p_value <= 1e-3 for variation in found)
    gains = [variation.chi2_gain for variation in found]
    assert gains[0] == max(gains)
    assert len(variations_of(case.problem, case.base, most=1)) == 1


def overshooting(rows: Rows) -> np.ndarray:
    """A discharge coefficient that overshoots by 1.2 % around a flow number of the conditions."""
    oil = Oil(*walther(POINTS))
    nu = oil.mu(rows.supply_pressure, rows.temperature) / oil.rho(rows.supply_pressure, rows.temperature)
    gap = np.abs(rows.spool_position - VALVE.null_bias) + VALVE.underlap
    number = 2.0 * gap / nu * np.sqrt(rows.supply_pressure / 850.0)
    return VALVE.discharge_coefficient * (1.0 + 0.012 * np.exp(-(np.log(number / 300.0) ** 2)))


def flattened(record: BenchRecord) -> BenchRecord:
    """The same with a flow meter that reads 1 % less at 20 l/min, by the square of the flow."""
    test = record.tests["flow_gain"]
    [channel] = test.channels
    read = channel.value * (1.0 - 0.01 * (channel.value * 6e4 / 20.0) ** 2)
    return replace(record, tests={**record.tests, test.name: replace(test, channels=(replace(channel, value=read),))})


@pytest.mark.parametrize("what", ["a quantity that varies", "a sensor that bends"])
def test_what_goes_with_one_quantity_is_a_misfit_where_many_curves_see_too_little(what):
    """A hidden record whose discharge coefficient overshot, 11 noise units in all, had been called consistent."""
    record = small_record(valve={"discharge_coefficient": overshooting}, seed=10)
    case = opened(record if what == "a quantity that varies" else flattened(small_record(seed=11)))
    block = smooth_block(case.problem, len(case.base.residual))
    assert misfit_left(case.problem, case.base, block).p_value < 1e-5 < CurvesBeside.of(case.base)(block).p_value


def test_curve_and_band_are_those_of_the_coefficients():
    best = variations_of(small_case("outside").problem, small_case("outside").base)[0]
    scaled = (best.variable_values - best.centre) / best.reach
    np.testing.assert_allclose(best.curve, np.polynomial.legendre.legval(scaled, best.coefficients), atol=1e-15)
    assert scaled[0] == pytest.approx(-1.0)
    assert scaled[-1] == pytest.approx(1.0)
    assert np.all(best.band >= 0.0)
    planted = DRIFT * (best.variable_values - MIDDLE)
    deviation = (best.curve - planted) - np.mean(best.curve - planted)
    assert np.abs(deviation).max() < 0.1 * np.ptp(planted)


def test_columns_of_a_term_are_its_differences():
    case = small_case("outside")
    values = case.base.values
    for quantity, size in (("null_bias", 1e-6), ("clearance", 1.0), ("viscosity", 1.0)):
        term = lambda c, q=quantity: LearnedTerm(q, "temperature", MIDDLE, 30.0, (0.0, *c), 9e-6, 1.5e-6)
        columns = term_columns(case.problem.with_terms(term((0.0, 0.0))), case.base, term((0.0, 0.0)))
        for i in range(2):
            h = 1e-4 * size * np.eye(2)[i]
            up, down = (case.problem.with_terms(term(tuple(s * h))).evaluate(values).residual for s in (1.0, -1.0))
            expected = (up - down) / 2e-4  # absolute terms have columns per micron
            np.testing.assert_allclose(columns[:, i], expected, atol=1e-4 * np.abs(expected).max(), err_msg=quantity)


def test_learning_ends_where_the_truth_is():
    case = small_case("outside")
    best = variations_of(case.problem, case.base)[0]
    problem, fit, term = learn(case.problem, case.base, best)
    assert problem.terms == (term,)
    assert fit.chi2 < 1.2 * len(fit.residual) < case.base.chi2
    test = case.fitted.tests["pressure_gain"]
    made = term_values(term, test, case.problem.record.oil)
    planted = DRIFT * (test.temperature - MIDDLE)
    np.testing.assert_allclose(made - made.mean(), planted - planted.mean(), atol=0.1e-6)
    assert case.problem.terms == ()


def test_a_term_is_constant_beyond_what_was_seen():
    term = LearnedTerm("null_bias", "temperature", MIDDLE, 10.0, (0.0, 1e-6))
    test = small_case("outside").fitted.tests["leakage"]
    values = term_values(term, test, small_case("outside").problem.record.oil)
    assert values.min() == pytest.approx(-1e-6)
    assert values.max() == pytest.approx(1e-6)
