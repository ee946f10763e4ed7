"""`thermohyd sensitivity` from end to end: files, JSON, sources, bad input."""

import json
import shutil

import numpy as np
import pytest
from helpers.commands import command
from helpers.report_page import check_text, views_of

from thermohyd.data import sample_record
from thermohyd.identify.sensitivity.factors import FACTORS
from thermohyd.identify.sensitivity.static_figures import OUTPUTS


FEW = ("--evaluations", "2048")
PICTURES = ("sobol", "sobol_along", "drift", "leakage", "pressure_gain", "flow_gain", "information", "next_test")


@pytest.fixture
def run(monkeypatch):
    return command(monkeypatch, "sensitivity", 120)


@pytest.fixture
def model_file(tmp_path):
    """A model.json with a covariance of three parameters, an effect of sweeps and a clearance that grows."""
    from thermohyd.identify.sensitivity.source import seed_model

    seed = seed_model()
    content = {
        "schema": "thermohyd-model/1",
        "valve": {"name": "mine", "stroke": seed.valve.stroke, "slot_width": seed.valve.slot_width},
        "oil": {"viscosity_a": seed.oil.viscosity_a, "viscosity_b": seed.oil.viscosity_b},
        "parameters": seed.parameters,
        "effects": {"thermal_clearance": 4e-9, "hysteresis": 1e-6},
        "covariance": {
            "of": ["clearance", "underlap", "hysteresis"],
            "matrix": [[1e-16, 8e-16, 0.0], [8e-16, 1e-14, 0.0], [0.0, 0.0, 1e-16]],
        },
    }
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    return path


def test_seed_valve_to_files_and_json(run, tmp_path):
    ran = run("--out", tmp_path / "out", "--json", *FEW)
    assert ran.exit_code == 0, ran.stderr
    expected = {".thermohyd.json", "sensitivity.json", "report.html"} | {
        f"{name}.{kind}" for name in PICTURES for kind in ("png", "svg")
    }
    assert {file.name for file in (tmp_path / "out").iterdir()} == expected
    said = json.loads(ran.stdout)
    written = json.loads((tmp_path / "out" / "sensitivity.json").read_text())
    assert said == written
    assert said["sobol"]["evaluations"] == 2048
    assert {entry["factor"] for entry in said["ranking"]} == set(FACTORS) == set(said["factors"])
    assert set(said["figures"]) == {output.name for output in OUTPUTS}
    leak = said["temperature"]["null_leakage"]
    parts = np.sum([leak["parts_per_kelvin"][cause] for cause in leak["parts_per_kelvin"]], axis=0)
    np.testing.assert_allclose(parts, leak["per_kelvin"], rtol=1e-6)
    for text in ("clearance", "discharge_coefficient", "Best next sweep", "written:"):
        assert text in ran.stderr
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("data:image/svg+xml") == len(PICTURES)
    check_text(page)
    assert [len(views) for views in views_of(page)] == [7, 9, 3]  # figures' shares, drifts, tests
    assert "thermohyd sensitivity --out" in page


@pytest.mark.nightly  # a record fitted first
def test_model_with_covariance_and_effects(run, model_file, tmp_path):
    ran = run(model_file, "--out", tmp_path / "out", *FEW)
    assert ran.exit_code == 0, ran.stderr
    content = json.loads((tmp_path / "out" / "sensitivity.json").read_text())
    assert (tmp_path / "out" / "posterior.png").exists()
    posterior = content["posterior"]
    assert posterior["of"] == ["clearance", "underlap"]
    leakage = posterior["figures"]["open_leakage"]
    assert leakage["std"] == pytest.approx(leakage["linear_std"], rel=0.03)
    assert sum(leakage["first_order"]) == pytest.approx(1.0, abs=0.05)
    assert content["information"]["known_from"] == "the fit"
    assert content["information"]["known_std"]["clearance"] == pytest.approx(1e-8)
    assert any("hysteresis" in note for note in content["notes"])
    assert any(content["temperature"]["open_leakage"]["parts_per_kelvin"]["clearance"])


def test_record_with_a_model_takes_the_record_s_conditions(run, model_file):
    ran = run(sample_record("seed_valve"), "--model", model_file, "--json", *FEW)
    assert ran.exit_code == 0, ran.stderr
    at = json.loads(ran.stdout)["conditions"]
    assert at["temperature"] == pytest.approx(313.15, abs=0.1)  # the mean of a thermometer with noise
    assert at["supply_pressures"] == pytest.approx([70e5, 210e5, 315e5], rel=1e-3)


@pytest.mark.nightly  # a record fitted first
def test_record_is_fitted_first(run, tmp_path):
    ran = run(sample_record("seed_valve"), "--json", *FEW)
    assert ran.exit_code == 0, ran.stderr
    content = json.loads(ran.stdout)
    assert content["factors"]["clearance"]["value"] == pytest.approx(2e-6, rel=0.02)
    assert content["information"]["of"] == "the record's own readings"
    for name in content["information"]["known_std"]:
        total = sum(test["share"][name] for test in content["information"]["tests"].values())
        assert total == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "nowhere"),
        (["nowhere.json"], "there is no such file"),
        (["--settings", "nowhere.toml"], "no such file"),
        (["--settings", "wrong.toml"], 'wrong.toml, line 2, [tolerances] clearence: unknown factor "clearence"'),
        (["broken.json"], "is not valid JSON"),
        (["broken.json", "--model", "broken.json"], "is a model already"),
        (["bench"], "leakage.csv"),
    ],
)
def test_bad_input_ends_with_status_2_and_writes_nothing(run, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "wrong.toml").write_text("[tolerances]\nclearence = '1 um'\n")
    shutil.copytree(sample_record("seed_valve"), tmp_path / "bench")
    (tmp_path / "bench" / "leakage.csv").unlink()
    ran = run(*arguments, "--out", tmp_path / "out")
    assert ran.exit_code == 2
    assert ran.stderr.startswith("thermohyd: ")
    assert words in ran.stderr
    assert ran.stdout == ""
    assert not (tmp_path / "out").exists()
