"""`simulate`: a fitted model predicts other conditions, with standard deviations that the truth respects."""

import json

import numpy as np
import pandas as pd
import pytest
from helpers.records import synthetic_record
from hypothesis import given, settings, strategies as st
from reference import static_tests as reference
from reference.oil import Oil, walther
from reference.valve import Rows, Valve

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.model.model_file import load_model, model_json, nominal_model
from thermohyd.identify.model.predict import predict_test, simulate_record


VALVE = Valve(12e-3, 8e-6, 2.5e-6, 6e-6, 0.68, 90.0, 1.2e-6)


@pytest.fixture(scope="module")
def fitted():
    return fit(synthetic_record(VALVE, np.random.default_rng(9)), starts=1)


@pytest.fixture
def model_file(fitted, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model_json(fitted)))
    return path


def test_other_conditions_within_the_predicted_error(fitted, model_file):
    model = load_model(model_file)
    test = fitted.record.tests["leakage"]
    warm = type(test)(**{**test.__dict__, "temperature": test.temperature + 15.0, "channels": ()})
    predicted, std = predict_test(model, fitted.record, warm)["leakage_flow"]
    oil = Oil(*walther([[-40.0, 368.28], [100.0, 5.2244]]))
    rows = Rows(warm.spool_position, warm.supply_pressure, warm.return_pressure, warm.temperature)
    true = reference.leakage(VALVE, oil, rows)["leakage_flow"]
    off = np.abs(predicted - true) / std
    print("largest error in predicted standard deviations:", np.max(off))
    assert np.all(std > 0)
    assert np.max(off) < 4.5
    assert np.median(std / predicted) < 0.02


def test_columns_and_units(fitted, model_file):
    tables = simulate_record(fitted.record, load_model(model_file))
    assert set(tables) == {"leakage", "pressure_gain", "flow_gain"}
    table = tables["pressure_gain"]
    assert [*table.columns] == ["load_pressure_predicted [bar]", "load_pressure_predicted_std [bar]"]
    channel = next(c for c in fitted.channels if c.test == "pressure_gain")
    np.testing.assert_allclose(table["load_pressure_predicted [bar]"], channel.predicted * 1e-5, rtol=1e-9)
    np.testing.assert_allclose(table["load_pressure_predicted_std [bar]"], channel.predicted_std * 1e-5, rtol=1e-6)


def test_without_a_fit_there_is_no_standard_deviation(fitted):
    table = simulate_record(fitted.record, nominal_model(fitted.record))["leakage"]
    assert np.all(np.isnan(table["leakage_flow_predicted_std [l/min]"].to_numpy()))


def test_long_logs_are_predicted_in_pieces(fitted, model_file):
    test = fitted.record.tests["leakage"]
    many = 20_000
    fields = ("spool_position", "supply_pressure", "return_pressure", "temperature", "run", "direction")
    long = type(test)(**{**test.__dict__, "channels": (), **{n: np.resize(getattr(test, n), many) for n in fields}})
    reading, std = predict_test(load_model(model_file), fitted.record, long)["leakage_flow"]
    once, _ = predict_test(load_model(model_file), fitted.record, test)["leakage_flow"]
    np.testing.assert_allclose(reading, np.resize(once, many), rtol=1e-12)
    assert np.all(np.isfinite(std))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "other"}, '"schema" must be "thermohyd-model/1"'),
        ({"parameters": {}}, '"parameters" has no "edge_radius"'),
        ({"parameters": {"edge_radius": {"value": "8 um"}}}, "must be a finite number in SI units"),
        ({"parameters": {"edge_radius": {"value": 8.0}}}, "expected 0 to 0.0002 m"),
        ({"oil": {"viscosity_a": 9.0}}, '"oil" has no "viscosity_b"'),
        ({"oil": {"viscosity": 9.0}}, '"oil" has the unknown key "viscosity"'),
        ({"valve": {"stroke": -1.0, "slot_width": 0.012}}, '"valve" "stroke" must be a positive length in m'),
        ({"covariance": {"of": ["clearance"], "matrix": [[1, 2]]}}, "must be 1 rows of 1 numbers"),
    ],
)
def test_a_mistake_in_a_model_file_gets_one_message(model_file, change, message):
    content = json.loads(model_file.read_text()) | change
    model_file.write_text(json.dumps(content))
    with pytest.raises(BenchInputError) as caught:
        load_model(model_file)
    assert message in str(caught.value)
    assert str(model_file) in str(caught.value)
    assert "\n" not in str(caught.value)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)
KEYS = ("schema", "valve", "oil", "parameters", "covariance", "effects", "learned")


@settings(max_examples=150)
@given(st.sampled_from(KEYS), st.text(max_size=8), json_values, st.integers(0, 3000), st.booleans())
def test_a_mangled_model_file_never_gets_a_traceback(content_of_fit, key, name, value, cut, whole):
    path, content = content_of_fit
    mangled = json.loads(content)
    if whole:
        mangled[key] = value
    elif isinstance(mangled.get(key), dict):
        mangled[key][name or next(iter(mangled[key]), "x")] = value
    text = json.dumps(mangled)
    path.write_text(text if cut > 1500 else text[: len(text) - cut])
    said = ""
    try:
        load_model(path)
    except BenchInputError as error:
        said = str(error)
    assert not said or said.isprintable()


@pytest.fixture(scope="module")
def content_of_fit(fitted, tmp_path_factory):
    return tmp_path_factory.mktemp("models") / "model.json", json.dumps(model_json(fitted))


def test_a_table_reads_back_what_simulate_wrote(fitted, model_file, tmp_path):
    table = simulate_record(fitted.record, load_model(model_file))["flow_gain"]
    table.to_csv(tmp_path / "flow_gain.csv", index=False)
    back = pd.read_csv(tmp_path / "flow_gain.csv")
    np.testing.assert_allclose(back.to_numpy(), table.to_numpy())
