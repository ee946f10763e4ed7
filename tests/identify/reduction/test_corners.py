"""Bins end where the curve has a corner: two nodes then give the mean of every bin, and nothing else changes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from reference import static_tests
from reference.nuisance_logs import NUISANCES, OILS, draw, readings, true_rows, write
from reference.valve import Effects, Rows

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.reduction import reduce
from thermohyd.identify.reduction.corners import MOST_MORE, ending_at_corners
from thermohyd.identify.reduction.nodes import nodes_of
from thermohyd.identify.reduction.reduce import reduce_test


def off_by(log, points: TestRecord) -> np.ndarray:
    """The reference's curve at the nodes less its mean over the rows, in standard errors of the points; all channels."""
    nodes, rows = points.nodes, points.rows_of_log
    assert nodes is not None
    assert rows is not None
    spread = lambda values: np.repeat(values, nodes.count)
    at = Rows(
        spread(points.spool_position) + nodes.offset.ravel(),
        spread(points.supply_pressure),
        spread(points.return_pressure),
        spread(points.temperature),
        direction=spread(points.direction),
        time=spread(points.time) + nodes.time.ravel(),
        run=spread(points.run),
        rate=spread(points.rate),
    )
    curve = static_tests.TESTS[points.name](log.valve, OILS[log.oil_name][1], at, Effects(**log.effects))
    exact, starts = readings(log, points.name), np.append(0, np.cumsum(rows)[:-1])
    direction = true_rows(log, points.name)[0].direction
    assert direction is not None
    turns = np.add.reduceat(direction, starts) != rows * points.direction
    off = []
    for channel in points.channels:
        assert channel.std is not None
        mean = np.add.reduceat(exact[channel.name], starts) / rows
        found = np.sum(curve[channel.name].reshape(-1, nodes.count) * nodes.weight, axis=1)
        off.append(np.where(turns, 0.0, (found - mean) / channel.std))
    return np.concatenate(off)


@pytest.mark.parametrize("seed", [8, 20, 44])  # 448, 407 and 430 points; 44: both corners within one bin of a flow gain
def test_two_nodes_give_the_mean_of_a_bin_in_which_an_edge_closes(seed, tmp_path, monkeypatch):
    log = draw(seed, off=NUISANCES)
    write(tmp_path, log)
    tests = read_record(tmp_path).tests.values()
    ended = [reduce_test(test) for test in tests]
    off = np.abs(np.concatenate([off_by(log, points) for points in ended]))
    monkeypatch.setattr(reduce, "ending_at_corners", lambda starts, *_: starts)
    left = [reduce_test(test) for test in tests]
    before = np.abs(np.concatenate([off_by(log, points) for points in left]))
    print(f"worst {before.max():.2f} -> {off.max():.2f}; squares {np.sum(before**2):.0f} -> {np.sum(off**2):.1f}")
    assert before.max() > 4.0
    assert np.mean(off > 0.3) < 0.005
    assert off.max() < 1.0
    assert np.sum(off**2) < 0.1 * np.sum(before**2)
    for more, less in zip(ended, left, strict=True):
        assert less.rows < more.rows <= (1.0 + MOST_MORE) * less.rows


def kinked(seed: int, rows: int = 400, noise: float = 1.0, slope: float = 5.0):
    """(position, reading, starts) of one sweep whose slope changes at once somewhere in the middle half; bins of 20 rows."""
    random = np.random.default_rng(seed)
    position = np.linspace(-1.0, 1.0, rows)
    corner = random.uniform(-0.5, 0.5)
    curve = 30.0 * position**3 - 50.0 * position + slope * np.maximum(position - corner, 0.0) * rows / 2.0
    return position, curve + noise * random.normal(size=rows), curve, np.arange(0, rows, 20)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([1, -1]), st.floats(2.0, 100.0))
def test_a_change_of_slope_costs_no_bin_its_mean(seed, way, slope):
    position, reading, curve, starts = kinked(seed, slope=slope)
    position = way * position
    pieces = np.zeros(len(position), int)
    ended = ending_at_corners(starts, pieces, position, [reading], [np.full(len(starts), 1.0 / np.sqrt(20.0))])
    rows = np.diff(np.append(ended, len(position)))
    nodes = nodes_of(position, None, ended, "spool_position")
    at = np.add.reduceat(position, ended)[:, None] / rows[:, None] + nodes.offset
    order = np.argsort(position)
    found = np.sum(np.interp(at, position[order], curve[order]) * nodes.weight, axis=1)
    off = (found - np.add.reduceat(curve, ended) / rows) * np.sqrt(rows)
    assert np.abs(off).max() < 1.0
    assert np.isin(starts, ended).all()
    assert len(ended) <= len(starts) * (1.0 + MOST_MORE)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_a_smooth_curve_keeps_its_bins(seed):
    position, reading, _, starts = kinked(seed, slope=0.0)
    pieces = np.zeros(len(position), int)
    ended = ending_at_corners(starts, pieces, position, [reading], [np.full(len(starts), 1.0 / np.sqrt(20.0))])
    assert len(ended) <= len(starts) + 2


def test_what_one_bin_shows_is_independent_of_units_and_direction():
    position, reading, _, starts = kinked(3, slope=20.0)
    std = np.full(len(starts), 1.0 / np.sqrt(20.0))
    pieces = np.zeros(len(position), int)
    ended = ending_at_corners(starts, pieces, position, [reading], [std])
    assert len(ended) > len(starts)
    for x, y in ((1e-6, 1e5), (-1e-6, 1e-8), (1.0, -1.0)):
        same = ending_at_corners(starts, pieces, x * position + x, [y * reading + 7.0 * y], [abs(y) * std])
        assert np.array_equal(same, ended)


def test_readings_that_stand_still_and_sweeps_that_do_are_left_alone():
    position, reading, _, starts = kinked(4)
    pieces, std = np.repeat([0, 1], 200), np.full(len(starts), 0.2)
    flat = np.zeros_like(reading)
    assert np.array_equal(ending_at_corners(starts, pieces, position, [flat], [0.0 * std]), starts)
    assert np.array_equal(ending_at_corners(starts, pieces, 0.0 * position, [reading], [std]), starts)
    assert np.array_equal(ending_at_corners(starts, pieces, position, [], []), starts)


def test_several_readings_share_their_bins(tmp_path):
    """Of two gauges, either of which may show a corner; bins are the record's."""
    log = replace(draw(4, off=NUISANCES), rows=4000)
    assert "pressure_a" in log.noise
    write(tmp_path, log)
    points = reduce_test(read_record(tmp_path).tests["pressure_gain"])
    assert {c.name for c in points.channels} == {"pressure_a", "pressure_b"}
    assert np.abs(off_by(log, points)).max() < 1.0
