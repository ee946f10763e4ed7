"""The grid of a log is found in its values, and a rounded reading is believed as far as scatter and sweep bear it out."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raw_logs import READING, raw_log
from hypothesis import given, strategies as st

from thermohyd.identify.reduction.rounding import (
    column_step,
    local_steps,
    rounding_error,
    rounding_floor,
    scatter_before_rounding,
)


def test_one_step_whatever_the_unit():
    values = np.random.default_rng(0).normal(size=300)
    for unit in (1.0, 6894.757, 1 / 60000.0):
        assert local_steps(np.round(values, 2) * unit) == pytest.approx(np.full(300, 0.01 * unit), rel=1e-6)


def test_decimals_of_a_small_table():
    """Distances between values are many steps long; the step still divides them all."""
    values = np.round(np.random.default_rng(1).uniform(0, 1, 60), 3)
    assert local_steps(values * 1e5) == pytest.approx(np.full(60, 100.0), rel=1e-6)


def test_sweeps_that_repeat_their_rows_are_rounded_to_a_step_and_not_to_a_row():
    """Six sweeps with a row every 1.45 um, logged to 0.2 um: equal distances that come again and again are those of the rows."""
    rows = np.concatenate([np.linspace(-64.0, 64.0, 89), np.linspace(64.0, -64.0, 89)])
    noise = np.random.default_rng(5).normal(scale=0.02, size=(6, len(rows)))
    logged = 1e-6 * np.round((rows + noise) / 0.2).ravel() * 0.2
    assert np.median(local_steps(logged)) > 0.3e-6
    assert column_step(logged) == pytest.approx(0.2e-6, rel=1e-6)


def test_unrounded_values_have_no_step():
    rng = np.random.default_rng(2)
    for values in (
        rng.normal(size=2000),
        np.linspace(-1, 1, 5) + 1e-3 * rng.normal(size=5),
        np.ones(10),
        np.arange(2.0)[:1],
    ):
        assert not local_steps(values).any()


def test_two_ranges_behind_a_printed_conversion():
    """0.1 psi below 1000 psi, 100 psi above it, printed in bar with four decimals."""
    psi = np.linspace(-3000, 3000, 20001) + np.random.default_rng(3).normal(scale=0.2, size=20001)
    psi = np.where(np.abs(psi) < 1000, np.round(psi, 1), 100 * np.round(psi / 100))
    steps = local_steps(np.round(psi * 0.0689476, 4) * 1e5) / 1e5
    fine = steps[np.abs(psi) < 990]
    assert np.mean(np.abs(fine - 0.00689) < 2e-4) > 0.95
    assert fine.max() < 0.05
    assert steps[np.abs(psi) > 1050] == pytest.approx(6.89476, rel=1e-3)


@given(st.floats(0.0, 1.5), st.integers(0, 1000))
def test_rounding_error_of_dithered_readings(scatter, seed):
    """Against a simulation: the mean of many rounded readings, for levels all over the step."""
    rng = np.random.default_rng(seed)
    levels = (np.arange(50) + 0.5) / 50
    means = np.mean(np.round(levels[:, None] + scatter * rng.normal(size=(50, 4000))), axis=1)
    seen = np.sqrt(np.mean((means - levels) ** 2))
    chance = np.sqrt((scatter**2 + 1 / 12) / 4000)
    assert seen == pytest.approx(float(rounding_error(1.0, scatter, 0.0)), abs=0.01 + 1.5 * chance)


def test_rounding_error_at_rest_and_in_a_ramp():
    assert float(rounding_error(6.9, 0.0, 0.0)) == pytest.approx(6.9 / np.sqrt(12))
    assert float(rounding_error(0.0, 0.0, 0.0)) == 0.0
    assert float(rounding_error(1.0, 0.0, 20.0)) < 0.01


@pytest.mark.parametrize("scatter", [0.05, 0.2, 0.5, 1.0, 4.0])
def test_scatter_before_rounding(scatter):
    rng = np.random.default_rng(4)
    levels = rng.uniform(size=400)
    seen = np.sqrt(np.mean(np.var(np.round(levels[:, None] + scatter * rng.normal(size=(400, 200))), axis=1)))
    before = scatter_before_rounding(np.array([seen]), np.array([1.0]), np.array([0.0]))
    assert before[0] == pytest.approx(scatter, rel=0.1, abs=0.02)


def test_floor_of_a_row():
    test = raw_log(5, rows=200, noise=0.0, reading_step=0.01)
    assert rounding_floor(test, test.channels[0]) == pytest.approx(np.full(200, 0.01 * READING / np.sqrt(12)), rel=1e-6)
    assert not rounding_floor(raw_log(5, rows=200), raw_log(5, rows=200).channels[0]).any()


def test_floor_knows_the_slope_where_the_position_is_rounded():
    test = raw_log(6, rows=450, noise=0.0, position_step=0.02)  # increments of 0 and 1 steps: readings, not set points
    ramp = np.concatenate([np.linspace(1e-4, -1e-4, 225), np.linspace(-1e-4, 1e-4, 225)])
    channel = replace(test.channels[0], value=3.0 * ramp + 1e-9 * np.random.default_rng(6).normal(size=450))
    assert np.median(rounding_floor(test, channel)) == pytest.approx(3.0 * 0.02e-4 / np.sqrt(12), rel=0.25)


def test_set_points_are_not_rounded_readings():
    test = raw_log(7, rows=80)
    chosen = np.concatenate([np.arange(-20, 20), np.arange(20, -20, -1)]) * 5e-6
    assert local_steps(chosen).any()
    assert not rounding_floor(replace(test, spool_position=chosen), test.channels[0]).any()
