"""The test for a smooth left-over: uniform where nothing is left, whatever the noise remembers, and sharp where something is."""

import numpy as np
import pytest
from helpers.linear_fit import linear_fit, linear_problem, whitened
from helpers.small_bench import conditions_only
from scipy.signal import lfilter
from scipy.stats import kstest

from thermohyd.identify.diagnosis.left_over import CurvesBeside, smooth_block, smooth_columns
from thermohyd.identify.noise.correlation import NoiseCorrelation


WHITE, AR = NoiseCorrelation(), NoiseCorrelation(1.0, 0.6)


def noise_by_run(rng: np.random.Generator, run: np.ndarray, phi: float) -> np.ndarray:
    out = np.empty(len(run))
    for number in np.unique(run):
        rows = run == number
        e = rng.standard_normal(int(rows.sum()) + 100) * np.sqrt(1.0 - phi**2)
        out[rows] = lfilter([1.0], [1.0, -phi], e)[100:]
    return out


class Linear:
    """A linear model whose columns are smooth, its noise, and the smooth block beside it."""

    def __init__(self, correlation: NoiseCorrelation):
        self.problem = linear_problem(correlation)
        self.phi = correlation.phi * correlation.share
        self.rows = sum(test.rows for test in self.problem.tests.values())
        shapes = np.random.default_rng(0).standard_normal((30, 6))
        self.columns = self.white({key: smooth_columns(self.problem.tests[key[0]]) @ shapes for key in self.keys})
        self.block = smooth_block(self.problem, self.rows + 7)

    @property
    def keys(self):
        return list(self.problem.rows())

    def white(self, values):
        return np.concatenate([whitened(self.problem, key, values[key]) for key in self.keys])

    def p_value(self, rng, extra: np.ndarray | float = 0.0) -> float:
        run = {key: self.problem.tests[key[0]].run for key in self.keys}
        residual = self.white({key: noise_by_run(rng, run[key], self.phi) for key in self.keys}) + extra
        residual = residual - self.columns @ np.linalg.lstsq(self.columns, residual, rcond=None)[0]
        return CurvesBeside.of(linear_fit(residual, self.columns))(self.block).p_value


@pytest.mark.parametrize("correlation", [WHITE, AR])
def test_uniform_where_nothing_is_missing(correlation):
    model, rng = Linear(correlation), np.random.default_rng(1)
    p = np.array([model.p_value(rng) for _ in range(150)])
    assert kstest(p, "uniform").pvalue > 1e-3
    assert np.mean(p < 0.02) < 0.07


def test_correlated_noise_taken_for_white_is_a_misfit():
    """Why the correlation has to be measured."""
    model, rng = Linear(WHITE), np.random.default_rng(2)
    model.phi = 0.6
    assert np.median([model.p_value(rng) for _ in range(5)]) < 1e-6


@pytest.mark.parametrize("correlation", [WHITE, AR])
def test_finds_a_smooth_curve_and_not_a_rough_one(correlation):
    model, rng = Linear(correlation), np.random.default_rng(3)
    tests = {key: model.problem.tests[key[0]] for key in model.keys}
    warm = model.white({k: 1.5 * np.sin(t.spool_position / 60e-6) * (t.temperature > 300.0) for k, t in tests.items()})
    assert model.p_value(rng, warm) < 1e-6
    assert model.p_value(rng, 0.7 * (-1.0) ** np.arange(model.rows)) > 1e-3


def test_unit_noise_of_any_size_is_the_same_answer():
    """The rest of the residuals measures the noise: a scale that is off by a factor names no curve."""
    model = Linear(WHITE)
    residual = 3.0 * np.random.default_rng(4).standard_normal(model.rows)
    one, three = (CurvesBeside.of(linear_fit(r, model.columns))(model.block) for r in (residual / 3, residual))
    assert three.p_value == pytest.approx(one.p_value)
    assert three.chi2 == pytest.approx(9.0 * one.chi2)


def test_columns_follow_what_varies():
    several = conditions_only("leakage")
    one = conditions_only("leakage", (0, 0))
    up = conditions_only("leakage", (0,), direction=np.ones(32), rate=None)
    assert smooth_columns(up).shape == (32, 6)  # the position alone
    assert smooth_columns(one).shape == (64, 6 + 4)  # and the direction
    assert smooth_columns(several).shape == (
        256,
        6 * (1 + 2 + 1) + 4 + 2,
    )  # three temperatures, two supplies, two rates
