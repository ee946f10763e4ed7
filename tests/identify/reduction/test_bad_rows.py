"""Rows that are no readings of the valve: found where they are, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raw_logs import POSITION, READING, TRUTH, raw_log, steep
from helpers.records import NOISE
from helpers.small_bench import rows_of, small_record

from thermohyd.data import sample_record
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.test_record import DynamicTest
from thermohyd.identify.reduction.bad_rows import (
    lies_aside,
    outliers,
    outliers_beside,
    without_outliers,
)
from thermohyd.identify.reduction.limits import without_limits
from thermohyd.identify.reduction.monotone_pieces import monotone_pieces
from thermohyd.identify.reduction.reduce import reduce_test


def with_readings(test, value):
    return replace(test, channels=(replace(test.channels[0], value=value),), lines=np.arange(test.rows) + 2)


def spoiled(test, shifts):
    value = test.channels[0].value.copy()
    for row, shift in shifts.items():
        value[row] += shift
    return with_readings(test, value)


@pytest.mark.parametrize("test", ["leakage", "pressure_gain", "flow_gain"])
def test_no_good_row_is_an_outlier(test):
    """Peaks and steps of 16 rows a way are no outliers, nor is noise: a hundredth of the tests may have one."""
    assert rows_of(test).spool_position.size == 256
    seen = 0
    for seed in range(12):
        [channel] = small_record(seed=seed).tests[test].channels
        seen += len(outliers(small_record(seed=seed).tests[test], channel.value))
    assert seen == 0


def test_an_outlier_is_found_with_its_line_and_left_out():
    test = small_record().tests["flow_gain"]
    size = NOISE["flow_gain"]
    bad = spoiled(test, {37: 50.0 * size, 118: -60.0 * size})
    [channel] = bad.channels
    assert channel.std is not None
    found = outliers(bad, channel.value, channel.std)
    assert set(found) == {37, 118}
    kept = without_outliers(bad, {channel.name: found})
    assert kept.rows == test.rows - 2
    assert not np.isin(channel.value[37], kept.channels[0].value)
    [fault] = kept.faults
    assert (fault.name, fault.value, fault.masked) == ("outliers", 2.0, True)
    assert [row.line for row in fault.rows] == [39, 120]
    assert all(row.sigma is not None and row.sigma > 5.0 for row in fault.rows)
    assert "flow_gain.csv, line" in fault.sentence
    assert without_outliers(test, {channel.name: {}}) is test


def test_a_shifted_curve_makes_no_outliers_and_a_bad_row_on_its_rise_is_one():
    """Beside a model whose curve lies 0.3 um aside its steepest rows miss most; what is beyond three times that shift is no shift."""
    test = small_record().tests["pressure_gain"]
    [channel] = test.channels
    pieces = monotone_pieces(test)[0]
    rise, step = np.diff(channel.value), np.diff(test.spool_position)
    slope = np.append(np.divide(rise, step, out=np.zeros_like(rise), where=step != 0.0), 0.0)
    for shift in (0.3e-6, 1e-6):
        misfit = shift * slope
        aside = lies_aside(test, channel.value, misfit, pieces)
        size = np.full(test.rows, NOISE["pressure_gain"])
        assert not outliers(test, misfit, size, pieces, aside)
        row = int(np.argmax(np.abs(slope[8:56]))) + 8
        bad = misfit.copy()
        bad[row] += 4.0 * shift * slope[row] + 30.0 * size[row]
        assert set(outliers(test, bad, size, pieces, aside)) == {row}


def test_many_outliers_are_noise_of_another_kind():
    test = small_record().tests["leakage"]
    rows = {row: 30.0 * NOISE["leakage"] for row in range(4, 256, 11)}
    kept = without_outliers(test, {"leakage_flow": rows})
    assert kept.rows == test.rows
    assert not kept.faults[0].masked
    assert "not normal" in kept.faults[0].sentence


def test_an_outlier_of_a_raw_log_takes_no_part_in_its_bin():
    test = raw_log(3)
    value = test.channels[0].value.copy()
    value[5000:5002] += 30.0 * np.ptp(value)
    bad = with_readings(test, value)
    points = reduce_test(bad)
    assert [row.line for row in points.faults[0].rows] == [5002, 5003]
    assert points.channels[0].value.max() < 2.0 * np.abs(test.channels[0].value).max()
    assert not reduce_test(test).faults


@pytest.mark.parametrize("aside", [0.0, 0.004])
def test_beside_a_model_a_bad_row_on_the_rise_of_a_log_is_found(aside):
    """That the model's curve lies three rows aside makes no row a bad one."""
    log = raw_log(5, curve=steep, rows=3200, noise=0.01)
    modelled = READING * (steep(log.spool_position / POSITION - aside) @ TRUTH)
    assert not outliers_beside(log, log.channels[0], modelled)
    row = int(np.argmin(np.abs(log.spool_position[:1600] / POSITION - 0.02)))
    value = log.channels[0].value.copy()
    value[row] += 0.2 * READING
    bad = with_readings(log, value)
    assert set(outliers_beside(bad, bad.channels[0], modelled)) == {row}


