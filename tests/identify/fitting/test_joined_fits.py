"""A record of static and dynamic tests: one result, both covariances, and models of either kind still read."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.fake_fit import fake_fit

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fitting.fit_motion import HELD, joined
from thermohyd.identify.model.model_file import load_model, model_json
from thermohyd.identify.report.fit_json import json_text


def test_both_stand_beside_each_other(seed_fit):
    static = fake_fit()
    both = joined(static, seed_fit)
    assert both.free == (*static.free, *seed_fit.free)
    n = len(static.free)
    np.testing.assert_array_equal(both.covariance[n:, n:], seed_fit.covariance)
    assert not both.covariance[:n, n:].any()
    assert both.parameters["clearance"] == static.parameters["clearance"]
    assert both.parameters["spool_frequency"] == seed_fit.parameters["spool_frequency"]
    assert HELD in both.notes
    assert both.chi2 == pytest.approx(static.chi2 + seed_fit.chi2)


def test_what_both_freed_is_named_once(seed_fit):
    """A diagnosis of motion frees the null bias, which the static tests gave: its model file names it once."""
    static = fake_fit()
    assert "null_bias" in static.free
    again = replace(seed_fit, free=("null_bias", *seed_fit.free[1:]))
    both = joined(static, again)
    assert both.free == (*static.free, *seed_fit.free[1:])
    n = len(static.free)
    np.testing.assert_array_equal(both.covariance[n:, n:], seed_fit.covariance[1:, 1:])
    np.testing.assert_array_equal(both.correlation[n:, n:], seed_fit.correlation[1:, 1:])


def test_a_model_of_static_tests_reads_as_before(tmp_path):
    path = tmp_path / "model.json"
    content = model_json(fake_fit())
    assert "actuator" not in content
    path.write_text(json_text(content), encoding="utf-8")
    model = load_model(path)
    assert model.actuator is None
    assert model.dynamics == {}


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
