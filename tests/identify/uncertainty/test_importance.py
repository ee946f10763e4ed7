"""Draws by importance: against exact figures of known densities, against the traced density, and honest where proposals do not cover."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.short_servo import write_short_servo
from helpers.small_bench import small_record
from helpers.small_diagnosis import opened
from scipy.stats import t as student, truncnorm

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.report.uncertainty_json import knowledge_json
from thermohyd.identify.report.uncertainty_words import knowledge_sentences
from thermohyd.identify.uncertainty.importance import Weighed, quantiles, weighed as weigh
from thermohyd.identify.uncertainty.log_posterior import Clamp, log_posterior_of
from thermohyd.identify.uncertainty.posterior import Sampling, posterior_of_a_problem, weighed
from thermohyd.identify.uncertainty.result import Posterior
from thermohyd.identify.uncertainty.study import fit_in_depth
from thermohyd.identify.uncertainty.untraced_posterior import UntracedPosterior, is_traced, untraced_posterior_of


SAMPLING = Sampling(chains=4, warmup=200, draws=300, seed=3)
ONES = np.ones(1)


def of_one(ln_density, start: float, std: float, lower: float = -100.0, upper: float = 100.0) -> UntracedPosterior:
    """The posterior of one parameter p whose ln density is given, between limits."""
    clamp = Clamp(np.array([lower]), std * ONES, np.array([(upper - lower) / std]))

    def log_density(u: np.ndarray) -> float:
        p = float(np.asarray(clamp.physical(jnp.asarray(u)))[0])
        return float(ln_density(p)) + float(clamp.log_slope(jnp.asarray(u)))

    u = clamp.free(np.array([start]))
    slope = np.maximum(clamp.slope(u), 0.3 * std)
    return UntracedPosterior(("p",), log_density, clamp, u, np.diag((std / slope) ** 2), "flat")


@pytest.mark.parametrize("middle", [5.0, 0.5, -0.5])
def test_a_gaussian_that_a_limit_cuts(middle):
    """Far from its limit, beside it, and beyond."""
    exact = truncnorm((0.0 - middle), np.inf, middle, 1.0)
    target = of_one(lambda p: -0.5 * (p - middle) ** 2, max(middle, 0.0), 1.0, lower=0.0)
    found = weighed(target, SAMPLING)
    assert not found.trouble
    own = found.parameters["p"]
    assert own.mean == pytest.approx(exact.mean(), abs=0.12 * exact.std())
    assert own.std == pytest.approx(exact.std(), rel=0.12)
    for level in (0.68, 0.95):
        interval = own.at(level)
        assert interval.low == pytest.approx(exact.ppf(0.5 - 0.5 * level), abs=0.3 * exact.std())
        assert interval.high == pytest.approx(exact.ppf(0.5 + 0.5 * level), abs=0.3 * exact.std())
    assert min(own.ess_bulk, own.ess_tail) >= 400.0
    assert np.isnan(own.r_hat)
    assert not found.pareto_k > 0.7
    assert found.draws.shape == (1, 1200, 1)
    assert np.quantile(found.draws[0, :, 0], 0.5) == pytest.approx(exact.median(), abs=0.12 * exact.std())


def test_two_that_trade_off_begun_far_too_narrow():
    middle, matrix = np.array([3.0, -2.0]), np.array([[1.0, 1.9], [1.9, 4.0]])
    inverse = np.linalg.inv(matrix)
    clamp = Clamp(np.full(2, -1e3), np.ones(2), np.full(2, 2e3))

    def log_density(u: np.ndarray) -> float:
        away = np.asarray(clamp.physical(jnp.asarray(u))) - middle
        return -0.5 * float(away @ inverse @ away)

    target = UntracedPosterior(("a", "b"), log_density, clamp, clamp.free(middle), 0.3 * np.eye(2), "flat")
    found = weighed(target, SAMPLING)
    assert not found.trouble
    assert found.parameters["a"].std == pytest.approx(1.0, rel=0.12)
    assert found.parameters["b"].std == pytest.approx(2.0, rel=0.12)
    assert np.corrcoef(found.draws[0].T)[0, 1] == pytest.approx(0.95, abs=0.02)


def test_tails_that_no_proposal_covers_are_no_answer():
    target = of_one(lambda p: student.logpdf(p, 0.3), 0.0, 0.05, -1e9, 1e9)
    found = weighed(target, SAMPLING)
    assert found.parameters == {}
    assert found.file == b""
    assert "use the profiles" in found.trouble


def test_a_density_that_is_nowhere_is_no_answer():
    found = weighed(of_one(lambda p: -np.inf, 0.0, 1.0), SAMPLING)
    assert found.parameters == {}
    assert found.trouble


def test_draws_of_equal_weight_have_each_its_share():
    draws = np.arange(4.0)[:, None]
    found = Weighed(draws, np.array([0.1, 0.2, 0.3, 0.4]), 0.0)
    counts = np.bincount(found.equal(1000, 1)[:, 0].astype(int))
    np.testing.assert_allclose(counts, [100, 200, 300, 400], atol=1)
    assert quantiles(draws[:, 0], np.full(4, 0.25), (0.5,)) == [1.5]


def test_equal_ratios_are_equal_weights():
    """The smoothing takes logarithms of likelihoods, the other way round."""
    ratios = np.zeros(200)
    ratios[0] = -30.0
    found = weigh(np.zeros((200, 1)), ratios + 1e-6 * np.arange(200))
    assert found.weights[0] < 1e-9
    assert found.effective == pytest.approx(199.0, rel=1e-3)
    assert np.isnan(found.shape)
    ratios[:5] = [3.0, 4.0, 5.0, 6.0, 7.0]
    heavy = weigh(np.zeros((200, 1)), ratios + 1e-6 * np.arange(200))
    assert not heavy.covered


def test_the_density_of_static_tests_is_the_traced_one():
    case = opened(small_record(effects={"hysteresis": 1e-6}, seed=2))
    problem = case.problem
    fit = problem.fit(("hysteresis",), case.base.values)
    names, sizes = list(fit.free), [1.0] * len(fit.free)
    traced = log_posterior_of(problem, fit, 1.3, names, sizes)
    host = untraced_posterior_of(problem, fit, 1.3, names, sizes)
    assert (host.names, host.prior) == (traced.names, traced.prior)
    np.testing.assert_array_equal(host.covariance, traced.covariance)
    random = np.random.default_rng(4)
    away = [host.start + random.normal(size=len(names)) for _ in range(4)]
    ours = np.array([host.log_density(u) for u in away])
    theirs = np.array([float(traced.density(jnp.asarray(u), traced.data)) for u in away])
    np.testing.assert_allclose(ours - ours[0], theirs - theirs[0], rtol=1e-8, atol=1e-7)
    assert np.ptp(ours) > 1.0


def test_runs_in_time_and_stored_oil_are_not_traced():
    case = opened(small_record(seed=2))
    assert is_traced(case.problem.tests, ("hysteresis",))
    assert not is_traced(case.problem.tests, ("port_compliance_a",))


@pytest.mark.nightly  # a record in motion fitted and drawn
def test_a_record_of_motion(tmp_path):
    """Sentences and JSON say how the draws were made; a parameter at its limit has a posterior on one side of it."""
    record = read_record(write_short_servo(tmp_path))
    result = fit_in_depth(record, profile=False, posterior=replace(SAMPLING, warmup=100), progress=None)
    known = result.knowledge
    assert known is not None
    assert known.posterior is not None
    drawn = known.posterior
    assert not drawn.trouble
    assert 0 < drawn.proposals <= 2400
    assert set(drawn.parameters) == {n for n, p in result.parameters.items() if not p.fixed}
    spool = drawn.parameters["spool_frequency"]
    std = result.parameters["spool_frequency"].std
    assert std is not None
    assert spool.mean == pytest.approx(result.parameters["spool_frequency"].value, abs=4.0 * std)
    assert 0.3 * std < spool.std < 2.0 * std
    factor = drawn.parameters["bulk_modulus_factor"]
    assert factor.at(0.99).high <= 1.3
    assert drawn.file
    assert any("proposals weighed by importance" in said for said in knowledge_sentences(result))
    said = knowledge_json(result)
    assert said is not None
    told = said["posterior"]
    assert told["method"] == "importance"
    assert told["proposals"] == drawn.proposals


def test_a_problem_in_motion_goes_the_same_way(monkeypatch):
    asked, made = [], weighed(of_one(lambda p: -0.5 * p**2, 0.0, 1.0), SAMPLING)
    monkeypatch.setattr("thermohyd.identify.uncertainty.posterior.is_traced", lambda tests, effects: False)

    def drawn(target: UntracedPosterior, sampling: Sampling, say) -> Posterior:
        asked.append(target.names)
        return made

    monkeypatch.setattr("thermohyd.identify.uncertainty.posterior.weighed", drawn)
    case = opened(small_record(seed=2))
    names = [f"number {i}" for i in range(len(case.base.free))]
    assert posterior_of_a_problem(case.problem, case.base, 1.0, names, [1.0] * len(names), SAMPLING) is made
    assert asked == [tuple(names)]
