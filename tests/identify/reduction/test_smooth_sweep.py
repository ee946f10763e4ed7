"""A raw log's position, direction and rate row by row: the smooth sweep behind dither and rounding, as a fit sees it."""

from dataclasses import replace

import numpy as np
from helpers.raw_logs import POSITION, raw_log

from thermohyd.identify.bench.sweeps import sweep_rate
from thermohyd.identify.reduction.reduce import reduce_test, smooth_sweep


def logged(**how):
    """A triangle of 16,000 rows at 100 rows per second; the true speed is 2 POSITION in 80 s."""
    test = raw_log(3, **how)
    assert test.time is not None
    return replace(test, rate=sweep_rate(test.spool_position, test.time, test.run))


SPEED = 2 * POSITION / 80.0


def test_dither_and_rounding_make_no_rate_and_no_turn():
    test = logged(position_step=0.02, dither=0.02)
    assert test.rate is not None
    assert np.max(np.abs(test.rate)) > 50 * SPEED  # what a row's own step says
    found = smooth_sweep(test)
    assert found.rate is not None
    half = test.rows // 2
    inner = np.abs(np.arange(test.rows) - half) > 200
    np.testing.assert_allclose(np.abs(found.rate[inner]), SPEED, rtol=0.2)
    assert np.all(found.direction[: half - 200] == -1)
    assert np.all(found.direction[half + 200 :] == 1)
    true = POSITION * np.concatenate([np.linspace(1, -1, half), np.linspace(-1, 1, half)])
    assert np.std((found.spool_position - true)[inner]) < 0.3 * np.std((test.spool_position - true)[inner])


def test_the_rates_are_those_of_the_fit():
    test = logged(position_step=0.02, dither=0.02)
    points, rows = reduce_test(test), smooth_sweep(test)
    assert points.rate is not None
    assert rows.rate is not None
    assert points.rows_of_log is not None
    middle = np.cumsum(points.rows_of_log) - points.rows_of_log // 2 - 1
    assert np.median(np.abs(rows.rate[middle] - points.rate)) < 0.05 * SPEED


def test_a_staircase_without_dither_moves_at_the_sweep_s_speed():
    found = smooth_sweep(logged(position_step=0.02))
    assert found.rate is not None
    assert abs(np.median(np.abs(found.rate)) / SPEED - 1.0) < 0.05
    assert np.percentile(np.abs(found.rate), 99) < 1.6 * SPEED


def test_readings_taken_one_by_one_stay_as_they_are():
    test = logged(rows=400)
    assert smooth_sweep(test) is test


def test_without_time_there_is_no_rate():
    found = smooth_sweep(replace(raw_log(3, position_step=0.02, dither=0.02), time=None))
    assert found.rate is None
