"""The law of the largest of correlated scores: p-values uniform where nothing is missing, one-sided where signs are known."""

import numpy as np
import pytest
from scipy.stats import kstest, norm, t as student

from thermohyd.identify.diagnosis.max_t import MaxT, NoiseFreedom, normal_score


def directions(correlation: float, count: int, rows: int = 200) -> np.ndarray:
    """Unit vectors of which any two have about this correlation."""
    rng = np.random.default_rng(1)
    raw = np.sqrt(correlation) * rng.standard_normal((rows, 1)) + np.sqrt(1.0 - correlation) * rng.standard_normal(
        (rows, count)
    )
    return raw / np.linalg.norm(raw, axis=0)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("sided", ["one", "two", "mixed"])
def test_p_values_are_uniform_where_nothing_is_missing(correlation, sided):
    u = directions(correlation, 12)
    one_sided = {"one": np.ones(12, bool), "two": np.zeros(12, bool), "mixed": np.arange(12) < 6}[sided]
    law = MaxT.of(u, one_sided)
    scores = np.random.default_rng(2).standard_normal((2000, 200)) @ u
    p = []
    for z in scores:
        strength = np.where(one_sided, z, np.abs(z))
        best = int(np.argmax(strength))
        p.append(law.p_value(float(strength[best]), two_sided=not one_sided[best]))
    p = np.array(p)
    if sided != "mixed":
        assert kstest(p, "uniform").pvalue > 1e-3
    # What counts is the tail: the share below a level must not exceed it beyond chance.
    for level in (0.01, 0.05, 0.1):
        assert np.mean(p <= level) <= level + 3.5 * np.sqrt(level / 2000)


def test_correlated_directions_cost_less_than_bonferroni():
    independent, alike = (MaxT.of(directions(c, 20), np.zeros(20, bool)) for c in (0.0, 0.98))
    assert alike.critical(0.01) < independent.critical(0.01) - 0.3
    assert independent.critical(0.01) == pytest.approx(norm.isf(0.01 / 40), abs=0.15)


def test_one_sided_is_the_easier_test():
    u = directions(0.3, 8)
    one, two = MaxT.of(u, np.ones(8, bool)), MaxT.of(u, np.zeros(8, bool))
    assert one.critical(0.01) < two.critical(0.01)
    assert one.p_value(3.0, two_sided=False) < two.p_value(3.0)


def test_far_out_the_bound_takes_over_and_nothing_is_zero():
    law = MaxT.of(directions(0.2, 10), np.zeros(10, bool))
    assert law.p_value(6.0) == pytest.approx(20 * norm.sf(6.0))
    assert 0.0 < law.p_value(60.0) < 1e-200
    assert law.p_value(-1.0) == 1.0


def test_the_same_answer_every_time():
    u = directions(0.4, 5)
    assert MaxT.of(u, np.ones(5, bool)).critical(0.005) == MaxT.of(u, np.ones(5, bool)).critical(0.005)


def test_no_direction_names_nothing():
    law = MaxT.of(np.zeros((10, 0)), np.zeros(0, bool))
    assert law.p_value(100.0) == 1.0
    assert law.critical(0.01) == np.inf


@pytest.mark.parametrize("score", [-4.0, -0.5, 0.0, 2.0, 8.0])
def test_normal_score_is_as_rare_as_students_t(score):
    assert normal_score(score, np.inf) == score
    assert norm.sf(normal_score(score, 9.0)) == pytest.approx(student.sf(score, 9.0))
    assert abs(normal_score(score, 9.0)) <= abs(score)


def test_noise_counts_by_its_share_of_a_direction():
    """Satterthwaite: the variance of a mean of independent variance estimates."""
    freedom = NoiseFreedom(np.repeat([0, 1, 2], [40, 50, 10]), np.array([12.0, 60.0, np.inf]))
    every = np.ones(100, bool)
    unit = np.zeros(100)
    unit[3] = 1.0
    assert freedom.along(unit, every) == 12.0
    unit[3], unit[95] = 0.0, 1.0
    assert freedom.along(unit, every) == np.inf
    unit[95], unit[60] = 0.6, 0.8
    assert freedom.along(unit, every) == pytest.approx(60.0 / 0.64**2)
    held = every.copy()
    held[:40] = False
    assert freedom.along(unit[40:], held) == freedom.along(unit, every)
    draws = np.random.default_rng(0).chisquare([12.0, 60.0], (100_000, 2)) / [12.0, 60.0] @ [0.4, 0.5]
    assert 2.0 * 0.9**2 / np.var(draws) == pytest.approx(0.9**2 * freedom.of_all, rel=0.02)
