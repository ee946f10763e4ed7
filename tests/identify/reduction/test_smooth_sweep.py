"""A raw log's position, direction and rate row by row: the smooth sweep behind dither and rounding, as a fit sees it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raw_logs import POSITION, raw_log

from thermohyd.identify.bench.sweeps import sweep_rate
from thermohyd.identify.reduction.reduce import reduce_test, smooth_sweep
from thermohyd.identify.reduction.sweep_position import Abscissa, local_line


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


@pytest.mark.parametrize("half", [0, 1, 6, 40])
def test_the_covariance_of_a_smooth_sweep_is_that_of_its_lines(half):
    """Two legs, bins of uneven width: the lines are linear in the rows, one by one."""
    pieces, starts = np.repeat([0, 1], [50, 37]), np.array([0, 1, 4, 30, 45, 50, 60, 62])
    rows = len(pieces)
    random = np.random.default_rng(4)
    scatter, error = random.uniform(0.5, 2.0, rows), np.full(rows, 0.3)
    still = np.zeros(rows)
    sweep = Abscissa(still, scatter, error, np.full(rows, half), still > 1.0, still)
    line = lambda values: np.concatenate([local_line(values[pieces == leg], half)[0] for leg in (0, 1)])
    means = np.stack(
        [np.add.reduceat(line(one) if half else one, starts) for one in np.eye(rows)], axis=1
    ) / np.diff(np.append(starts, rows))[:, None]  # fmt: skip
    exact = (means * scatter) @ means.T
    found = sweep.covariance_of_means(pieces, starts)
    size = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(np.diag(found), size**2 + 0.3**2, rtol=1e-9)
    correlation = found / np.sqrt(np.outer(np.diag(found), np.diag(found)))
    np.testing.assert_allclose(correlation, exact / np.outer(size, size), atol=1e-9)


def test_the_points_of_a_log_lie_off_their_sweep_as_their_covariance_says():
    """A transducer with noise, a valve that does not shake: the errors of the points, made independent, have variance 1."""
    squares = []
    for seed in range(4):
        test = raw_log(seed, position_step=0.02, dither=0.02)
        found = reduce_test(test)
        assert found.rows_of_log is not None
        half = test.rows // 2
        true = POSITION * np.concatenate([np.linspace(1, -1, half), np.linspace(-1, 1, half)])
        starts = np.append(0, np.cumsum(found.rows_of_log)[:-1])
        error = found.spool_position - np.add.reduceat(true, starts) / found.rows_of_log
        values, vectors = np.linalg.eigh(found.input_covariance["spool_position"])
        squares.append((vectors.T @ error) ** 2 / values)
    # The largest, which are those of whole legs, say most.
    assert 0.1 < np.mean([own[-40:].mean() for own in squares]) < 1.6