def test_a_clipped_gauge_and_a_dead_band():
    test = small_record().tests["pressure_gain"]
    value = test.channels[0].value
    limit = 0.5 * value.max()
    kept = without_limits(with_readings(test, np.clip(value, -np.inf, limit)))
    [fault] = kept.faults
    assert fault.name == "clipped"
    assert fault.value == limit
    assert np.all(kept.channels[0].value < limit)
    assert kept.rows == test.rows - len(fault.rows)
    both = without_limits(with_readings(test, np.clip(value, -limit, limit)))
    assert sorted(fault.value for fault in both.faults) == [-limit, limit]
    assert np.all(np.abs(both.channels[0].value) < limit)
    flow = small_record().tests["flow_gain"]
    own = flow.channels[0].value
    dead = without_limits(with_readings(flow, np.where(np.abs(own) < 0.1 * own.max(), 0.0, own)))
    assert [fault.name for fault in dead.faults] == ["meter_dead_band"]
    assert np.all(dead.channels[0].value != 0.0)


def test_a_gauge_that_has_a_limit_is_at_it_where_a_sweep_only_touches_it():
    """Of a hidden record's 56 rows at the flow meter's limit 18 stood in twos, at the ends of slower sweeps: they bent the model beyond
    every explanation."""
    test = small_record().tests["pressure_gain"]
    value = np.minimum(test.channels[0].value, 0.5 * test.channels[0].value.max())
    limit = float(value.max())
    at_limit = np.flatnonzero(value == limit)
    last = at_limit[test.run[at_limit] == test.run[at_limit[-1]]]
    value[last[2:]] = limit * (0.9 - 1e-3 * np.arange(len(last) - 2))
    kept = without_limits(with_readings(test, value))
    assert np.all(kept.channels[0].value < limit)
    assert len(kept.faults[0].rows) == int(np.sum(value == limit))


def test_a_flow_that_ends_abruptly_is_a_meters_limit_though_rounding_hides_the_noise():
    """A hidden flow gain in steps of 0.5 % of its meter's limit, one row in two seconds, was called unexplained: 24 and 18 rows stood at
    the limit, where neighbours that rounding made equal were no surprise. A flow that levels out keeps its rows."""
    flow = small_record().tests["flow_gain"]
    place = np.concatenate(
        [np.linspace(-1.0, 1.0, n) for n in np.bincount(np.unique(flow.run, return_inverse=True)[1])]
    )
    step = 0.01
    log = lambda x, reading: with_readings(replace(flow, spool_position=1e-4 * x), step * np.round(reading / step))
    kept = without_limits(log(place, np.clip(1.7 * place, -1.0, 1.0)))
    assert sorted(fault.value for fault in kept.faults) == [-1.0, 1.0]
    assert np.all(np.abs(kept.channels[0].value) < 1.0)
    level = log(place, np.tanh(2.0 * place))
    assert without_limits(level) is level
    # A spool at its stop, whose position is read with noise.
    stopped = np.clip(1.7 * place, -1.0, 1.0)
    still = log(stopped + 1e-4 * np.random.default_rng(3).standard_normal(flow.rows), stopped)
    assert without_limits(still) is still


