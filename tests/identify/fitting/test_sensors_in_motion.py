"""An unequal jack in a loop of volts: fitted and predicted end to end; commands as signals, and what of a piston is relative."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from reference.dynamic_bench import plain, write

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import Sensor
from thermohyd.identify.diagnosis.diagnose import diagnose
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.motion_runs import CommandSignal, step_runs
from thermohyd.identify.fitting.parameters import IN_MOTION, plan_motion
from thermohyd.identify.fitting.relative import with_relatives
from thermohyd.identify.fitting.sensed import sensed_channels, sensor_plans, traced
from thermohyd.identify.model.model_file import load_model, save_model
from thermohyd.identify.model.predict import simulate_record
from thermohyd.identify.report.fit_json import fit_json, json_text


AREAS = {"piston_area": None, "piston_area_a": 12.5e-4, "piston_area_b": 8.5e-4}
VOLUMES = {"chamber_volume": None, "chamber_volume_a": 55e-6, "chamber_volume_b": 40e-6}
GAIN = 10.0  # mm/V: the loop's 100 V/m
BENCH = plain(
    31,
    steps=(2.0, -1.5),
    seconds=0.2,
    spacing=4e-3,
    adiabatic=False,
    measured=("pressure_a", "piston_position"),
    volts={"piston_position": (GAIN, 0.0)},
    force=6000.0,
)
BENCH = replace(BENCH, jack=replace(BENCH.jack, **AREAS, **VOLUMES))


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> BenchRecord:
    return read_record(write(tmp_path_factory.mktemp("rig") / "rig", BENCH))


@pytest.fixture(scope="module")
def found(record):
    return fit(record)


@pytest.mark.nightly  # a recovery
def test_the_truth_lies_inside_honest_intervals(found):
    assert found.converged, found.message
    assert found.free == (*IN_MOTION, "piston_position_gain")
    truth = {name: getattr(BENCH.jack, name) for name in IN_MOTION} | {"piston_position_gain": GAIN * 1e-3}
    for name, value in truth.items():
        estimate = found.parameters[name]
        assert estimate.std is not None, name
        assert abs(estimate.value - value) < 3.5 * estimate.std, name
    assert found.parameters["piston_position_gain"].std < 0.01 * GAIN * 1e-3
    assert 0.75 < found.reduced_chi2 < 1.25


def test_stated_areas_are_a_scale(found):
    entry = json.loads(json_text(fit_json(found)))["parameters"]["piston_position_gain"]
    assert (entry["unit"], entry["relative"]) == ("m/V", False)


def test_the_model_predicts_volts_in_its_own_loop(found, record, tmp_path):
    model = load_model(save_model(found.model, tmp_path / "model.json"))
    assert model.actuator is not None
    gain = found.parameters["piston_position_gain"].value
    assert model.actuator.sensor_gain == pytest.approx(1.0 / gain)
    assert model.actuator.piston_area_b == pytest.approx(8.5e-4)
    table = simulate_record(record, model)["step"]
    drawn = next(c for c in found.channels if c.channel == "piston_position")
    np.testing.assert_allclose(table["piston_position_predicted [V]"], drawn.predicted, atol=1e-6)
    np.testing.assert_allclose(table["piston_position_predicted_std [V]"], drawn.predicted_std, rtol=1e-4, atol=1e-9)


@pytest.mark.nightly  # a whole diagnosis in motion
def test_a_diagnosis_of_an_unequal_jack_in_volts(record):
    found = diagnose(record)
    assert found.verdict == "consistent", found.headline
    assert found.parameters["piston_position_gain"].value == pytest.approx(GAIN * 1e-3, rel=0.02)


def rig(actuator: dict, sensors: dict, command: str = "setpoint", **columns) -> BenchRecord:
    """A few rows, for what looks at plans only."""
    time = np.linspace(0.0, 0.1, 6)
    given = {"time": time, "command [V]": np.linspace(0.0, 5.0, 6), "piston_position [V]": time, **columns}
    return BenchRecord.from_arrays(
        {"step": given},
        valve={"stroke": 213e-6, "slot_width": 12e-3, "rated_current": 25e-3},
        oil="iso-vg-46",
        conditions={"supply_pressure": 70e5, "temperature": 313.15},
        actuator={"controller": {"amplifier_gain": 0.01}, **actuator},
        sensors=sensors,
        options={"step": {"command": command}},
    )


def plans_of(record: BenchRecord):
    assert record.actuator is not None
    plans = plan_motion(record.valve, record.actuator, {}) | sensor_plans(record.tests, record)
    return with_relatives(plans, record.tests, record)


FREE = {"piston_position": {"gain": "free"}}


def test_lengths_without_a_scale_are_in_strokes():
    plans = plans_of(rig({"piston_stroke": 0.2, "chamber_volume": 2e-4}, FREE))
    relative = plans["piston_position_gain"].relative
    assert relative is not None
    assert (relative.to, relative.unit, relative.size) == ("piston_stroke", "piston_stroke/V", 0.2)
    assert "no piston_area is stated (12 cm^2 stands in)" in relative.why
    assert plans["viscous_friction"].relative is not None
    assert plans["spool_frequency"].relative is None


@pytest.mark.parametrize(
    ("actuator", "sensors", "columns"),
    [
        ({"piston_area": 12e-4}, FREE, {}),
        ({}, {"piston_position": {"gain": "5 mm/V"}}, {}),
        ({}, FREE, {"piston_velocity": np.zeros(6)}),
    ],
)
def test_whatever_has_a_scale_gives_it(actuator, sensors, columns):
    assert not [name for name, plan in plans_of(rig(actuator, sensors, **columns)).items() if plan.relative]


def test_a_measured_output_drives_the_valve():
    sensors = {"piston_position": {"gain": "free", "zero": "each run"}, "command": {"gain": "10 %/V"}}
    actuator = {"controller": {"amplifier_gain": 0.01, "sensor_gain": 100.0}}
    record = rig(actuator, sensors, "controller_output", run=["a", "a", "a", "b", "b", "b"])
    test = record.dynamic_tests["step"]
    (runs,) = step_runs(record.dynamic_tests)
    assert runs.inputs.kind == "spool_position"
    assert runs.signal is None
    np.testing.assert_allclose(test.command, np.linspace(0.0, 0.5, 6) * 213e-6)
    behind = sensed_channels(record.tests)["step", "piston_position"]
    assert behind.names == ("piston_position_gain", "piston_position_zero_step_a", "piston_position_zero_step_b")
    assert traced(record.tests, record) == ()


def test_a_command_of_free_gain_acts_through_its_parameters():
    record = rig({}, {"command": {"gain": "free", "zero": "free"}} | FREE, "controller_output")
    assert traced(record.tests, record) == ("command_gain", "command_zero")
    test = record.dynamic_tests["step"]
    (runs,) = step_runs(record.dynamic_tests)
    assert isinstance(runs.signal, CommandSignal)
    one = step_runs({"step": replace(test, command_sensor=None)})[0].inputs  # the same rows, as they are kept
    given = {"command_gain": jnp.asarray(3e-5), "command_zero": jnp.asarray(0.7)}
    line = runs.signal.acting(one, given).command
    first = lambda t: line.start[0] + jnp.sum(line.bends[0, :, 0] * jnp.maximum(t - line.knots[0], 0.0))
    for t, volts in zip(np.asarray(test.time), np.linspace(0.0, 5.0, 6), strict=True):
        np.testing.assert_allclose(first(t), 3e-5 * (volts - 0.7), rtol=1e-9)


def test_a_sensor_knows_its_signal():
    assert rig({}, FREE).sensors == {"piston_position": Sensor("piston_position", None, "V", in_loop=True)}
