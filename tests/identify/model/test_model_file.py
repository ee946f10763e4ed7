"""`model.json` with effects and learned terms: what is written reads back, by hand too, and mistakes get one line."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.fake_fit import fake_fit

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fitting.result import ParameterEstimate
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.model_file import load_model, model_json
from thermohyd.identify.report.fit_json import fit_json, json_text


TERM = LearnedTerm("discharge_coefficient", "flow_number", 400.0, 400.0, (0.0, 0.05, -0.01), 6e-6, 1e-6)
ADDED = {"hysteresis": 1.2e-6, "supply_droop": 3e9, "temperature_offset": -2.0}


@pytest.fixture(scope="module")
def fitted():
    """A fit as a diagnosis makes it: effects among the parameters and the free ones."""
    plain = fake_fit()
    estimates = {
        name: ParameterEstimate(name, value, EFFECTS[name].unit, 0.1 * abs(value), None, 0.0, EFFECTS[name].lower, 1e12)
        for name, value in ADDED.items()
    }
    free = (*plain.free, *ADDED)
    std = np.array([(plain.parameters | estimates)[name].std for name in free], dtype=float)
    return replace(
        plain,
        parameters=plain.parameters | estimates,
        free=free,
        covariance=np.diag(std**2),
        correlation=np.eye(len(free)),
    )


@pytest.fixture
def content(fitted):
    return json.loads(json_text(model_json(fitted, [TERM])))


def load(content, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    return load_model(path)


def test_names_are_one_line(content, tmp_path):
    content["valve"]["name"] = content["oil"]["name"] = "a\x1b[31m\nb"
    model = load(content, tmp_path)
    assert model.valve.name == model.oil.name == "a\\x1b[31m b"


def test_what_is_written_reads_back(fitted, content, tmp_path):
    model = load(content, tmp_path)
    assert model.effects == ADDED
    assert set(ADDED).isdisjoint(model.parameters)
    assert model.parameters == {n: e.value for n, e in fitted.parameters.items() if n not in ADDED}
    assert model.free == fitted.free
    np.testing.assert_array_equal(model.covariance, fitted.covariance)
    assert model.learned == (TERM,)
    assert content["learned"][0]["empirical"] is True
    assert content["effects"]["hysteresis"] == {"value": 1.2e-6, "unit": "m", "std": pytest.approx(1.2e-7)}


def test_fit_json_keeps_effects_among_the_parameters(fitted):
    content = json.loads(json_text(fit_json(fitted)))
    assert content["parameters"]["supply_droop"]["value"] == 3e9
    assert content["covariance"]["of"] == list(fitted.free)


def test_a_plain_fit_has_neither(tmp_path):
    content = json.loads(json_text(model_json(fake_fit())))
    assert content["effects"] == {}
    assert "learned" not in content
    assert load(content, tmp_path).effects == {}


def test_written_by_hand(content, tmp_path):
    content["effects"] = {"pilot_leakage": 1e-9, "viscosity_shift": {"value": 0.1}}
    del content["covariance"], content["learned"]
    model = load(content, tmp_path)
    assert model.effects == {"pilot_leakage": 1e-9, "viscosity_shift": 0.1}
    assert model.learned == ()


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ([], '"effects" must be a table; leave it empty for the ideal valve'),
        ({"hysteresys": 1e-6}, '"effects" has no "hysteresys"; did you mean "hysteresis"?'),
        ({"rust": 1.0}, '"effects" has no "rust"; known: supply_edge_wear, return_edge_wear,'),
        ({"hysteresis": {}}, '"effects" "hysteresis" must be a finite number in SI units, not "null"'),
        ({"hysteresis": float("nan")}, '"effects" "hysteresis" must be a finite number in SI units, not "NaN"'),
        ({"hysteresis": "1 um"}, '"effects" "hysteresis" must be a finite number in SI units'),
        ({"hysteresis": 10**400}, '"effects" "hysteresis" must be a finite number in SI units'),
        ({"hysteresis": -1e-6}, '"effects" "hysteresis" is -1e-06 m, expected 0 to 0.0001 m'),
        ({"hysteresis": {"value": 1.0, "unit": "um"}}, '"hysteresis" is in "um"; a model.json is in SI units, here m'),
        ({"hysteresis": {"value": 1.0, "unit": ["um"]}}, "a model.json is in SI units, here m"),
        ({"eccentricity": {"value": 1.2, "unit": "dimensionless"}}, '"eccentricity" is 1.2 1, expected 0 to 1 1'),
        ({"throttle_heating": 1.0}, '"throttle_heating" and "heat_retention" add up to 1.2, more than all the heat'),
    ],
)
def test_a_mistake_in_effects(content, tmp_path, effects, message):
    content["parameters"]["heat_retention"] = 0.2
    content["covariance"] = None
    assert message in said(content | {"effects": effects}, tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quantity": "colour"}, '"learned" entry 1 "quantity" must be one of discharge_coefficient,'),
        ({"variable": 3}, '"learned" entry 1 "variable" must be one of spool_position,'),
        ({"reach": 0.0}, '"learned" entry 1 "reach" must be positive'),
        ({"centre": None}, '"learned" entry 1 "centre" must be a finite number in SI units'),
        ({"coefficients": [0.0, "a"]}, '"learned" entry 1 "coefficients" must be a finite number'),
        ({"coefficients": []}, '"coefficients" must be a list of 1 to 20 numbers'),
        ({"coefficients": [0.0, 1.5]}, "would make discharge_coefficient zero or negative within its reach"),
        ({"colour": 1}, '"learned" entry 1 has the unknown key "colour"'),
    ],
)
def test_a_mistake_in_a_learned_term(content, tmp_path, change, message):
    content["learned"][0] |= change
    assert message in said(content, tmp_path)


def test_a_mistake_in_the_list_of_terms(content, tmp_path):
    assert '"learned" must be a list of terms' in said(content | {"learned": {}}, tmp_path)
    assert '"learned" entry 1 must be a table' in said(content | {"learned": [3]}, tmp_path)


def test_covariance_of_an_effect_that_is_not_there(content, tmp_path):
    del content["effects"]["hysteresis"]
    assert '"covariance" "of" must list names of "parameters" and "effects", each once' in said(content, tmp_path)


def test_a_number_of_thousands_of_digits(tmp_path):
    path = tmp_path / "model.json"
    path.write_text('{"schema": ' + "9" * 5000 + "}")
    with pytest.raises(BenchInputError, match="number of thousands of digits"):
        load_model(path)


def said(content, tmp_path) -> str:
    with pytest.raises(BenchInputError) as caught:
        load(content, tmp_path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_model_of_static_tests_reads_as_before(tmp_path):
    path = tmp_path / "model.json"
    content = model_json(fake_fit())
    assert "actuator" not in content
    path.write_text(json_text(content), encoding="utf-8")
    model = load_model(path)
    assert model.actuator is None
    assert model.dynamics == {}
