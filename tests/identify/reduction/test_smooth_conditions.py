"""Logged pressures and temperatures are taken on their smooth course, unless the readings follow their scatter."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raw_logs import raw_log
from numpy.testing import assert_allclose, assert_array_equal

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.reduction.smooth_conditions import with_smooth_conditions


BAR = 1e5


def logged(
    rows: int = 3000, *, noise: float = 0.05, step: float = 0.1, follow: float = 0.0
) -> tuple[TestRecord, np.ndarray]:
    """A log whose supply wanders by 0.3 bar, with noise and steps [bar] of its gauge, and the supply as it was [Pa].

    follow: how much of the scatter is the valve's own supply, in proportion to which it reads."""
    test = raw_log(1, rows=rows, noise=1e-3)
    rng = np.random.default_rng(5)
    true = 70.0 + 0.3 * np.sin(np.arange(rows) / rows * 9.0)
    away = noise * rng.standard_normal(rows)
    supply = true + away
    supply = np.round(supply / step) * step if step else supply
    channel = test.channels[0]
    channel = replace(channel, value=channel.value * (1.0 + follow * away / true))
    return replace(test, supply_pressure=supply * BAR, channels=(channel,)), true * BAR


def test_a_noisy_supply_is_taken_on_its_course():
    test, true = logged()
    found = with_smooth_conditions(test)
    assert np.std(test.supply_pressure - true) == pytest.approx(0.058 * BAR, rel=0.05)
    assert np.std(found.supply_pressure - true) < 0.012 * BAR
    # What is left of it is said, as large as it is.
    said = np.sqrt(np.mean(found.input_error["supply_pressure"] ** 2))
    assert said == pytest.approx(np.std(found.supply_pressure - true), rel=0.5)
    assert any("supply pressure scatters by 0.058 bar about a smooth course" in note for note in found.notes)


def test_a_ripple_that_readings_follow_is_kept():
    test, _ = logged(follow=1.0)
    found = with_smooth_conditions(test)
    assert_array_equal(found.supply_pressure, test.supply_pressure)
    assert "supply_pressure" not in found.input_error
    assert any("kept as logged" in note for note in found.notes)


def test_what_readings_would_hardly_show_is_left_alone():
    """A scatter that the valve may well have felt, far below the readings' noise, as in a table of few rows."""
    test = raw_log(1, rows=200, noise=0.05)
    supply = test.supply_pressure + 0.05 * BAR * np.random.default_rng(5).standard_normal(test.rows)
    assert with_smooth_conditions(replace(test, supply_pressure=supply)).input_error == {}


def test_chance_makes_hardly_any_reading_follow():
    kept = 0
    for seed in range(40):
        test = raw_log(seed, rows=2000, noise=1e-3)
        away = 0.05 * BAR * np.random.default_rng(1000 + seed).standard_normal(test.rows)
        test = replace(test, supply_pressure=test.supply_pressure + away)
        kept += bool(np.array_equal(with_smooth_conditions(test).supply_pressure, test.supply_pressure))
    assert kept <= 1


def test_steps_of_rounding_alone_are_joined_up():
    test, true = logged(noise=0.0, step=0.1)
    found = with_smooth_conditions(test)
    # At a turn the course stays within one step, and nobody knows where.
    assert np.std(test.supply_pressure - true) > 0.025 * BAR
    assert np.median(np.abs(found.supply_pressure - true)) < 0.005 * BAR


def test_a_step_of_the_supply_stays_a_step():
    test, _ = logged(noise=0.05, step=0.0)
    stepped = test.supply_pressure + np.where(np.arange(test.rows) < 1500, 0.0, 50.0 * BAR)
    found = with_smooth_conditions(replace(test, supply_pressure=stepped)).supply_pressure
    assert_allclose(found[1480:1500], stepped[1480:1500], atol=0.3 * BAR)
    assert_allclose(found[1500:1520], stepped[1500:1520], atol=0.3 * BAR)


def test_what_does_not_scatter_is_not_touched():
    test = raw_log(1, rows=2000)
    assert with_smooth_conditions(test) is test
    straight = replace(test, temperature=test.temperature + np.linspace(0.0, 2.0, test.rows))
    assert_allclose(with_smooth_conditions(straight).temperature, straight.temperature, rtol=0.0, atol=1e-6)
