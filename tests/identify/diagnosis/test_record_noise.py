"""A record's noise: from repeats where there are enough, else from what nothing can explain; a missing effect is no noise."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.records import NOISE
from helpers.small_bench import REACH, conditions_only, rows_of
from helpers.small_diagnosis import small_case

from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.diagnosis.record_noise import _excessive, first_noise, repeats_of
from thermohyd.identify.noise.correlation import NoiseCorrelation


def ar1(rng: np.random.Generator, runs: np.ndarray, phi: float) -> np.ndarray:
    out = rng.standard_normal(len(runs))
    for i in range(1, len(runs)):
        if runs[i] == runs[i - 1]:
            out[i] = phi * out[i - 1] + np.sqrt(1.0 - phi**2) * out[i]
    return out


def noisy(runs: tuple[int, ...], phi: float = 0.0, size: float = 1.0, seed: int = 0) -> tuple[TestRecord, Channel]:
    """A curve that every run of a condition shares, and noise that none shares."""
    test = conditions_only("leakage", runs)
    curve = 50.0 * np.tanh(test.spool_position / 40e-6) * (test.temperature / 300.0)
    reading = curve + size * ar1(np.random.default_rng(seed), test.run, phi)
    channel = Channel("leakage_flow", reading, None, "")
    return replace(test, channels=(channel,)), channel


@pytest.mark.parametrize("size", [0.7, 1.0, 3.0])
def test_size_from_repeats_whatever_the_curve(size):
    test, channel = noisy((1,) * 12, size=size)
    repeats = repeats_of(test, channel, np.ones(test.rows))
    assert repeats is not None
    assert repeats.variance == pytest.approx(size**2, rel=0.25)
    assert repeats.correlation == NoiseCorrelation()


def test_memory_from_repeats():
    test, channel = noisy((1,) * 20, phi=0.6)
    repeats = repeats_of(test, channel, np.ones(test.rows))
    assert repeats is not None
    assert repeats.correlation.share * repeats.correlation.phi == pytest.approx(0.6, abs=0.15)
    assert repeats.variance == pytest.approx(1.0, rel=0.3)


def test_too_few_repeats_say_nothing():
    for runs in ((0, 1, 2, 3, 4, 5), (1, 1)):
        test, channel = noisy(runs)
        assert repeats_of(test, channel, np.ones(test.rows)) is None


def test_the_search_for_the_noise_begins_white():
    case = small_case("nothing")
    first = first_noise(case.fitted.noise)
    assert set(first.std) == set(case.noise)
    assert set(first.correlation.values()) == {NoiseCorrelation()}


@pytest.mark.parametrize("name", ["nothing", "pilot", "correlated"])
def test_noise_is_found_beside_the_ideal_valve_whatever_it_misses(name):
    """Beside the ideal valve alone the pilot's leakage would pass for 50 times the noise."""
    for (test, _), found in small_case(name).noise.items():
        assert np.sqrt(np.mean(found.std**2)) == pytest.approx(NOISE[test], rel=0.35), test
        assert not found.warning or name == "correlated"


def test_stated_noise_is_believed_and_undeclared_noise_measured():
    stated, measured = small_case("pilot").noise, small_case("correlated").noise
    for key in stated:
        assert stated[key].source == "declared in bench.toml"
        assert stated[key].known
        assert "declared" not in measured[key].source


def test_memory_of_noise_is_found_and_white_noise_is_white():
    for found in small_case("correlated").noise.values():
        assert 0.3 < found.correlation.share * found.correlation.phi < 0.9
    for found in small_case("nothing").noise.values():
        assert found.correlation.share * found.correlation.phi < 0.25


def test_every_channel_of_a_small_bench_has_enough_repeats():
    assert set(small_case("nothing").repeats) == {(test, channel) for test, channel in small_case("nothing").noise}
    assert all(len(rows_of(test).spool_position) == 256 for test in REACH)
    for found in small_case("nothing").repeats.values():
        assert found is not None
        assert found.rows >= 64
        assert found.variance == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / found.rows))


def test_chance_in_few_readings_is_no_excess_of_noise():
    assert not _excessive(1.4, 9.0)
    assert _excessive(3.0, 9.0)
    assert _excessive(1.25, 1000.0)
    assert not _excessive(1.15, 1e5)


def test_repeats_contradict_what_a_misfit_has_left_in_the_other_rows():
    """A curve that no model follows looks like noise that remembers a long way; repeats, which share it, do not."""
    test, channel = noisy((1,) * 20)
    repeats = repeats_of(test, channel, np.ones(test.rows))
    assert repeats is not None
    assert repeats.agree(NoiseCorrelation())
    assert not repeats.agree(NoiseCorrelation(0.9, 0.95))
