"""Temperature drifts: the parts add up, and each is what an independent change of its cause gives."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.actuator import Actuator, seed_actuator
from thermohyd.actuator_performance import performance
from thermohyd.conditions import operating_points
from thermohyd.identify.sensitivity.curves import COLUMNS, nominal_rows, slopes_at
from thermohyd.identify.sensitivity.drift import CAUSES, performance_drifts, temperature_drifts
from thermohyd.identify.sensitivity.source import seed_model
from thermohyd.identify.sensitivity.varied import valve_of_model
from thermohyd.oil_definition import kinematic_viscosity_of
from thermohyd.static_tests import flow_gain, flow_pressure_gain, leakage_flow, pressure_gain


KELVIN = np.array([253.15, 313.15, 343.15])
SUPPLY = 70e5
COLD = seed_model()
WARM = replace(
    COLD,
    parameters={**COLD.parameters, "heat_retention": 0.7},
    effects={"thermal_clearance": 5e-9, "bushing_leakage": 1e-13},
)


@pytest.fixture(scope="module", params=[COLD, WARM], ids=["isothermal", "heat and effects"])
def found(request):
    return request.param, temperature_drifts(valve_of_model(request.param), KELVIN, SUPPLY)


def test_parts_add_up_exactly(found):
    for drift in found[1].values():
        size = np.abs(drift.parts).sum(axis=0) + 1e-9 * np.abs(drift.value)
        np.testing.assert_allclose(drift.parts.sum(axis=0) / size, drift.slope / size, atol=1e-12, err_msg=drift.name)


def test_values_are_those_of_the_library():
    drifts = temperature_drifts(valve_of_model(COLD), KELVIN, SUPPLY)
    at = operating_points(0.0, supply_pressure=SUPPLY, temperature=jnp.asarray(KELVIN))
    valve = valve_of_model(COLD)
    np.testing.assert_allclose(drifts["null_leakage"].value, leakage_flow(valve, at), rtol=1e-12)
    np.testing.assert_allclose(drifts["null_flow_gain"].value, flow_gain(valve, at), rtol=1e-5)
    np.testing.assert_allclose(drifts["null_pressure_gain"].value, pressure_gain(valve, at), rtol=1e-5)
    np.testing.assert_allclose(drifts["null_flow_pressure_gain"].value, flow_pressure_gain(valve, at), rtol=1e-5)


def test_slopes_agree_with_differences_in_temperature(found):
    model, drifts = found
    above, below = (temperature_drifts(valve_of_model(model), KELVIN + d, SUPPLY) for d in (0.01, -0.01))
    for name, drift in drifts.items():
        difference = (above[name].value - below[name].value) / 0.02
        np.testing.assert_allclose(
            drift.slope, difference, rtol=1e-5, atol=1e-9 * np.abs(drift.value).max(), err_msg=name
        )


def test_performance_drifts_as_its_differences_do(found):
    model, _ = found
    valve, jack = valve_of_model(model), seed_actuator()
    drifts = performance_drifts(valve, jack, KELVIN, SUPPLY)
    values = performance(valve, jack, temperature=jnp.asarray(KELVIN), supply_pressure=SUPPLY)
    above, below = (
        performance(valve, jack, temperature=jnp.asarray(KELVIN + d), supply_pressure=SUPPLY) for d in (0.01, -0.01)
    )
    for name, drift in drifts.items():
        difference = (np.asarray(getattr(above, name)) - np.asarray(getattr(below, name))) / 0.02
        np.testing.assert_allclose(drift.value, getattr(values, name), rtol=1e-12, err_msg=name)
        np.testing.assert_allclose(
            drift.slope, difference, rtol=1e-5, atol=1e-9 * np.abs(drift.value).max(), err_msg=name
        )
        np.testing.assert_allclose(drift.parts.sum(axis=0), drift.slope, rtol=1e-12, err_msg=name)
        if model is COLD:  # what the other causes leave must be nothing where no heat is kept
            heating = drift.parts[CAUSES.index("heating")]
            np.testing.assert_allclose(heating, 0.0, atol=1e-12 * np.abs(drift.value).max(), err_msg=name)


@pytest.mark.parametrize("jack", [Actuator(piston_area_a=12e-4, piston_area_b=8e-4), None])
def test_of_an_unequal_jack_or_of_none_what_is_the_valve_s(jack):
    valve = valve_of_model(COLD)
    found = performance_drifts(valve, jack, KELVIN, SUPPLY)
    assert tuple(found) == ("null_consumption",)
    same = performance_drifts(valve, seed_actuator(), KELVIN, SUPPLY)["null_consumption"]
    for name in ("value", "slope", "parts"):
        np.testing.assert_array_equal(getattr(found["null_consumption"], name), getattr(same, name))


def test_viscosity_part_is_that_of_a_thinner_oil():
    drift = temperature_drifts(valve_of_model(COLD), KELVIN, SUPPLY)["null_leakage"]
    leakage = []
    for change in (-1e-4, 1e-4):
        values = np.array(nominal_rows(valve_of_model(COLD), len(KELVIN)))
        values[COLUMNS.index("viscosity")] += change
        at = np.zeros(3), np.full(3, SUPPLY), np.zeros(3), KELVIN
        leakage.append(slopes_at(valve_of_model(COLD), *at, values)[0][0])
    per_log = (leakage[1] - leakage[0]) / 2e-4
    law = [
        np.log(kinematic_viscosity_of(COLD.oil, t + 0.01) / kinematic_viscosity_of(COLD.oil, t - 0.01)) / 0.02
        for t in KELVIN
    ]
    np.testing.assert_allclose(drift.parts[CAUSES.index("viscosity")], per_log * np.array(law), rtol=1e-6)


def test_clearance_part_is_its_growth():
    wider, tighter = (
        replace(WARM, parameters={**WARM.parameters, "clearance": WARM.parameters["clearance"] + d})
        for d in (1e-10, -1e-10)
    )
    part = temperature_drifts(valve_of_model(WARM), KELVIN, SUPPLY)["open_leakage"].parts[CAUSES.index("clearance")]
    values = [temperature_drifts(valve_of_model(m), KELVIN, SUPPLY)["open_leakage"].value for m in (wider, tighter)]
    np.testing.assert_allclose(part, WARM.effects["thermal_clearance"] * (values[0] - values[1]) / 2e-10, rtol=1e-6)


def test_isothermal_oil_has_no_part_of_heating():
    for drift in temperature_drifts(valve_of_model(COLD), KELVIN, SUPPLY).values():
        np.testing.assert_allclose(drift.parts[CAUSES.index("heating")], 0.0, atol=1e-15 * np.abs(drift.value).max())
