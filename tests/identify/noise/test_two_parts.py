"""Noise of its own and noise in proportion to the reading are told apart, and one is enough where the second is not worth it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.moving_machine import ROWS, RUNS, moving, steps
from hypothesis import given, settings, strategies as st
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from thermohyd.identify.noise.level import ChannelNoise, initial_noise, reweighted
from thermohyd.identify.noise.two_parts import TwoParts, two_parts


LEVEL = np.linspace(0.0, 10.0, 4000)


def residuals(seed: int, own: float, share: float, level: np.ndarray = LEVEL) -> np.ndarray:
    return np.hypot(own, share * level) * np.random.default_rng(seed).standard_normal(len(level))


def test_both_parts_are_found():
    found = [two_parts(residuals(seed, 0.02, 0.01) ** 2, LEVEL) for seed in range(20)]
    assert np.mean([parts.own for parts in found]) == pytest.approx(0.02, rel=0.05)
    assert np.mean([parts.share for parts in found]) == pytest.approx(0.01, rel=0.03)


def test_one_part_is_enough_for_even_noise():
    found = [two_parts(residuals(seed, 0.02, 0.0) ** 2, LEVEL) for seed in range(100)]
    assert sum(parts.share > 0.0 for parts in found) <= 3
    assert_allclose([parts.own for parts in found if parts.share == 0.0], 0.02, rtol=0.06)


def test_what_positions_add_is_no_part_of_either():
    beside = np.where(np.arange(len(LEVEL)) % 10 == 0, 0.5, 0.0)
    rest = residuals(1, 0.02, 0.01) + beside * np.random.default_rng(2).standard_normal(len(LEVEL))
    found = two_parts(rest**2, LEVEL, beside**2)
    assert (found.own, found.share) == (pytest.approx(0.02, rel=0.15), pytest.approx(0.01, rel=0.05))


def test_each_sixth_scatters_as_it_is_weighed():
    rest = residuals(3, 0.02, 0.01)
    unknown = ChannelNoise(np.full(len(LEVEL), 1.0), "", False, False, np.ones(len(LEVEL)), level=LEVEL)
    found = reweighted(unknown, rest, np.ones(len(LEVEL)))
    assert found.parts is not None
    sixths = [np.mean(part) for part in np.array_split((rest / found.std) ** 2, 6)]
    assert_allclose(sixths, 1.0, atol=0.15)


@pytest.mark.parametrize("declared", [True, False])
def test_known_noise_stays_what_it_is(declared):
    known = ChannelNoise(np.full(len(LEVEL), 0.05), "", True, declared, np.full(len(LEVEL), 0.05), level=LEVEL)
    assert_allclose(reweighted(known, residuals(3, 0.02, 0.01), np.ones(len(LEVEL))).used, 0.05)


def test_a_missed_curve_is_widened_where_its_fine_points_show_it():
    """Half of the readings rest on coarse steps: their variance says nothing of what the model misses the fine ones by."""
    std = np.where(LEVEL < 5.0, 0.01, 1.0)
    misfit = std * np.random.default_rng(4).standard_normal(len(LEVEL)) + np.where(LEVEL < 5.0, 0.1, 0.0)
    known = ChannelNoise(std, "", True, False, std, level=LEVEL)
    found = reweighted(known, misfit, np.ones(len(LEVEL)))
    assert np.mean((misfit / found.used) ** 2) == pytest.approx(1.0, rel=1e-3)
    assert_allclose(found.std, std)
    assert np.all(found.used > std)


@settings(max_examples=30)
@given(st.floats(1e-9, 1e9), st.integers(0, 3))
def test_units_change_nothing(unit, seed):
    rest, here = residuals(seed, 0.02, 0.01), TwoParts(0.0, 0.0)
    there, here = two_parts((unit * rest) ** 2, unit * LEVEL), two_parts(rest**2, LEVEL)
    assert_allclose([there.own / unit, there.share], [here.own, here.share], rtol=1e-3)


@pytest.mark.parametrize("rest", [np.zeros(50), np.zeros(0)])
def test_no_scatter_is_no_noise(rest):
    assert two_parts(rest, np.ones(len(rest))) == TwoParts(0.0, 0.0)


@pytest.mark.parametrize("phi", [0.5, 0.9])
def test_a_memory_is_no_second_part(phi):
    """Rows in motion: readings rise and settle, and noise that remembers them seems to go along."""
    row = np.arange(600)
    level = 5.0 + 50.0 * np.exp(-(row % 200) / 30.0)
    white = lambda seed: (
        np.append(1.0, np.full(599, np.sqrt(1.0 - phi**2))) * np.random.default_rng(seed).standard_normal(600)
    )
    noise = lambda seed: np.asarray(lfilter([1.0], [1.0, -phi], white(seed)))
    even = [two_parts((0.3 * noise(seed)) ** 2, level) for seed in range(60)]
    assert sum(parts.share > 0.0 for parts in even) <= 4
    both = [two_parts((np.hypot(0.3, 0.03 * level) * noise(seed)) ** 2, level) for seed in range(20)]
    assert sum(parts.share > 0.0 for parts in both) >= (19 if phi < 0.9 else 12)
    assert np.median([parts.share for parts in both if parts.share]) == pytest.approx(0.03, rel=0.2)


def test_noise_of_readings_in_motion_has_two_parts_too():
    test = moving(command=steps() * np.repeat([1.0, 0.6, 1.4], ROWS))  # no run repeats another
    random = np.random.default_rng(1)
    scatter = {c.name: np.hypot(1e-6, 0.03 * c.value) * random.standard_normal(test.rows) for c in test.channels}
    for name in ("spool_position", "piston_position"):
        unknown = initial_noise(test, test.channel(name))
        found = reweighted(unknown, scatter[name], np.ones(test.rows))
        assert not unknown.known
        assert found.parts is not None
        assert (found.parts.own, found.parts.share) == (pytest.approx(1e-6, rel=0.15), pytest.approx(0.03, rel=0.25))


def test_of_a_frequency_response_it_has_one():
    test = replace(moving(), frequency=np.linspace(1.0, 100.0, ROWS * RUNS))
    assert initial_noise(test, test.channels[0]).level is None
