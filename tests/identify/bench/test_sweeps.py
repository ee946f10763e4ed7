"""Direction and rate of sweeps: the sign of the last change within the run."""

import numpy as np

from thermohyd.identify.bench.sweeps import first_step_back, sweep_direction, sweep_rate


def test_a_repeated_position_keeps_the_direction_and_first_rows_take_the_first_change():
    position = np.array([5.0, 5.0, 4.0, 4.0, 6.0, 6.0, 6.0, 1.0])
    assert sweep_direction(position, np.zeros(8, int)).tolist() == [-1, -1, -1, -1, 1, 1, 1, -1]


def test_each_run_has_a_direction_of_its_own_also_where_runs_alternate_by_row():
    position = np.array([0.0, 9.0, 1.0, 8.0, 2.0, 7.0])
    run = np.array([0, 1, 0, 1, 0, 1])
    assert sweep_direction(position, run).tolist() == [1, -1, 1, -1, 1, -1]


def test_a_position_that_never_changes_counts_as_upward():
    assert sweep_direction(np.full(3, 2.0), np.zeros(3, int)).tolist() == [1, 1, 1]


def test_rate_is_that_of_the_step_to_the_row_and_survives_repeated_times():
    position = np.array([0.0, 1.0, 3.0, 4.0, 4.0])
    time = np.array([0.0, 1.0, 2.0, 2.0, 4.0])
    assert sweep_rate(position, time, np.zeros(5, int)).tolist() == [1.0, 1.0, 2.0, 2.0, 0.0]
    assert sweep_rate(position, np.zeros(5), np.zeros(5, int)).tolist() == [0.0] * 5


def test_time_that_runs_backwards_is_found_within_a_run_only():
    time = np.array([0.0, 1.0, 0.0, 1.0, 0.5])
    assert first_step_back(time, np.array([0, 0, 1, 1, 1])) == 4
    assert first_step_back(time, np.array([0, 0, 1, 1, 2])) is None
