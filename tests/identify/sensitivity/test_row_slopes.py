"""Derivatives of the three tests against central differences and against forward mode, ideal and with effects."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.conditions import Conditions
from thermohyd.identify.sensitivity.curves import COLUMNS, curve_slopes, nominal_rows, slopes_at, three_tests
from thermohyd.identify.sensitivity.factors import FACTORS, factors_of
from thermohyd.identify.sensitivity.source import seed_model
from thermohyd.identify.sensitivity.varied import LAWS, by_name, valve_of_model, varied


POSITION = np.array([-150e-6, -40e-6, -6e-6, 0.0, 3e-6, 25e-6, 100e-6, 213e-6])
IDEAL = seed_model()
# One effect beside the ports, one in the clearance; and some heat kept.
WITH_EFFECTS = replace(
    IDEAL,
    effects={"thermal_clearance": 4e-9, "bushing_leakage": 1e-13},
    parameters={**IDEAL.parameters, "heat_retention": 0.4, "null_bias": 1.5e-6},
)
# Steps of the differences, about 1e-5 of each factor.
STEPS = dict(
    zip(FACTORS, (2e-10, 2e-11, 2e-10, 1e-5, 1e-3, 2e-11, 1e-7, 2e-9, 1e-5, 1e-5, 1e-3, 1e-5, 50.0, 1e-5), strict=True)
)
LAW_STEP = 1e-2  # K, for each of `LAWS`: at a tenth of it, rounding was 2e-6 of the bulk modulus's column


def rows() -> Conditions:
    column = np.ones(len(POSITION))
    return Conditions(*map(jnp.asarray, (POSITION, 70e5 * column, 2e5 * column, 303.15 + 5.0 * np.arange(len(column)))))


@pytest.fixture(scope="module", params=[IDEAL, WITH_EFFECTS], ids=["ideal", "effects"])
def case(request):
    valve, c = valve_of_model(request.param), rows()
    simulate = jax.jit(lambda values: three_tests(*varied(valve, c, by_name(values, COLUMNS))))
    parts = (c.position, c.supply_pressure, c.return_pressure, c.temperature)
    x, supply, back, warm = map(np.asarray, parts)
    return valve, simulate, *slopes_at(valve, x, supply, back, warm)


def test_columns_agree_with_central_differences(case):
    valve, simulate, _, slopes = case
    start = np.asarray(nominal_rows(valve, len(POSITION)))
    for i, name in enumerate(COLUMNS):
        step = np.zeros_like(start)
        step[i] = STEPS.get(name, LAW_STEP)
        difference = np.asarray(simulate(start + step) - simulate(start - step)) / (2.0 * step[i, 0])
        # The differences' own rounding is worth a change of the reading by about 1e-10 of its largest.
        largest = np.abs(simulate(start)).max(axis=1, keepdims=True)
        size = np.abs(difference).max(axis=1, keepdims=True) + 1e-9 * largest / step[i, 0]
        # Land lengths begin at closing edges; no row stands within a step of one. Worst: second order of the step.
        np.testing.assert_allclose(slopes[:, i] / size, difference / size, atol=2e-6, err_msg=name)


def test_reverse_is_forward(case):
    valve, simulate, readings, slopes = case
    start = nominal_rows(valve, len(POSITION))
    found, push = jax.linearize(simulate, start)
    np.testing.assert_allclose(readings, found, rtol=1e-12, atol=1e-6)
    for i in range(len(COLUMNS)):
        column = np.asarray(push(jnp.zeros_like(start).at[i].set(1.0)))
        # No pressure depends on the slots' width: there both modes give rounding, of a reading per factor.
        rounding = 1e-6 * np.abs(readings).max(axis=1, keepdims=True) / (np.abs(start[i]).max() + 1e-6)
        size = np.abs(slopes[:, i]).max(axis=1, keepdims=True) + np.asarray(rounding)
        np.testing.assert_allclose(slopes[:, i] / size, column / size, atol=1e-9, err_msg=COLUMNS[i])


def test_laws_together_are_the_temperature(case):
    _, _, _, slopes = case
    laws = sum(slopes[:, COLUMNS.index(law)] for law in LAWS)
    growth = sum(float(e.amount) for e in case[0].effects if type(e).__name__ == "ThermalClearance")
    whole = laws + growth * slopes[:, COLUMNS.index("clearance")]
    size = np.abs(slopes[:, COLUMNS.index("temperature")]).max(axis=1, keepdims=True)
    np.testing.assert_allclose(whole / size, slopes[:, COLUMNS.index("temperature")] / size, atol=1e-12)


def test_normalised_sensitivities_of_what_is_known_exactly():
    factors = factors_of(IDEAL, 313.15, 70e5)
    found = curve_slopes(
        valve_of_model(IDEAL), factors, POSITION, temperatures=[313.15, 343.15], supply_pressures=[70e5, 140e5]
    )
    row = {f.name: i for i, f in enumerate(factors)}
    leakage, flow, load = (found.normalised(test) for test in ("leakage", "flow_gain", "pressure_gain"))
    # Every flow is in proportion to the slots' width, and no pressure depends on it.
    np.testing.assert_allclose(leakage[row["slot_width"]], 1.0, rtol=1e-9)
    np.testing.assert_allclose(flow[row["slot_width"]], found.value["flow_gain"] / found.scale("flow_gain"), atol=1e-9)
    np.testing.assert_allclose(load[row["slot_width"]], 0.0, atol=1e-9)
    # A null bias moves the curve, a stroke stretches it.
    for test in ("leakage", "pressure_gain", "flow_gain"):
        moved, stretched = found.slope[test][row["null_bias"]], found.slope[test][row["stroke"]]
        size = np.abs(stretched).max()
        np.testing.assert_allclose(stretched / size, -moved * found.position / 213e-6 / size, atol=1e-9)
    assert not factors[row["null_bias"]].relative
    assert not factors[row["heat_retention"]].relative
    assert len(found.rows_at(343.15, 140e5)) == len(POSITION)
