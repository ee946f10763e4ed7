"""Eq. 6 fitted: exact data give the truth back, and the seed valve's flow curves are met to the error that is stated."""

import doctest
import math

import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.conditions import operating_points
from thermohyd.flow_curve import eq6_flow
from thermohyd.identify import flow_curve_fit as macro_fit
from thermohyd.identify.flow_curve_fit import (
    fit_eq6,
    fit_flow_curve,
    fit_two_terms,
    flow_curve_formulas,
    flow_curve_json,
    two_term_position,
)
from thermohyd.oil import walther_viscosity
from thermohyd.seed_paper import STROKE, VISCOSITIES, seed_valve, temperature_at
from thermohyd.static_tests import control_flow


TEMPERATURES = np.arange(233.15, 343.2, 5.0)
UM = 1e6


@pytest.fixture(scope="module")
def fitted():
    return fit_flow_curve(seed_valve(), TEMPERATURES, supply_pressure=70e5)


def test_exact_curves_give_their_parameters_back():
    viscosity = np.geomspace(30e-6, 3000e-6, 5)
    x = np.linspace(-2e-4, 2e-4, 101)
    truth = np.column_stack([np.linspace(1e-5, 6e-5, 5), np.geomspace(3e-5, 2e-6, 5), np.geomspace(1.3, 5.0, 5)])
    flow = np.array([eq6_flow(x, *row) for row in truth])
    found = fit_eq6(x, flow, np.linspace(340.0, 240.0, 5), viscosity, drop=70e5, degree=4)
    assert np.allclose([fit.values for fit in found.fits], truth, rtol=1e-6)
    assert np.allclose(np.array(found.model.parameters(viscosity)).T, truth, rtol=1e-5)
    assert found.worst < 1e-9


def test_error_against_the_full_model_is_the_one_stated(fitted):
    own = np.array([fit.worst for fit in fitted.fits]) * UM
    smooth = np.array([fit.smooth_worst for fit in fitted.fits]) * UM
    for fit, alone, together in zip(fitted.fits, own, smooth, strict=True):
        print(
            f"{fit.temperature - 273.15:4.0f} degC: Eq. 6 alone {alone:5.2f} um ({alone / 2.13:.2f} % of stroke), "
            f"smooth laws {together:5.2f} um ({together / 2.13:.2f} %)"
        )
    assert all(fit.converged for fit in fitted.fits)
    assert fitted.converged
    assert own.max() == pytest.approx(11.06, abs=0.02)  # 5.2 % of stroke, at -40 degC
    assert smooth.max() == pytest.approx(12.3, abs=0.1)
    warm = TEMPERATURES > 282.0
    assert own[warm].max() < 2.1  # 1 % of stroke
    assert smooth[warm].max() < 2.9


def test_error_bars_are_positive_and_not_wild(fitted):
    for fit in fitted.fits:
        assert np.all(fit.std > 0.0)
        assert np.all(fit.std < 0.2 * np.abs(fit.values))
    assert np.all(fitted.std > 0.0)


def test_smooth_model_has_an_inverse_everywhere(fitted):
    viscosity = np.geomspace(30.01e-6, 3999e-6, 300)[:, None]
    x = np.linspace(-STROKE, STROKE, 41)
    flow = fitted.model.flow(x, viscosity)
    assert np.allclose(fitted.model.position(flow, viscosity), np.broadcast_to(x, flow.shape), rtol=0.0, atol=1e-12)


def test_inverse_against_the_full_model(fitted):
    viscosity = np.array([fit.viscosity for fit in fitted.fits])[:, None]
    missed = np.abs(np.asarray(fitted.model.flow(fitted.position, viscosity)) - fitted.flow).max(axis=1)
    share = missed / np.abs(fitted.flow).max(axis=1)
    print("Q(X) is missed by, % of full-stroke flow:", np.round(100 * share, 2))
    assert share.max() < 0.085
    assert share[TEMPERATURES > 282.0].max() < 0.016


def test_the_law_serves_another_supply_pressure(fitted):
    # Within the range that was fitted: nu/sqrt(3) above 30 cSt.
    warm = np.array([temperature_at(nu) for nu in VISCOSITIES[1:]])
    x = np.linspace(-STROKE, STROKE, 81)
    rows = operating_points(
        jnp.tile(x, len(warm)), supply_pressure=210e5, temperature=jnp.repeat(jnp.asarray(warm), len(x))
    )
    flow = np.asarray(control_flow(seed_valve(), rows)).reshape(len(warm), -1)
    viscosity = np.asarray(walther_viscosity(seed_valve().oil, jnp.asarray(warm)))[:, None]
    missed = np.abs(np.asarray(fitted.model.position(flow, viscosity, 210e5)) - x).max(axis=1) * UM
    print("laws of 70 bar at 210 bar, um:", dict(zip(VISCOSITIES[1:], np.round(missed, 2), strict=True)))
    assert missed.max() < 12.5


def test_plain_formulas_are_the_model(fitted):
    formulas = flow_curve_formulas(fitted, seed_valve().oil)
    for temperature, drop, flow in ((240.0, 70e5, 1e-5), (300.0, 210e5, -1e-4), (340.0, 70e5, 0.0)):
        names = {"T": temperature, "dp": drop, "Q": flow} | {
            name: getattr(math, name) for name in ("log", "log10", "exp", "sqrt", "tanh")
        }
        for name, words in formulas.items():
            names[name] = eval(words.replace("^", "**"), {"__builtins__": {}}, names)
        expected = fitted.model.position(flow, walther_viscosity(seed_valve().oil, jnp.asarray(temperature)), drop)
        assert names["X"] == pytest.approx(float(expected), rel=1e-10, abs=1e-18)


def test_json_says_all(fitted):
    content = flow_curve_json(fitted, seed_valve().oil)
    assert content["worst_error"]["share_of_stroke"] == pytest.approx(fitted.worst / STROKE)
    assert len(content["temperatures"]) == len(TEMPERATURES)
    assert content["temperatures"][0]["X0"]["std"] > 0.0
    assert len(content["coefficients"]["k"]["std"]) == macro_fit.DEGREE + 1


def test_second_term_where_the_literal_form_is_poor(fitted):
    found = fit_two_terms(fitted.position, fitted.flow[0])
    missed = np.abs(np.asarray(two_term_position(found.values, fitted.flow[0])) - fitted.position).max()
    assert missed == pytest.approx(found.worst, rel=1e-9)
    print(f"at 4000 cSt: {UM * fitted.fits[0].worst:.2f} um with one term, {UM * found.worst:.2f} with two")
    assert found.worst < 3.3e-6 < 0.31 * fitted.fits[0].worst


def test_a_null_bias_is_taken_out():
    valve = seed_valve()
    shifted = type(valve)(
        oil=valve.oil,
        stroke=STROKE,
        slot_width=12e-3,
        edge_radius=15e-6,
        clearance=2e-6,
        underlap=15e-6,
        null_bias=4e-6,
    )
    warm = TEMPERATURES[-4:]
    plain, biased = (fit_flow_curve(v, warm, supply_pressure=70e5, degree=2) for v in (valve, shifted))
    assert np.allclose(plain.flow, biased.flow, rtol=1e-9)


def test_too_few_temperatures():
    with pytest.raises(ValueError, match="at least 6 temperatures"):
        fit_flow_curve(seed_valve(), [300.0, 310.0], supply_pressure=70e5)


def test_examples():
    assert doctest.testmod(macro_fit).failed == 0
