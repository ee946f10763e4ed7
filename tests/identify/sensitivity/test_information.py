"""Information of measurements against a direct computation; designs against exhaustive search."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
from reference import static_tests
from reference.oil import Oil, walther
from reference.valve import Rows, Valve

from thermohyd.identify.fitting.parameters import OF_THE_EDGES
from thermohyd.identify.sensitivity.curves import curve_slopes
from thermohyd.identify.sensitivity.factors import factors_of
from thermohyd.identify.sensitivity.next_test import (
    Measurements,
    ReadingNoise,
    covariance_of,
    d_optimal_points,
    fisher_information,
    marginal_stds,
    next_tests,
    shares,
    sweeps,
)
from thermohyd.identify.sensitivity.settings import Settings
from thermohyd.identify.sensitivity.source import seed_model, subject_of_model
from thermohyd.identify.sensitivity.study import information_study
from thermohyd.identify.sensitivity.varied import valve_of_model


MODEL = seed_model()
NOISE = {"leakage": 1e-9, "pressure_gain": 2e4, "flow_gain": 5e-7}
STEPS = dict(zip(OF_THE_EDGES, (1e-10, 1e-11, 1e-10, 1e-5, 1e-3, 1e-10), strict=True))


@pytest.fixture(scope="module")
def study():
    subject = replace(subject_of_model(MODEL, Settings()), noise=ReadingNoise(NOISE, "stated"))
    factors = factors_of(MODEL, 313.15, 70e5)
    share = np.linspace(-1.0, 1.0, 21)
    curves = curve_slopes(
        valve_of_model(MODEL),
        factors,
        213e-6 * share * np.abs(share),
        temperatures=subject.temperatures,
        supply_pressures=subject.supply_pressures,
    )
    return information_study(subject, factors, curves)


def test_fisher_information_is_that_of_the_reference_simulator(study):
    m = study.measurements
    keep = np.flatnonzero((m.temperature == 313.15) & (m.supply_pressure == 70e5))
    assert len(keep) == 3 * 21
    part = m.at(keep)
    oil = Oil(*walther([[-40.0, 4000.0], [70.0, 30.0]]))
    columns = np.zeros((len(keep), len(OF_THE_EDGES)))
    nominal = {name: MODEL.parameters[name] for name in OF_THE_EDGES}
    for test, std in NOISE.items():
        rows = np.flatnonzero(part.test == test)
        ones = np.ones(len(rows))
        bench = Rows(part.position[rows], 70e5 * ones, 0.0 * ones, 313.15 * ones, direction=ones)
        for i, name in enumerate(OF_THE_EDGES):
            readings = [
                static_tests.TESTS[test](Valve(12e-3, **{**nominal, name: nominal[name] + d}), oil, bench)  # pyright: ignore[reportArgumentType]
                for d in (STEPS[name], -STEPS[name])
            ]
            key = static_tests.READING[test]
            columns[rows, i] = (readings[0][key] - readings[1][key]) / (2.0 * STEPS[name] * std)
    direct = fisher_information(columns)
    size = np.sqrt(np.outer(np.diag(direct), np.diag(direct)))
    np.testing.assert_allclose(fisher_information(part.columns) / size, direct / size, atol=1e-5)


def test_shares_add_up_and_are_what_a_point_is_worth(study):
    np.testing.assert_allclose(study.share.sum(axis=0), 1.0, rtol=1e-9)
    columns = study.measurements.columns
    whole = fisher_information(columns)
    covariance = covariance_of(whole)
    point = int(np.argmax(study.share[:, 1]))
    # Measured a little more often, the point lowers the variance by its share of that.
    more = covariance_of(whole + 1e-6 * np.outer(columns[point], columns[point]))
    fall = (np.diag(covariance) - np.diag(more)) / np.diag(covariance) / 1e-6
    np.testing.assert_allclose(fall, study.share[point], rtol=1e-3, atol=1e-8)


def test_what_was_not_measured_has_no_share():
    blind = np.stack([np.ones(4), np.zeros(4)], axis=1)
    assert np.isnan(shares(blind)).all()
    assert np.isinf(marginal_stds(fisher_information(blind))).all()


def test_known_is_the_prior_and_the_next_test_lowers_it(study):
    factors = {f.name: f for f in factors_of(MODEL, 313.15, 70e5)}
    for name, std in study.known.items():
        assert std == pytest.approx(factors[name].tolerance / np.sqrt(3.0))
    gains = [choice.gain for choice in study.tests]
    assert gains == sorted(gains, reverse=True)
    assert len(gains) == 3 * 4 * 3
    assert all(study.tests[0].std[name] < study.known[name] for name in study.known)
    assert study.repeats.sum() == 12


def test_of_two_sweeps_the_better_one_comes_first():
    """Of two leakage sweeps the one that sees both unknowns must come before the one that sees one of them, only better."""
    both = np.array([[1.0, 1.0], [1.0, -1.0]])
    one = np.array([[2.0, 0.0], [2.0, 0.0]])
    two = Measurements(
        ("a", "b"),
        np.array(["leakage", "leakage", "flow_gain", "flow_gain"]),
        np.full(4, 300.0),
        np.full(4, 70e5),
        np.zeros(4),
        np.concatenate([one, both]),
    )
    # det(I + 2 I) = 9 against det(I + diag(8, 0)) = 9: a tie, which a hundredth more of the first breaks.
    equal = next_tests(two, np.eye(2))
    assert equal[0].gain == pytest.approx(equal[1].gain)
    better = replace(two, columns=two.columns * np.array([1.0, 1.0, 1.01, 1.01])[:, None])
    assert [choice.test for choice in next_tests(better, np.eye(2))] == ["flow_gain", "leakage"]
    assert next_tests(better, np.eye(2))[0].gain == pytest.approx(np.log((1 + 2 * 1.01**2) ** 2))
    assert set(sweeps(better)) == {("leakage", 300.0, 70e5), ("flow_gain", 300.0, 70e5)}


@pytest.mark.parametrize("seed", range(5))
def test_exchange_finds_the_exhaustive_optimum(seed):
    columns = np.random.default_rng(seed).normal(size=(8, 3)) * np.array([1.0, 1e-6, 1e4])
    prior = np.diag(np.array([0.1, 1e-13, 1e7]))
    det = lambda rows: np.linalg.slogdet(prior + fisher_information(columns[list(rows)]))[1]
    best = max(det(rows) for rows in combinations_with_replacement(range(8), 4))
    assert det(d_optimal_points(columns, 4, prior)) == pytest.approx(best, abs=1e-9)
