"""Rows kept back: whole conditions, every level still in the fit, the same rows every time, no condition on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.small_bench import REACH, conditions_only

from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.diagnosis.held_out import split_rows


def split_of(test: TestRecord) -> tuple[np.ndarray, str]:
    split = split_rows({test.name: test})
    return split.held, split.what


@pytest.mark.parametrize(
    "runs", [(0, 1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 5, 1, 4), (0, 1, 2, 3), (5, 3, 1, 0, 2), (0, 0, 0, 1, 1, 2, 3)]
)
def test_every_level_stays_in_the_fit(runs):
    test = conditions_only("leakage", runs)
    held, what = split_of(test)
    assert 0.05 < held.mean() < 0.56
    for column in (test.temperature, test.supply_pressure):
        assert set(column[~held]) == set(column)
    assert "conditions" in what


def test_no_condition_is_on_both_sides():
    test = conditions_only("leakage")
    held, _ = split_of(test)
    conditions = list(zip(test.temperature, test.supply_pressure, strict=True))
    assert not {c for c, h in zip(conditions, held, strict=True) if h} & {
        c for c, h in zip(conditions, held, strict=True) if not h
    }


def test_the_same_rows_every_time_and_for_every_channel():
    tests = {name: conditions_only(name) for name in REACH}
    gain = tests["pressure_gain"]
    ports = tuple(Channel(f"pressure_{port}", np.zeros(gain.rows)) for port in "ab")
    tests["pressure_gain"] = replace(gain, channels=ports)
    first, second = split_rows(tests), split_rows(tests)
    np.testing.assert_array_equal(first.held, second.held)
    assert first.what == second.what
    assert len(first.held) == 4 * 256
    np.testing.assert_array_equal(first.held[256:512], first.held[512:768])


def test_conditions_that_waver_are_one_condition():
    rng = np.random.default_rng(1)
    exact = conditions_only("leakage")
    wavering = replace(
        exact,
        temperature=exact.temperature + rng.uniform(-0.4, 0.4, exact.rows),
        supply_pressure=exact.supply_pressure * (1.0 + 0.005 * rng.uniform(-1.0, 1.0, exact.rows)),
    )
    np.testing.assert_array_equal(split_of(wavering)[0], split_of(exact)[0])


def test_repeats_of_one_condition():
    test = conditions_only("leakage", (0, 0, 0, 0))
    held, what = split_of(test)
    assert "repeated sweeps" in what
    assert 0.0 < held.mean() <= 0.25
    assert all(len(np.unique(held[test.run == run])) == 1 for run in np.unique(test.run))


def test_one_run_gives_stretches_of_every_sweep():
    test = conditions_only("leakage", (0,))
    held, what = split_of(test)
    assert "stretch of each sweep" in what
    for direction in (1.0, -1.0):
        assert 0.15 < held[test.direction == direction].mean() < 0.4
    assert not held[[0, 15, 16, 31]].any()  # nothing has to be extrapolated


def test_two_conditions_that_share_nothing_are_not_split_by_condition():
    held, what = split_of(conditions_only("leakage", (0, 5)))  # cold and low, warm and high
    assert "repeated sweeps" in what or "stretch" in what
    assert 0.0 < held.mean() < 0.56
