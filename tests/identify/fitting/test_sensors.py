"""Fits of readings in volts: gains and zeros found with the rest, their derivatives, priors, and what is only relative."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.small_bench import VALVE, small_record
from helpers.volts import GAIN, PER_VOLT, ZERO, in_volts

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import Sensor
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.library import library_for
from thermohyd.identify.fitting.parameters import Relative, plan_parameters
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.readings import Noise
from thermohyd.identify.fitting.relative import with_relatives
from thermohyd.identify.fitting.row_blocks import plain_by_rows
from thermohyd.identify.fitting.sensed import sensed_channels, sensor_plans, with_starts
from thermohyd.identify.fitting.static_readings import base_valve, static_data
from thermohyd.identify.fitting.static_residuals import FitArgs, plain_residual, prior_rows, residual_and_columns
from thermohyd.identify.model.model_file import load_model, save_model
from thermohyd.identify.model.predict import simulate_record
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.report.fit_json import fit_json, json_text
from thermohyd.identify.report.fit_report import parameter_remarks, parameter_rows


FREE = Sensor("leakage_flow", gain=None, signal="V", free_zero="free")
# Three per cent off, and known to five.
GAUGE = Sensor("load_pressure", gain=0.97 * 40e5, signal="V", tolerance=0.05, zero=ZERO)


@pytest.fixture(scope="module")
def record():
    return in_volts(small_record(seed=5), FREE, GAUGE)


@pytest.fixture(scope="module")
def found(record):
    return fit(record, starts=2)


def test_the_truth_lies_inside_honest_intervals(found):
    assert found.converged, found.message
    truth = {
        n: getattr(VALVE, n) for n in ("edge_radius", "clearance", "underlap", "discharge_coefficient", "null_bias")
    }
    truth |= {"leakage_flow_gain": GAIN, "leakage_flow_zero": ZERO, "load_pressure_gain": 40e5}
    for name, value in truth.items():
        estimate = found.parameters[name]
        assert estimate.std is not None, name
        assert abs(estimate.value - value) < 3.5 * estimate.std, name
    assert found.parameters["load_pressure_gain"].std < 0.2 * 0.05 * 40e5  # the data know more than the data sheet
    assert 0.8 < found.reduced_chi2 < 1.2


def test_units_in_table_and_json(found):
    content = json.loads(json_text(fit_json(found)))
    gain = content["parameters"]["leakage_flow_gain"]
    assert (gain["unit"], gain["relative"], gain["relative_to"]) == ("m**3/s/V", False, None)
    assert content["parameters"]["leakage_flow_zero"]["unit"] == "V"
    assert content["parameters"]["load_pressure_gain"]["prior_std"] == pytest.approx(0.05 * 0.97 * 40e5)
    assert content["channels"]["leakage"]["leakage_flow"]["signal"] == "V"
    assert found.parameters["leakage_flow_gain"].shown.label == "l/min/V"
    assert "V RMS" in found.verdict[1]


def test_a_model_predicts_volts(found, record, tmp_path):
    model = load_model(save_model(found.model, tmp_path / "model.json"))
    assert model.sensors.keys() == {"leakage_flow_gain", "leakage_flow_zero", "load_pressure_gain"}
    table = simulate_record(record, model)["leakage"]
    drawn = next(c for c in found.channels if c.test == "leakage")
    np.testing.assert_allclose(table["leakage_flow_predicted [V]"], drawn.predicted, atol=1e-9)
    np.testing.assert_allclose(table["leakage_flow_predicted_std [V]"], drawn.predicted_std, rtol=1e-6, atol=1e-12)
    pressure = next(c for c in found.channels if c.test == "pressure_gain")
    table = simulate_record(record, model)["pressure_gain"]
    np.testing.assert_allclose(table["load_pressure_predicted [bar]"] * 1e5, pressure.predicted, atol=1e-2)


def started(record: BenchRecord) -> tuple[dict, dict]:
    """(plans, a point off the optimum)"""
    plans = plan_parameters(record.valve, record.start) | sensor_plans(record.tests, record)
    quantities = {key: true_quantity(record, key, behind) for key, behind in sensed_channels(record.tests).items()}
    plans = with_starts(plans, record.tests, quantities)
    return plans, {name: plan.start for name, plan in plans.items() if not plan.fixed}


def true_quantity(record, key, behind):
    """The true quantity of a channel."""
    value = next(c.value for c in record.tests[key[0]].channels if c.name == key[1])
    return (value / behind.sensor.reference + behind.sensor.reference_zero - ZERO) * PER_VOLT[key[1]]


def test_a_regression_finds_sign_size_and_zero(record):
    plans, values = started(record)
    assert values["leakage_flow_gain"] == pytest.approx(GAIN, rel=1e-9)
    assert values["leakage_flow_zero"] == pytest.approx(ZERO, rel=1e-9)
    assert plans["leakage_flow_gain"].lower < GAIN < plans["leakage_flow_gain"].upper < 0.0


def test_columns_are_those_of_forward_mode(record):
    plans, values = started(record)
    free = tuple(values)
    std = {(t.name, c.name): c.std for t in record.tests.values() for c in t.channels if c.std is not None}
    valve = base_valve(record, {name: plan.start for name, plan in plan_parameters(record.valve, {}).items()})
    args = FitArgs(valve, static_data(record.tests, std), *prior_rows([plans[name] for name in free]))
    p = jnp.asarray([values[name] for name in free])
    out, columns = jax.jit(lambda p: residual_and_columns(free, p, args))(p)
    forward = jax.jit(jax.jacfwd(lambda p: plain_residual(free, p, args)))(p)
    np.testing.assert_allclose(np.asarray(columns).T, np.asarray(forward), rtol=1e-7, atol=1e-6 * np.abs(forward).max())
    assert np.isfinite(np.asarray(out)).all()
    by_rows = plain_by_rows(free, args)(np.asarray(p), None)
    np.testing.assert_allclose(by_rows[0], np.asarray(out), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(by_rows[1], np.asarray(columns), rtol=1e-9, atol=1e-9 * np.abs(forward).max())


def test_a_problem_puts_sensors_behind_whitened_residuals(record):
    """The columns of gains and zeros by central differences, of noise with a memory and with rows left out."""
    plans, values = started(record)
    keys = [(t.name, c.name) for t in record.tests.values() for c in t.channels]
    std = {(t.name, c.name): c.std for t in record.tests.values() for c in t.channels if c.std is not None}
    noise = Noise(std, {key: NoiseCorrelation(share=0.6, phi=0.5) for key in keys})
    rows = sum(test.rows for test in record.tests.values())
    problem = Problem(record, record.tests, plans, library_for(record.tests.values()), noise).with_rows(
        np.arange(rows) % 7 != 0
    )
    at = problem.evaluate(values)
    for name in ("leakage_flow_gain", "leakage_flow_zero", "load_pressure_gain"):
        step = 1e-5 * plans[name].info.scale
        up, down = (problem.evaluate({**values, name: values[name] + side * step}).residual for side in (1.0, -1.0))
        np.testing.assert_allclose(at.column(name), (up - down) / (2.0 * step), rtol=1e-6, atol=1e-7 / step)


def test_flows_without_a_scale_are_relative():
    """Both meters free: only the ratio to the discharge coefficient is determined, which is then held."""
    meter = Sensor("flow", gain=None, signal="V", zero=ZERO)
    record = in_volts(small_record(seed=6), Sensor("leakage_flow", gain=None, signal="V", zero=ZERO), meter)
    plans = plan_parameters(record.valve, {}) | sensor_plans(record.tests, record)
    plans = with_relatives(plans, record.tests, record)
    assert plans["discharge_coefficient"].fixed
    relative = plans["flow_gain"].relative
    assert relative is not None
    assert (relative.to, relative.unit, relative.size) == (
        "discharge_coefficient",
        "discharge_coefficient*m**3/s/V",
        0.7,
    )
    assert "discharge coefficient are determined, which is held at 0.7" in relative.why
    # One meter that is known gives the scale.
    one = in_volts(small_record(seed=6), meter)
    plans = with_relatives(plan_parameters(one.valve, {}) | sensor_plans(one.tests, one), one.tests, one)
    assert not plans["discharge_coefficient"].fixed
    assert plans["flow_gain"].relative is None


def test_a_relative_parameter_is_reported_in_its_own_unit(found):
    """Whatever made it so: value, error, interval and covariance stand in that unit."""
    plan = found.parameters["leakage_flow_gain"]
    relative = replace(plan, relative=Relative("discharge_coefficient", "discharge_coefficient*m**3/s/V", 0.7, "words"))
    result = replace(found, parameters={**found.parameters, plan.name: relative})
    content = fit_json(result)
    entry = content["parameters"][plan.name]
    assert entry["relative"]
    assert entry["value"] == pytest.approx(plan.value / 0.7)
    assert entry["std"] == pytest.approx(plan.std / 0.7)
    i = found.free.index(plan.name)
    assert content["covariance"]["matrix"][i][i] == pytest.approx(found.covariance[i, i] / 0.49)
    row = next(row for row in parameter_rows(result) if row.name == plan.name)
    assert (row.unit, row.status) == ("C_q l/min/V", "relative")
    assert float(row.value) == pytest.approx(plan.value * 6e4 / 0.7, rel=1e-2)
    assert f"relative: {plan.name}; words" in parameter_remarks(result)
    table = result.to_dataframe()
    assert table.loc[plan.name, "relative_to"] == "discharge_coefficient"
    assert table.loc[plan.name, "value"] == pytest.approx(plan.value / 0.7)
