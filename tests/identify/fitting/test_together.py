"""Static and dynamic tests of one record, fitted together: one parameter for both, and error bars that are joint."""

import numpy as np
import pytest

from thermohyd.data import sample_record
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit, run_fit, seen_in_motion, static_values
from thermohyd.identify.fitting.fit_motion import run_fit_motion


TRUTH = {
    "edge_radius": 10e-6, "clearance": 2.5e-6, "underlap": 7e-6, "discharge_coefficient": 0.68, "transition_number": 90.0,
    "null_bias": 1.2e-6, "spool_frequency": 78.0, "spool_damping": 0.9, "bulk_modulus_factor": 0.85,
    "viscous_friction": 2400.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def record():
    return read_record(sample_record("whole_servo"))


@pytest.fixture(scope="module")
def together(record):
    return fit(record)


def test_every_parameter_is_within_its_interval(together):
    assert together.converged
    for name, true in TRUTH.items():
        found = together.parameters[name]
        assert abs(found.value - true) < 3.5 * found.std, name


def test_error_bars_are_joint(together):
    """What the valve's parameters may be is passed on to those of motion, and back."""
    i, j = together.free.index("discharge_coefficient"), together.free.index("viscous_friction")
    assert together.covariance[i, j] != 0.0
    assert np.linalg.eigvalsh(together.correlation).min() > 0.0


def test_holding_the_valve_claims_too_much(record, together):
    """The same fit of motion with the valve's parameters held at what the static tests gave has narrower error bars."""
    static = run_fit(record)
    alone = run_fit_motion(record, None, static_values(static), seen_in_motion(static))
    jacobian = alone.solution.jacobian
    for i, name in enumerate(alone.free):
        others = np.delete(jacobian, i, axis=1)
        left = jacobian[:, i] - others @ np.linalg.lstsq(others, jacobian[:, i], rcond=None)[0]
        assert 1.0 / np.linalg.norm(left) < 1.001 * together.parameters[name].std, name


def test_all_tests_are_in_the_result(together, record):
    assert {c.test for c in together.channels} == {*record.tests, *record.dynamic.tests}
    assert together.rows == sum(t.rows for t in (*record.tests.values(), *record.dynamic.tests.values()))
    assert "ideal valve" in together.verdict[0]
    assert any("actuator's model" in line for line in together.verdict)
