"""A raw log becomes a few hundred points that lie on the curve, with error bars that are honest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from helpers.raw_logs import POSITION, READING, TRUTH, peak, raw_log, steep

from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.reduction.noise_of_logs import LogCorrelation
from thermohyd.identify.reduction.reduce import is_raw_log, reduce_test


REAL = Path(__file__).resolve().parents[4] / "shared" / "real" / "servovalve_5329"


def units(test):
    channel = test.channels[0]
    part = 0.0 if channel.position_part is None else channel.position_part  # as `initial_noise` puts the two together
    return test.spool_position / POSITION, channel.value / READING, np.hypot(channel.std, part) / READING


def averaged(curve, test):
    """The curve's columns as the points of a reduced log see them: means over the nodes of every bin."""
    at = (test.spool_position[:, None] + test.nodes.offset) / POSITION
    return np.sum(curve(at.ravel()).reshape(*at.shape, -1) * test.nodes.weight[:, :, None], axis=1)


@pytest.mark.parametrize("curve", [peak, steep])
def test_points_lie_on_a_sharp_curve(curve):
    """Mean over 20 logs of a point's deviation is its bias: below 0.2 of the point's own std nearly everywhere."""
    grid = np.linspace(-0.99, 0.99, 150)
    bias = np.zeros(len(grid))
    for seed in range(20):
        test = reduce_test(raw_log(seed, curve=curve, noise=0.005))
        x, y, s = units(test)
        deviation = y - averaged(curve, test) @ TRUTH
        down = np.arange(len(x)) < np.argmin(x)
        z = np.interp(grid, x[down][::-1], (deviation / s)[down][::-1])
        bias += z / 20
    # Each mean of 20 scatters by 0.22 (less, where it is interpolated); the bias is what is left on average.
    near = np.abs(grid - 0.02) < 0.15
    assert np.sqrt(max(np.mean(bias[near] ** 2) - 1 / 20, 0.0)) < 0.2
    assert abs(np.mean(bias[near])) < 0.2


def test_noise_free_log_stays_on_the_curve():
    test = reduce_test(raw_log(0, noise=0.0))
    _, y, _ = units(test)
    assert np.abs(y - averaged(peak, test) @ TRUTH).max() < 2e-4


CASES = {
    "white": {},
    "quiet": {"noise": 0.002},
    "short memory": {"memory": 3.0},
    "memory": {"memory": 10.0},
    "long memory": {"memory": 30.0},
    "steep": {"curve": steep},
    "steep, memory": {"curve": steep, "noise": 0.005, "memory": 10.0},
    "dithered position": {"position_step": 0.02, "dither": 0.006},
    "rounded reading": {"reading_step": 0.02},
    "dithered reading": {"reading_step": 0.1, "noise": 0.05},
}
COARSE = {
    "coarse reading": {"reading_step": 0.1, "noise": 0.02},
    "coarse, quiet": {"reading_step": 0.1, "noise": 0.005},
    "coarse, steep": {"reading_step": 0.1, "noise": 0.02, "memory": 10.0, "curve": steep},
    "rounded position": {"position_step": 0.02},
}


def covered(case: dict, seeds: range) -> np.ndarray:
    """Whether the 95 % intervals of the curve's two factors and its shift hold the truth, from points, their std and what neighbouring
    points still share of a noise with a memory."""
    curve = case.get("curve", peak)
    moved = lambda x: (curve(x - 1e-4) - curve(x + 1e-4)) / 2e-4
    inside = []
    for seed in seeds:
        test = reduce_test(raw_log(seed, rows=12000, **case))
        _, y, s = units(test)
        shift = averaged(moved, test) @ TRUTH
        J = np.column_stack([averaged(curve, test), shift]) / s[:, None]
        covariance = np.linalg.inv(J.T @ J)
        z = (y - averaged(curve, test) @ TRUTH) / s
        deviation = covariance @ J.T @ z
        if "memory" in case:
            assert test.rows_of_log is not None
            remembered = LogCorrelation(1.0, float(np.exp(-1.0 / case["memory"])))
            covariance *= 1.0 + 2.0 * remembered.of_neighbours(float(np.median(test.rows_of_log)))
        inside.append(np.abs(deviation) < 1.96 * np.sqrt(np.diag(covariance)))
    return np.array(inside)


@pytest.mark.nightly  # statistics of many fits
def test_intervals_cover_the_truth():
    rates = {name: covered(case, range(8)).mean() for name, case in CASES.items()}
    print("coverage of 95 % intervals:", {name: f"{rate:.2f}" for name, rate in rates.items()})
    assert 0.90 <= np.mean(list(rates.values())) <= 0.985
    assert min(rates.values()) > 0.8


@pytest.mark.parametrize("memory", [0.0, 3.0, 10.0])
def test_points_scatter_as_much_as_they_are_said_to(memory):
    squares = []
    for seed in range(6):
        test = reduce_test(raw_log(seed, rows=12000, memory=memory))
        _, y, s = units(test)
        squares.append(np.mean(((y - averaged(peak, test) @ TRUTH) / s) ** 2))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


@pytest.mark.nightly  # statistics of many fits
def test_coarse_readings_are_not_overbelieved():
    rates = {name: covered(case, range(16)).mean() for name, case in COARSE.items()}
    print("coverage of 95 % intervals:", {name: f"{rate:.2f}" for name, rate in rates.items()})
    assert min(rates.values()) >= 0.9


