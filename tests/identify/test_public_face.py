"""What `thermohyd.identify` exports, and the face of its results: words, tables, dictionaries, figures, files, models."""

import json
import subprocess
import sys
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest
from helpers.fake_diagnosis import fake_diagnosis
from helpers.fake_fit import fake_fit

import thermohyd
from thermohyd import identify
from thermohyd.data import sample_record
from thermohyd.identify.model.model_file import model_of_fit


def test_every_name_is_there_and_none_hides_a_module():
    for package in (identify, thermohyd):
        for name in package.__all__:
            found = getattr(package, name)
            assert not isinstance(found, ModuleType), name
        assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = identify.nonsense


def test_naming_what_reads_and_studies_brings_no_jax():
    code = (
        "import sys\n"
        "from thermohyd import identify\n"
        "assert not {'jax', 'pandas', 'numpy'} & set(sys.modules)\n"
        "identify.sensitivity_study, identify.servo_study, identify.predict, identify.BenchInputError\n"
        "assert not {'jax', 'pandas', 'numpy'} & set(sys.modules)\n"
        "identify.read_record, identify.BenchRecord, identify.FitResult, identify.DiagnosisResult, identify.Model\n"
        "identify.load_model, identify.save_model\n"
        "assert not {'jax', 'matplotlib'} & set(sys.modules)\n"
    )
    ran = subprocess.run([sys.executable, "-P", "-W", "error", "-c", code], capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")


RESULTS = [fake_fit(), fake_diagnosis("named", points=12), fake_diagnosis("consistent", points=12)]


@pytest.mark.parametrize("result", RESULTS, ids=["fit", "named", "consistent"])
def test_the_face_of_a_result(result, tmp_path):
    text = result.summary()
    assert result.record.name in text or result.headline in text
    assert max(map(len, text.splitlines())) <= 120
    assert "\x1b" not in text
    paths = result.save(tmp_path / "out")
    names = {path.name for path in paths}
    (own,) = names & {"fit.json", "diagnosis.json"}
    assert json.loads((tmp_path / "out" / own).read_text()) == result.to_dict()
    assert all(path.exists() for path in paths)
    assert names >= {"model.json", "report.html"} | {
        f"{name}.{end}" for name in result.figures() for end in ("png", "svg")
    }
    assert result.parameters["clearance"].ci95[0] < result.parameters["clearance"].value
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OSError, match="file"):
        result.save(tmp_path / "file")


@pytest.mark.parametrize("result", RESULTS, ids=["fit", "named", "consistent"])
def test_a_saved_model_is_the_results_model(result, tmp_path):
    result.save(tmp_path)
    assert_same_model(identify.load_model(tmp_path / "model.json"), result.model)
    path = identify.save_model(result.model, tmp_path / "other" / "mine.json")
    assert path == tmp_path / "other" / "mine.json"
    assert_same_model(identify.load_model(path), result.model)


def test_a_model_without_a_fit_is_saved_too(tmp_path):
    record = identify.read_record(sample_record("seed_actuator"))
    model = identify.nominal_model(record)
    assert identify.load_model(identify.save_model(model, tmp_path / "nominal.json")) == model


def assert_same_model(one: identify.Model, other: identify.Model) -> None:
    np.testing.assert_array_equal(np.asarray(one.covariance), np.asarray(other.covariance))
    assert one.learned == other.learned
    assert replace(one, covariance=None) == replace(other, covariance=None)


def test_one_row_per_parameter():
    result = fake_fit()
    table = result.to_dataframe()
    assert list(table.index) == list(result.parameters)
    assert list(table.columns[:5]) == ["value", "unit", "std", "ci95_low", "ci95_high"]
    for name, estimate in result.parameters.items():
        assert table.loc[name, "value"] == estimate.value
        assert (estimate.std is None) == bool(pd.isna(table.loc[name, "std"]))
    assert table["value"].dtype == table["std"].dtype == table["prior_std"].dtype == float


def test_one_row_per_effect():
    result = fake_diagnosis("named", points=12)
    table = result.to_dataframe()
    assert list(table.index) == [effect.name for effect in result.effects]
    assert table.iloc[0]["value"] == result.effects[0].value
    nothing = fake_diagnosis("consistent", points=12).to_dataframe()
    assert (len(nothing), list(nothing.columns)) == (0, list(table.columns))


@pytest.mark.parametrize("result", RESULTS, ids=["fit", "named", "consistent"])
def test_a_notebook_shows_it_escaped(result: Any):
    nasty = replace(result, record=replace(result.record, name="<script>x</script>"))
    html = nasty._repr_html_()
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "clearance" in html
    assert html.count("<table>") == html.count("</table>") >= 1
    assert len(html) < 8000


def test_predictions_have_the_face_too(tmp_path):
    record = identify.read_record(sample_record("seed_valve"))
    short = replace(record, tests={"leakage": record.tests["leakage"]})
    found = identify.predict(identify.nominal_model(record), short)
    assert "leakage_predicted" not in found.to_dict()
    assert "leakage_flow_predicted [l/min]" in found.to_dict()["leakage"]
    assert "leakage_flow" in found.summary()
    assert [path.name for path in found.save(tmp_path)] == ["leakage.csv"]
    with pytest.raises(identify.BenchInputError, match=r"would overwrite the record's own leakage\.csv"):
        found.save(record.folder)
    fit = replace(fake_fit(record=record), covariance=np.zeros_like(fake_fit().covariance))
    own = fit.predict(short).tables["leakage"]["leakage_flow_predicted [l/min]"].to_numpy()
    same = identify.predict(model_of_fit(fit), short).tables["leakage"]["leakage_flow_predicted [l/min]"].to_numpy()
    np.testing.assert_array_equal(own, same)


@pytest.mark.parametrize(
    ("study", "arguments", "words"),
    [
        (identify.sensitivity_study, {"source": 3}, "source is int; expected a record"),
        (identify.servo_study, {"source": fake_fit().model, "model": fake_fit().model}, "source has a model already"),
    ],
)
def test_a_study_of_nothing_known(study, arguments, words):
    with pytest.raises(TypeError, match=words):
        study(**arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"temperatures": []}, "temperatures: one to 12"),
        ({"temperatures": [40.0]}, "of 180 to 500 K"),
        ({"supply_pressure": -1.0}, "supply_pressure: must be positive"),
        ({"amplifier_gain": 0.0}, "amplifier_gain: must be positive"),
        ({"source": "nowhere.json"}, "nowhere.json: there is no such file"),
    ],
)
def test_a_loop_that_cannot_be(arguments, words):
    with pytest.raises(identify.BenchInputError, match=words):
        identify.servo_study(**arguments)
