"""Gauges of one test are read at the same positions: one error of a position moves them all, and counts once."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, strategies as st

from thermohyd.identify.diagnosis.record_noise import NoiseEstimate, noise_of
from thermohyd.identify.fitting.uncertainty import settled_noise
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.level import ChannelNoise, counted_once, shared_variance


A, B, FLOW = ("pressure_gain", "pressure_a"), ("pressure_gain", "pressure_b"), ("flow_gain", "flow")
ROWS = 60


@dataclass(frozen=True)
class Moved:
    std: np.ndarray
    position_part: np.ndarray | None


def noise(own: np.ndarray, part: np.ndarray | None) -> Moved:
    return Moved(own if part is None else np.hypot(own, part), part)


@given(*[st.floats(0.1, 10.0) for _ in range(4)])
def test_a_shift_of_the_positions_is_known_as_well_as_it_can_be(own_a, own_b, part_a, part_b):
    """In units of a position's error. Never better than all gauges together, nor worse than the best of them alone."""
    parts = {A: (own_a, part_a), B: (own_b, part_b)}
    more = shared_variance({k: noise(np.full(ROWS, o), np.full(ROWS, s)) for k, (o, s) in parts.items()})
    told = sum(s**2 / (o**2 + s**2 + more[k][0]) for k, (o, s) in parts.items())
    together = sum(s**2 / o**2 for o, s in parts.values())
    apart = sum(s**2 / (o**2 + s**2) for o, s in parts.values())
    assert min(min(m) for m in more.values()) >= 0.0
    assert told <= apart * (1.0 + 1e-9)
    assert told >= together / (1.0 + together) * (1.0 - 1e-9)
    if own_a == own_b and part_a == part_b:
        assert told == pytest.approx(together / (1.0 + together))


def test_gauges_alike_count_once():
    """Two gauges whose readings follow the position alike, p_A up and p_B down: the scatter of a null is what is said of it."""
    random = np.random.default_rng(3)
    part = np.full(ROWS, 2.0)
    more = shared_variance({A: noise(np.ones(ROWS), part), B: noise(np.ones(ROWS), part)})
    weight = 1.0 / (1.0 + part**2 + more[A])
    said = 1.0 / np.sqrt(2.0 * np.sum(weight * part**2))
    nulls = []
    for _ in range(600):
        shift = random.standard_normal(ROWS)
        up, down = (sign * part * shift + random.standard_normal(ROWS) for sign in (1.0, -1.0))
        nulls.append(np.sum(weight * part * (up - down)) * said**2)
    assert np.std(nulls) == pytest.approx(said, rel=0.1)
    apart = 1.0 / np.sqrt(2.0 * np.sum(part**2 / (1.0 + part**2)))
    assert said > 1.3 * apart


def test_one_gauge_alone_or_one_that_does_not_move_keeps_what_it_knows():
    part = np.append(np.zeros(ROWS // 2), np.full(ROWS // 2, 3.0))
    assert shared_variance({A: noise(np.ones(ROWS), part), FLOW: noise(np.ones(ROWS), part)}) == {}
    assert shared_variance({A: noise(np.ones(ROWS), part), B: noise(np.ones(ROWS), None)}) == {}
    assert shared_variance({A: noise(np.ones(ROWS), part), B: noise(np.ones(ROWS), np.zeros(ROWS))}) == {}
    more = shared_variance({A: noise(np.ones(ROWS), part), B: noise(np.ones(ROWS), part[::-1])})
    for key, own in ((A, part), (B, part[::-1])):
        assert not more[key][own == 0.0].any()
        np.testing.assert_allclose(more[key][own > 0.0], 0.0, atol=1e-9)  # the other gauge does not move there


def test_positions_that_make_all_of_the_noise():
    part = np.full(ROWS, 3.0)
    more = shared_variance({A: noise(np.zeros(ROWS), part), B: noise(np.zeros(ROWS), part)})
    np.testing.assert_allclose(more[A], part**2)


@pytest.mark.parametrize(("known", "declared"), [(True, True), (True, False)])
def test_settling_the_noise_again_widens_it_no_further(known, declared):
    part = np.linspace(0.0, 3.0, ROWS)
    std = np.hypot(1.0, part)
    noise = counted_once({k: ChannelNoise(std, "", known, declared, std, position_part=part) for k in (A, B)})
    rows = {A: slice(0, ROWS), B: slice(ROWS, 2 * ROWS)}
    residual = np.random.default_rng(2).standard_normal(2 * ROWS) * 0.5
    settled = noise
    for _ in range(3):
        settled = settled_noise(settled, rows, residual, np.ones((2 * ROWS, 1)))
    for key in (A, B):
        np.testing.assert_allclose(settled[key].used, noise[key].used)


def test_a_fit_and_a_diagnosis_weigh_alike():
    """And what is said of the noise stays what it is."""
    own, part = np.ones(ROWS), np.linspace(0.0, 3.0, ROWS)
    std = np.hypot(own, part)
    plain = counted_once({k: ChannelNoise(std, "", True, False, std, position_part=part) for k in (A, B)})
    memory = 1.0 / std**2
    remembered = NoiseCorrelation(1.0, 0.6)
    estimates = {k: NoiseEstimate(std, remembered, "", "", True, memory=memory, position_part=part) for k in (A, B)}
    weighed = noise_of(estimates)
    for key in (A, B):
        np.testing.assert_allclose(plain[key].used, np.sqrt(1.0 + 2.0 * part**2))
        np.testing.assert_array_equal(plain[key].std, std)
        np.testing.assert_allclose(weighed.std[key], plain[key].used)
        np.testing.assert_allclose(weighed.memory[key] * weighed.std[key] ** 2, own)
