"""The figures of samples against the library's own gains, their derivatives against differences."""

import jax.numpy as jnp
import numpy as np
import pytest
from reference import static_tests
from reference.oil import Oil, walther
from reference.valve import Effects, Rows, Valve

from thermohyd.conditions import operating_points
from thermohyd.identify.sensitivity.factors import factors_of
from thermohyd.identify.sensitivity.source import seed_model
from thermohyd.identify.sensitivity.static_figures import OUTPUTS, SWEEP, StaticTests
from thermohyd.identify.sensitivity.varied import valve_of_model
from thermohyd.static_tests import flow_gain, pressure_gain


NAMES = [output.name for output in OUTPUTS]
MODEL = seed_model()


@pytest.fixture(scope="module")
def tests():
    return StaticTests(valve_of_model(MODEL), factors_of(MODEL, 313.15, 70e5, 2e5), 313.15, 70e5, 2e5)


@pytest.fixture(scope="module")
def samples(tests):
    low, high = (np.array([getattr(f, end) for f in tests.factors]) for end in ("low", "high"))
    return low + (high - low) * np.random.default_rng(0).random((12, len(low)))


def test_gains_are_those_of_the_library(tests):
    nominal = np.array([[f.value for f in tests.factors]])
    found = dict(zip(NAMES, tests.outputs(nominal)[0][0], strict=True))
    valve = valve_of_model(MODEL)
    at = operating_points(
        jnp.array([0.0, 0.49 * 213e-6]), supply_pressure=70e5, temperature=313.15, return_pressure=2e5
    )
    flow = flow_gain(valve, at)
    assert found["null_pressure_gain"] == pytest.approx(float(pressure_gain(valve, at)[0]), rel=1e-5)
    assert found["null_flow_gain"] == pytest.approx(float(flow[0]), rel=1e-5)
    assert found["half_flow_gain"] == pytest.approx(float(flow[1]), rel=1e-5)
    assert found["peak_leakage"] == found["null_leakage"]


def test_samples_agree_with_the_numpy_reference(tests, samples):
    outputs, sweeps = tests.outputs(samples)
    for row, sample in enumerate(samples):
        s = dict(zip(tests.names, sample, strict=True))
        x = np.array(SWEEP) * s["stroke"]
        column = np.ones_like(x)
        fields = ("slot_width", "edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number")
        valve = Valve(**{name: s[name] for name in fields}, null_bias=s["null_bias"])
        oil = Oil(*walther([[-40.0, 4000.0], [70.0, 30.0]]), density=870.0 * s["density"])
        effects = Effects(throttle_heating=s["heat_retention"], viscosity_shift=s["viscosity"] - 1.0)
        rows = Rows(
            x, s["supply_pressure"] * column, s["return_pressure"] * column, s["temperature"] * column, direction=column
        )
        for i, test in enumerate(("leakage", "pressure_gain", "flow_gain")):
            expected = static_tests.TESTS[test](valve, oil, rows, effects)[static_tests.READING[test]]
            np.testing.assert_allclose(sweeps[row, i], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
        assert outputs[row, NAMES.index("full_flow")] == sweeps[row, 2, -1]


def test_slopes_agree_with_central_differences(tests, samples):
    values, slopes = tests.slopes(samples)
    np.testing.assert_allclose(values, tests.outputs(samples)[0], rtol=1e-9, atol=1e-6)
    for i, factor in enumerate(tests.factors):
        step = np.zeros(len(tests.factors))
        step[i] = 1e-4 * (factor.high - factor.low)
        difference = (tests.outputs(samples + step)[0] - tests.outputs(samples - step)[0]) / (2.0 * step[i])
        # In units of what the whole tolerance would change, the figures themselves at least 1e-3.
        size = np.abs(slopes[:, i]).max(axis=0) + 1e-3 * np.abs(values).max(axis=0) / (factor.high - factor.low)
        np.testing.assert_allclose(slopes[:, i] / size, difference / size, atol=2e-5, err_msg=factor.name)


def test_chunks_do_not_show(tests, samples, monkeypatch):
    whole = tests.outputs(samples)[0]
    monkeypatch.setattr("thermohyd.identify.sensitivity.static_figures.CHUNK", 5)
    # A program for fewer rows rounds in its own way, as does a processor with wider vectors, and a gain is a difference of
    # flows that nearly cancel: 3.2e-12 was seen. A chunk that showed would be another sample's row, wrong in the first digit.
    np.testing.assert_allclose(tests.outputs(samples[:7])[0], whole[:7], rtol=1e-10)
