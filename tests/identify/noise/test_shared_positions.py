"""Gauges of one test are read at the same positions: one error of a position moves them all, and counts once."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from thermohyd.identify.diagnosis.record_noise import NoiseEstimate, noise_of
from thermohyd.identify.fitting.uncertainty import settled_noise
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.level import ChannelNoise, counted_once, shared_variance
from thermohyd.identify.noise.whitening import LEAST_APART, Decorrelation, SharedError


A, B, FLOW = ("pressure_gain", "pressure_a"), ("pressure_gain", "pressure_b"), ("flow_gain", "flow")
ROWS = 60


def noise(own: np.ndarray, part: np.ndarray | None) -> ChannelNoise:
    std = own if part is None else np.hypot(own, part)
    return ChannelNoise(std, "", True, False, std, position_part=part)


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


def test_a_diagnosis_has_the_covariance_of_a_row():
    """Standard deviations stay those of a reading, and what a fit alone widens is not widened."""
    own, part = np.ones(ROWS), np.linspace(0.0, 3.0, ROWS)
    std = np.hypot(own, part)
    plain = counted_once({k: ChannelNoise(std, "", True, False, std, position_part=part) for k in (A, B)})
    memory = 1.0 / std**2
    remembered = NoiseCorrelation(1.0, 0.6)
    shared = {"spool_position": part / std}
    estimates = {k: NoiseEstimate(std, remembered, "", "", True, memory=memory, shared=shared) for k in (A, B)}
    weighed = noise_of(estimates)
    for key in (A, B):
        np.testing.assert_allclose(plain[key].used, np.sqrt(1.0 + 2.0 * part**2))
        np.testing.assert_array_equal(weighed.std[key], std)
        assert weighed.shared[key] == shared
        assert weighed.white.shared == {}


def decorrelation(
    moved: np.ndarray, covariance: dict[int, np.ndarray] | None = None
) -> tuple[Decorrelation, np.ndarray]:
    """Of gauges behind one another (gauges, inputs, rows), with the covariance of all their readings. covariance: of some of the inputs."""
    gauges, inputs, rows = moved.shape
    errors = [SharedError(moved[:, i], (covariance or {}).get(i)) for i in range(inputs)]
    found = Decorrelation.of(gauges * rows, [([slice(i * rows, (i + 1) * rows) for i in range(gauges)], errors)])
    assert found is not None
    whole = np.zeros((gauges * rows, gauges * rows))
    for error in errors:
        alike = np.eye(rows)
        if error.covariance is not None:
            size = np.sqrt(np.diag(error.covariance))
            alike = error.covariance / np.outer(size, size)
        whole += np.outer(error.moved, error.moved) * np.tile(alike, (gauges, gauges))
    whole[np.diag_indices_from(whole)] = 1.0
    return found, whole


def moved_by(random: np.random.Generator, gauges: int, inputs: int, rows: int, part: float) -> np.ndarray:
    """(gauges, inputs, rows), of every reading's variance `part` in all."""
    moved = random.standard_normal((gauges, inputs, rows))
    return moved * np.sqrt(part / np.sum(moved**2, axis=1, keepdims=True))


@given(st.integers(2, 4), st.integers(1, 3), st.floats(0.01, 0.9), st.integers(0, 2**31))
def test_gauges_of_a_row_are_made_independent(gauges, inputs, part, seed):
    found, covariance = decorrelation(moved_by(np.random.default_rng(seed), gauges, inputs, 5, part))
    behind = np.full(3, 7.0)  # priors
    root = found(np.eye(5 * gauges))
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(5 * gauges), atol=1e-9)
    np.testing.assert_array_equal(found(np.append(np.zeros(5 * gauges), behind))[-3:], behind)


@given(st.integers(1, 3), st.integers(0, 2**31))
def test_rows_of_one_smooth_sweep_are_made_independent(gauges, seed):
    """Two legs whose rows share their errors; of a second input each row has its own."""
    random = np.random.default_rng(seed)
    legs = np.repeat([0, 1], [7, 4])
    reach = np.exp(-0.3 * np.abs(np.arange(11)[:, None] - np.arange(11))) * (legs[:, None] == legs)
    size = random.uniform(0.5, 2.0, 11)
    found, covariance = decorrelation(moved_by(random, gauges, 2, 11, 0.8), {0: reach * np.outer(size, size)})
    root = found(np.eye(11 * gauges))
    np.testing.assert_allclose(root @ covariance @ root.T, np.eye(11 * gauges), atol=1e-9)
    apart = legs[:, None] != legs
    assert not root[np.tile(apart, (gauges, gauges))].any()
    members, shares = found.members
    values = random.standard_normal(11 * gauges)
    np.testing.assert_allclose(np.sum(values[members] * shares, axis=1), found(values), atol=1e-12)


def test_rows_that_feel_no_error_are_left_as_they_are():
    moved = np.array([[[0.9, 0.9, 0.01, 0.0]]])
    found, _ = decorrelation(moved, {0: np.full((4, 4), 0.8) + 0.2 * np.eye(4)})
    root = found(np.eye(4))
    np.testing.assert_array_equal(root[2:], np.eye(4)[2:])
    np.testing.assert_array_equal(root[:2, 2:], 0.0)
    assert abs(root[0, 1]) > 0.1


def test_what_gauges_share_cancels_where_they_are_compared():
    """p_A up and p_B down by one error of the position, five times their own noise: a shift of the position is known as poorly as that, the
    sum of both pressures as well as the gauges read it."""
    own, part = 1.0, 5.0
    std = np.hypot(own, part)
    found, _ = decorrelation(np.array([[[part / std]], [[-part / std]]]))
    information = lambda change: float(np.sum(found(np.asarray(change) / std) ** 2))
    assert information([part, -part]) == pytest.approx(2.0 * part**2 / (own**2 + 2.0 * part**2))
    assert information([1.0, 1.0]) == pytest.approx(2.0 / own**2)


def test_gauges_are_never_taken_for_one_and_the_same():
    found, _ = decorrelation(np.array([[[1.0]], [[1.0]]]))
    assert float(np.sum(found(np.array([1.0, -1.0])) ** 2)) == pytest.approx(2.0 / LEAST_APART)


def test_a_gauge_alone_is_left_as_it_is():
    assert Decorrelation.of(10, []) is None
    found, _ = decorrelation(np.array([[[0.9]], [[0.0]]]))
    np.testing.assert_allclose(found(np.eye(2)), np.eye(2))
