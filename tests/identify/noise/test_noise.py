"""Noise measured on the record itself, free of any model."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raw_logs import READING, correlated_noise, raw_log

from thermohyd.identify.noise.correlation import effective_size
from thermohyd.identify.noise.level import noise_from_neighbours, noise_from_repeats
from thermohyd.identify.reduction.noise_of_logs import LogCorrelation, row_noise


def test_repeats_measure_the_noise():
    test = raw_log(0, rows=600, runs=3, noise=0.05)
    repeated = noise_from_repeats(test, test.channels[0])
    assert repeated is not None
    assert repeated.std / READING == pytest.approx(0.05, rel=0.12)
    assert abs(repeated.correlation) < 0.2
    assert "repeated sweeps" in repeated.source


def test_repeats_measure_correlation():
    test = raw_log(1, rows=2000, runs=2, noise=0.05, memory=5.0)
    repeated = noise_from_repeats(test, test.channels[0])
    assert repeated is not None
    assert repeated.correlation == pytest.approx(np.exp(-0.2), abs=0.1)


def test_repeats_on_other_positions_are_interpolated():
    test = raw_log(2, rows=800, runs=2, noise=0.05)
    moved = np.where(test.run == 1, test.spool_position + 0.4e-4 / 200, test.spool_position)
    repeated = noise_from_repeats(replace(test, spool_position=moved), test.channels[0])
    assert repeated is not None
    assert repeated.std / READING == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("change", ["supply", "temperature", "rate"])
def test_no_repeat_without_the_same_conditions(change):
    test = raw_log(3, rows=400, runs=2)
    second = test.run == 1
    changed = {
        "supply": lambda: replace(test, supply_pressure=np.where(second, 140e5, 70e5)),
        "temperature": lambda: replace(test, temperature=np.where(second, 320.0, 313.0)),
        "rate": lambda: replace(test, time=None if test.time is None else np.where(second, 4.0, 1.0) * test.time),
    }[change]()
    assert noise_from_repeats(test, test.channels[0]) is not None
    assert noise_from_repeats(changed, test.channels[0]) is None
    alone = raw_log(3, rows=400)
    assert noise_from_repeats(alone, alone.channels[0]) is None


def test_repeats_in_a_dithered_log():
    test = raw_log(3, rows=8000, runs=2, noise=0.05, position_step=0.01, dither=0.004)
    repeated = noise_from_repeats(test, test.channels[0])
    assert repeated is not None
    assert repeated.std / READING == pytest.approx(0.06, rel=0.2)  # with the position's own noise on the flanks
    assert test.time is not None
    slower = replace(test, time=np.where(test.run == 1, 4.0, 1.0) * test.time)
    assert noise_from_repeats(slower, test.channels[0]) is None


def test_neighbours_measure_the_noise_where_the_curve_is_smooth():
    test = raw_log(4, rows=600, noise=0.05)
    rough = noise_from_neighbours(test, test.channels[0])
    assert rough.valid
    assert rough.std / READING == pytest.approx(0.05, rel=0.15)


def test_neighbours_admit_defeat_before_a_bending_curve():
    test = raw_log(5, rows=100, noise=1e-6)
    assert not noise_from_neighbours(test, test.channels[0]).valid


@pytest.mark.parametrize("memory", [0.0, 3.0, 20.0])
def test_effective_size(memory):
    a = np.exp(-1.0 / memory) if memory else 0.0
    sizes = [effective_size(correlated_noise(np.random.default_rng(seed), 4000, memory)) for seed in range(10)]
    assert np.mean(sizes) == pytest.approx(4000 * (1 - a) / (1 + a), rel=0.2)


def test_effective_size_of_short_and_flat_series():
    assert effective_size(np.ones(10)) == 10.0
    assert effective_size(np.array([1.0, 2.0])) == 2.0


@pytest.mark.parametrize("memory", [0.0, 5.0, 40.0])
def test_scatter_of_means_is_foretold(memory):
    """The variance of means of 50 rows, estimated on a curve's log, against that of pure noise."""
    n, size = 20000, 50
    foretold = []
    for seed in range(6):
        y = correlated_noise(np.random.default_rng(seed), n, memory) + 50 * np.sin(np.arange(n) / 1500)
        pieces = np.zeros(n, int)
        found = row_noise(y, pieces)
        foretold.append(found.correlation.of_mean(size) * found.own[0])
    a = np.exp(-1.0 / memory) if memory else 0.0
    exact = ((1 + a) / (1 - a) - 2 * a * (1 - a**size) / (size * (1 - a) ** 2)) / size
    assert np.mean(foretold) == pytest.approx(exact, rel=0.2)


def test_white_rows_count_in_full():
    white = LogCorrelation()
    assert white.effective_rows(40.0) == pytest.approx(40.0)
    assert white.of_neighbours(40.0) == pytest.approx(0.0)