def test_what_a_point_keeps():
    log = raw_log(1, runs=2, position_step=0.01, dither=0.004)
    points = reduce_test(log)
    assert points.rows <= 700
    assert points.rows_of_log is not None
    assert points.rows_of_log.sum() == log.rows
    assert np.count_nonzero(np.diff(points.run)) == 1
    assert np.count_nonzero(np.diff(points.direction)) == 3  # down, up, down, up; dither turns nothing
    assert points.time is not None
    assert np.all(np.diff(points.time) > 0)
    assert points.rate is not None
    assert np.median(np.abs(points.rate)) == pytest.approx(POSITION * 2 / 40.0, rel=0.02)  # 4000 rows of 0.01 s a piece
    assert np.all(
        np.sign(points.rate[np.abs(points.rate) > POSITION / 40])
        == points.direction[np.abs(points.rate) > POSITION / 40]
    )
    assert points.channels[0].std_source == "scatter of the log's rows"
    assert points.notes[0].startswith("leakage: 16,000 rows -> ")


def test_conditions_are_not_mixed():
    log = raw_log(2)
    supply = np.where(np.arange(log.rows) < 3000, 70e5, 140e5)
    drift = 313.15 + 5.0 * np.arange(log.rows) / log.rows
    points = reduce_test(replace(log, supply_pressure=supply, temperature=drift))
    assert set(np.unique(points.supply_pressure)) == {70e5, 140e5}
    assert np.ptp(points.temperature) == pytest.approx(5.0, abs=0.2)


def test_declared_noise_is_obeyed_and_averaged():
    log = raw_log(3)
    channel = replace(log.channels[0], std=np.full(log.rows, 0.04 * READING), std_source="declared")
    measured, declared = reduce_test(log), reduce_test(replace(log, channels=(channel,)))
    assert declared.channels[0].std_source.startswith("declared")
    # Of a row: where bins end goes with what is known of the noise.
    of_row = lambda points: np.median(points.channels[0].std * np.sqrt(points.rows_of_log))
    assert of_row(declared) / of_row(measured) == pytest.approx(2.0, rel=0.15)


def test_correlation_is_told():
    notes = reduce_test(raw_log(4, memory=20.0)).notes
    assert "independent reading" in notes[1]
    assert "neighbouring rows correlate over 0." in notes[1]  # 20 rows of 0.01 s


def test_other_tests_come_back_as_they_are():
    short = raw_log(5, rows=400)
    assert reduce_test(short) is short
    table = raw_log(5, rows=1200)  # steady readings, evenly spaced: not a log
    assert not is_raw_log(table)
    many_sweeps = raw_log(5, rows=3000, runs=15)
    assert reduce_test(many_sweeps) is many_sweeps
    assert not is_raw_log(raw_log(5, rows=4000, runs=4))  # 500 rows a leg: fitted one by one
    assert is_raw_log(raw_log(5, rows=4000, runs=2))
    assert is_raw_log(raw_log(5, rows=8000, runs=8))  # so many would take too long
    dithered = raw_log(5, rows=1800, position_step=0.01, dither=0.01)
    assert reduce_test(dithered).rows < 450
    points = reduce_test(raw_log(5))
    assert reduce_test(points) is points


@pytest.mark.parametrize("values", [np.zeros, np.ones])
def test_a_reading_that_never_changes_has_no_noise(values):
    log = raw_log(6)
    points = reduce_test(replace(log, channels=(Channel("leakage_flow", values(log.rows)),)))
    assert points.channels[0].std is None
    assert "never changes" in points.notes[1]


def test_standing_readings_have_a_floor():
    log = raw_log(7, curve=steep, noise=0.001, reading_step=0.05)
    _, _, std = units(reduce_test(log))
    assert std.min() > 0.05 / np.sqrt(12) / 3
    assert np.median(std) > 0.05 / np.sqrt(12)


def real_log(name: str, reading: str, factor: float) -> TestRecord:
    if not REAL.is_dir():
        pytest.skip("the real record is not here")
    rows = pd.read_csv(REAL / f"{name}.csv")
    run, names = pd.factorize(rows["run"])
    position = -rows["current [mA]"].to_numpy() / 25.0 * 213e-6
    one = np.ones(len(rows))
    return TestRecord(
        name=name,
        path=REAL / f"{name}.csv",
        spool_position=position,
        supply_pressure=2980 * 6894.757 * one,
        return_pressure=0 * one,
        temperature=313.15 * one,
        channels=(Channel(reading, rows.iloc[:, -1].to_numpy() * factor),),
        run=run,
        run_names=tuple(names),
        direction=np.sign(np.diff(position, prepend=1.0)),
        time=rows["time [s]"].to_numpy(),
        abscissa="current",
    )


@pytest.mark.parametrize(
    ("name", "reading", "factor", "pieces", "phrase"),
    [
        ("leakage", "leakage_flow", 1 / 6e4, 4, "25,176 rows"),
        ("pressure_gain", "load_pressure", 1e5, 3, "bar rest on readings rounded to up to 6.9 bar"),
        ("flow_gain", "flow", 1 / 6e4, 3, "l/min rest on readings rounded to 0.38 l/min"),
    ],
)
def test_the_real_log(name, reading, factor, pieces, phrase):
    points = reduce_test(real_log(name, reading, factor))
    print("\n".join(points.notes))
    assert 200 < points.rows <= 900
    turns = (np.diff(points.direction) != 0) | (np.diff(points.run) != 0)
    assert np.count_nonzero(turns) == pieces - 1
    assert phrase in " ".join(points.notes)