def test_beside_a_dead_band_go_the_rows_that_only_noise_kept_out_of_it():
    """Those left would all be too large: of a meter with a dead band of three times its noise they made that noise seem 37 % larger."""
    flow = small_record().tests["flow_gain"]
    rng, noise, band = np.random.default_rng(2), 2e-8, 6e-8
    true = 1.5e-8 + 4e-7 * np.exp(-np.abs(flow.spool_position) / 40e-6)
    value = true + noise * rng.standard_normal(flow.rows)
    kept = without_limits(with_readings(flow, np.where(np.abs(value) < band, 0.0, value)))
    [fault] = kept.faults
    assert fault.name == "meter_dead_band"
    assert "that only their noise kept from it" in fault.sentence
    assert len(fault.rows) == flow.rows - kept.rows
    at = {float(x): t for x, t in zip(flow.spool_position, true, strict=True)}
    left = np.array([at[float(x)] for x in kept.spool_position])
    assert np.all(kept.channels[0].value > 0.0)
    assert abs(np.mean(kept.channels[0].value - left)) < 3.0 * noise / np.sqrt(kept.rows)
    # Left as they were, those beside zeros are off by more than their noise.
    beside = (value >= band) & (true < band)
    assert np.mean((value - true)[beside]) > 1.0 * noise
    assert left.min() > 0.8 * band


def test_rounding_and_a_reading_that_never_changes_are_neither():
    test = small_record().tests["pressure_gain"]
    value = test.channels[0].value
    coarse = with_readings(test, np.round(value / (0.1 * value.max())) * 0.1 * value.max())
    assert without_limits(coarse) is coarse
    constant = with_readings(test, np.full(test.rows, 3.0))
    assert without_limits(constant) is constant


def in_motion() -> list[DynamicTest]:
    folder = sample_record("seed_actuator").parent / "hidden_dynamic"
    records = [read_record(one) for one in (sample_record("seed_actuator"), *sorted(folder.iterdir())) if one.is_dir()]
    return [test for record in records for test in record.dynamic_tests.values()]


def test_a_gauge_that_clips_in_motion_loses_its_rows_and_one_that_comes_to_rest_keeps_them():
    tests = in_motion()
    assert len(tests) > 3
    for test in tests:
        assert without_limits(test) is test
        coarse = tuple(
            replace(c, value=np.round(c.value / np.ptp(c.value), 2) * np.ptp(c.value)) for c in test.channels
        )
        rounded = replace(test, channels=coarse)
        assert without_limits(rounded) is rounded
    test = next(t for t in tests if t.axis == "time" and any("pressure" in c.name for c in t.channels))
    own = next(c for c in test.channels if "pressure" in c.name)
    limit = float(np.quantile(own.value, 0.8))
    clipped = tuple(replace(c, value=np.minimum(c.value, limit)) if c is own else c for c in test.channels)
    kept = without_limits(replace(test, channels=clipped))
    [fault] = kept.faults
    assert (fault.name, fault.channel, fault.value) == ("clipped", own.name, limit)
    assert kept.rows == test.rows - len(fault.rows)
    assert len(fault.rows) > 0.8 * np.sum(own.value > limit)
    # The command is what it was: rows on which it turns stay, though the gauge is at its limit there.
    assert isinstance(kept, DynamicTest)
    assert isinstance(test.time, np.ndarray)
    assert isinstance(kept.time, np.ndarray)
    again = np.interp(test.time[test.run == 0], kept.time[kept.run == 0], kept.command[kept.run == 0])
    np.testing.assert_allclose(again, test.command[test.run == 0], atol=1e-3 * np.ptp(test.command))
