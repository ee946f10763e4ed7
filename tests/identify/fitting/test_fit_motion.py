"""The fit of the sample actuator: truth inside honest intervals, what is held, and the model file there and back."""

import json
from dataclasses import replace

import numpy as np
import pytest
from reference.sample_actuator import SEED

from thermohyd.data import sample_record
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.test_record import DynamicTest
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.fit_motion import run_fit_motion, within
from thermohyd.identify.fitting.parameters import IN_MOTION
from thermohyd.identify.model.model_file import load_model, model_json, nominal_model
from thermohyd.identify.model.predict import simulate_record
from thermohyd.identify.reduction.bad_rows import beside_the_fit, command_goes_on
from thermohyd.identify.report.fit_json import fit_json, json_text


@pytest.fixture(scope="module")
def seed_record():
    return read_record(sample_record("seed_actuator"))


@pytest.fixture(scope="module")
def seed_fit(seed_record):
    return fit(seed_record)


@pytest.mark.nightly  # a recovery
def test_the_truth_lies_inside_honest_intervals(seed_fit):
    assert seed_fit.converged, seed_fit.message
    assert seed_fit.free == IN_MOTION
    for name in IN_MOTION:
        found, truth = seed_fit.parameters[name], getattr(SEED.jack, name)
        assert found.std is not None
        assert abs(found.value - truth) < 3.5 * found.std, name
        assert found.std < 0.1 * truth, name
    assert 0.9 < seed_fit.reduced_chi2 < 1.1
    assert "explains the dynamic tests" in seed_fit.verdict[0]


def test_the_valve_is_held_at_what_the_record_says(seed_fit):
    for name in ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias"):
        assert seed_fit.parameters[name].fixed
        assert seed_fit.parameters[name].value == pytest.approx(getattr(SEED.valve, name), rel=1e-9)


def test_fit_json_speaks_of_both_tests(seed_fit):
    content = json.loads(json_text(fit_json(seed_fit)))
    assert set(content["channels"]) == {"step", "frequency"}
    assert content["parameters"]["spool_frequency"]["unit"] == "Hz"
    assert content["rows"] == sum(test.rows for test in seed_fit.record.dynamic_tests.values())


def test_model_json_predicts_what_the_fit_drew(seed_fit, seed_record, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json_text(model_json(seed_fit)), encoding="utf-8")
    model = load_model(path)
    assert model.actuator == seed_record.actuator
    assert model.dynamics == pytest.approx({n: seed_fit.parameters[n].value for n in IN_MOTION})
    tables = simulate_record(seed_record, model)
    drawn = {(c.test, c.channel): c for c in seed_fit.channels}
    table, fit = tables["step"], drawn["step", "piston_position"]
    np.testing.assert_allclose(table["piston_position_predicted [mm]"], fit.predicted * 1e3, atol=1e-6)
    np.testing.assert_allclose(table["piston_position_predicted_std [mm]"], fit.predicted_std * 1e3, atol=1e-6)
    phase = tables["frequency"]["phase_predicted [deg]"]
    np.testing.assert_allclose(phase, np.rad2deg(drawn["frequency", "phase"].predicted), atol=1e-6)


def test_without_a_fit_the_table_of_the_actuator_speaks(seed_record):
    model = nominal_model(seed_record)
    assert model.dynamics["spool_frequency"] == 100.0
    assert model.actuator is not None


def test_the_horizon_is_a_share_of_every_run(seed_record):
    test = seed_record.dynamic_tests["step"]
    inside = within(test, 0.3)
    for code in range(3):
        assert np.mean(inside[test.run == code]) == pytest.approx(0.3, abs=0.01)
    assert within(seed_record.dynamic_tests["frequency"], 0.3).all()


def test_spikes_of_a_run_are_left_out_and_named(seed_record, seed_fit):
    """Three bad rows, of which one lies where the command steps: that one is the run's command, and stays."""
    test = seed_record.dynamic_tests["step"]
    channel = test.channels[0]
    quiet = np.array([command_goes_on(test, row) for row in range(test.rows)])
    inside = [row for row in range(6, test.rows - 6) if quiet[row - 6 : row + 7].all()]
    rows = [inside[len(inside) // 3], inside[2 * len(inside) // 3]]
    edge = next(row for row in range(6, test.rows - 6) if not quiet[row] and np.ptp(test.run[row - 6 : row + 7]) == 0)
    value = channel.value.copy()
    value[[*rows, edge]] += 0.3 * np.ptp(value)
    bad = replace(test, channels=(replace(channel, value=value), *test.channels[1:]))
    found = run_fit_motion(replace(seed_record, tests={**seed_record.tests, "step": bad}))
    [fault] = found.tests["step"].faults
    assert (fault.name, fault.channel, fault.masked) == ("outliers", channel.name, True)
    assert [row.line for row in fault.rows] == [int(test.lines[row]) for row in rows]
    kept = found.tests["step"]
    assert isinstance(kept, DynamicTest)
    assert kept.rows == len(kept.command) == test.rows - 2
    assert fault.sentence in found.warnings
    for name in IN_MOTION:
        estimate = seed_fit.parameters[name]
        assert abs(found.values[name] - estimate.value) < 0.5 * estimate.std
    assert not seed_fit.faults


@pytest.mark.parametrize(("channel", "by"), [("amplitude_ratio", 0.3), ("phase", -0.5)])
def test_a_bad_row_of_a_frequency_response_is_left_out_and_named(seed_record, seed_fit, channel, by):
    test = seed_record.dynamic_tests["frequency"]
    modelled = next(c.predicted for c in seed_fit.channels if (c.test, c.channel) == ("frequency", channel))
    own, row = test.channel(channel), test.rows // 2
    assert beside_the_fit({"frequency": test}, {("frequency", channel): modelled - own.value}) == {}
    value = own.value.copy()
    value[row] += by
    bad = replace(test, channels=tuple(replace(c, value=value) if c is own else c for c in test.channels))
    kept = beside_the_fit({"frequency": bad}, {("frequency", channel): modelled - value})["frequency"]
    assert isinstance(kept, DynamicTest)
    assert kept.frequency is not None
    [fault] = kept.faults
    assert (fault.name, fault.channel, [r.line for r in fault.rows]) == ("outliers", channel, [int(test.lines[row])])
    assert kept.rows == len(kept.frequency) == test.rows - 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"actuator": {"piston_aera": 1e-3}}, '"actuator" has the unknown key "piston_aera"'),
        ({"actuator": {"piston_area": -1e-3}}, '"actuator" "piston_area" must be positive'),
        ({"actuator": {"amplifier_gain": 0.01}}, 'needs both "amplifier_gain" and "sensor_gain"'),
        ({"actuator": {"heat": "warm"}}, '"adiabatic" or "isothermal"'),
        ({"dynamics": {"spool_frequency": 0.0}}, '"dynamics" "spool_frequency" must be positive'),
        ({"dynamics": {"spool_frequncy": 80.0}}, '"dynamics" has the unknown key'),
        ({"dynamics": {"spool_frequency": {"value": 80.0, "unit": "kHz"}}}, "SI units, here Hz"),
    ],
)
def test_a_spoiled_model_gets_one_line(seed_fit, tmp_path, change, words):
    path = tmp_path / "model.json"
    content = json.loads(json_text(model_json(seed_fit)))
    path.write_text(json.dumps({**content, **change}), encoding="utf-8")
    with pytest.raises(BenchInputError, match=r".") as raised:
        load_model(path)
    assert words in str(raised.value)
