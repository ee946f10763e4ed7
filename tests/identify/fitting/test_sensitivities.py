"""Sensitivities along a run against central differences of the run itself, and of the small-signal response."""

from dataclasses import replace

import numpy as np
import pytest

from thermohyd.data import sample_record
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.motion_readings import simulator_of
from thermohyd.identify.fitting.parameters import IN_MOTION, plan_motion


# Of each parameter of motion, relative: friction changes a run so little that short steps would drown in the integrator's.
STEPS = (1e-3, 1e-3, 1e-3, 1e-2)


@pytest.fixture(scope="module")
def simulator():
    record = read_record(sample_record("seed_actuator"))
    assert record.actuator is not None
    plans = plan_motion(record.valve, record.actuator, record.start)
    # Tight: what two runs differ by is known to the tolerance of their steps.
    return replace(simulator_of(record, plans), tolerance=1e-9)


def test_slopes_are_those_of_the_readings(simulator):
    at = np.array([90.0, 0.75, 0.9, 2300.0])
    slopes = simulator.read(IN_MOTION, (), at).slopes
    for i, value in enumerate(at):
        step = np.zeros(4)
        step[i] = STEPS[i] * value
        up, down = (simulator.read(IN_MOTION, (), at + sign * step).values for sign in (1.0, -1.0))
        for key in slopes:
            expected = (up[key] - down[key]) / (2.0 * step[i])
            assert np.linalg.norm(slopes[key][i] - expected) < 2e-3 * np.linalg.norm(expected) + 1e-12, (key, i)


def test_a_run_that_cannot_start_reads_nan(simulator):
    lost = simulator.read(IN_MOTION, (), np.array([90.0, 0.75, 0.9, np.nan]))
    assert lost.failure != 0
    assert np.isnan(lost.values["step", "piston_position"]).all()
