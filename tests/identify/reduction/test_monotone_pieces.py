"""Monotone pieces of a log: turning points under dither, steps of the conditions, what is swept."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.raw_logs import raw_log

from thermohyd.identify.reduction.monotone_pieces import (
    condition_ids,
    monotone_pieces,
    sweep_axis,
    sweep_ids,
    turning_points,
)
from thermohyd.identify.reduction.sweep_position import smooth_abscissa


def test_dither_turns_nothing():
    test = raw_log(0, runs=2, position_step=0.02, dither=0.02)
    pieces, direction = monotone_pieces(test)
    starts = np.flatnonzero(np.diff(pieces)) + 1
    assert starts == pytest.approx([4000, 8000, 12000], abs=30)
    assert [direction[k] for k in (0, *starts)] == [-1, 1, -1, 1]


def test_a_dwell_is_shared_between_its_pieces():
    x = np.concatenate([np.linspace(0, 1, 500), np.ones(200), np.linspace(1, 0, 500)])
    assert turning_points(x) == pytest.approx([600], abs=5)


def test_small_reversals_are_not_turns():
    x = np.linspace(0, 1, 1000) + 0.005 * np.sin(np.arange(1000) / 20)
    assert turning_points(x) == []
    assert turning_points(np.zeros(100)) == []


def test_conditions_step_once_and_drift_slowly():
    test = raw_log(1, rows=4000)
    rng = np.random.default_rng(1)
    noisy = 1e4 * rng.normal(size=test.rows)
    stepped = replace(test, supply_pressure=np.where(np.arange(test.rows) < 1234, 70e5, 140e5) + noisy)
    assert np.flatnonzero(np.diff(condition_ids(stepped))) + 1 == pytest.approx([1234], abs=2)
    drifting = replace(test, temperature=313 + 3.5 * np.arange(test.rows) / test.rows)
    assert condition_ids(drifting)[-1] == 3
    assert condition_ids(test)[-1] == 0
    restless = replace(test, temperature=313 + 5 * rng.normal(size=test.rows))
    assert condition_ids(restless)[-1] <= 10


def test_sweeps_of_a_table():
    test = raw_log(2, rows=80, runs=2)
    turns = [21, 41, 61]  # of this log's triangle; a new run begins at row 40
    assert list(np.flatnonzero(np.diff(sweep_ids(test))) + 1) == sorted([*turns, 40])
    assert list(np.flatnonzero(np.diff(test.direction)) + 1) == turns


def test_a_load_flow_log_sweeps_the_load():
    test = raw_log(3, rows=4000)
    load = np.tile(np.linspace(-50e5, 50e5, 1000), 4)
    held = replace(test, spool_position=np.repeat([1e-5, 2e-5, 3e-5, 4e-5], 1000), load_pressure=load)
    assert sweep_axis(held) is load
    assert sweep_axis(test) is test.spool_position


def test_the_position_behind_rounding_and_dither():
    test = raw_log(4, position_step=0.02, dither=0.006)
    pieces, _ = monotone_pieces(test)
    abscissa = smooth_abscissa(test.spool_position, pieces)
    truth = np.concatenate([np.linspace(1, -1, 8000), np.linspace(-1, 1, 8000)]) * 1e-4
    assert np.std(test.spool_position - truth) > 0.8e-6
    assert np.std(abscissa.position - truth) < 0.1e-6
    stairs = raw_log(4, position_step=0.02)
    assert smooth_abscissa(stairs.spool_position, monotone_pieces(stairs)[0]).staircase.all()
