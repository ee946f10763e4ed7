"""`fit.json` holds the keys of docs/bench_format.md section 8.2, in SI, as JSON that any reader accepts."""

import hashlib
import json
from dataclasses import replace
from datetime import datetime
from importlib.metadata import version

import numpy as np
import pytest
from helpers.bench_folder import write_record
from helpers.fake_fit import fake_channel, fake_fit

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.report.fit_json import fit_json, json_text


def test_promised_keys():
    content = json.loads(json_text(fit_json(fake_fit())))
    promised = {
        "parameters",
        "correlation",
        "reduced_chi2",
        "residual_rms",
        "noise",
        "identifiability",
        "rows",
        "seconds",
    }
    assert promised <= set(content)
    radius = content["parameters"]["edge_radius"]
    assert {"value", "unit", "std", "ci95", "at_bound"} <= set(radius)
    assert radius["value"] == pytest.approx(14.93e-6)
    assert radius["unit"] == "m"
    assert content["parameters"]["transition_number"]["at_bound"] is True
    assert content["parameters"]["transition_number"]["std"] is None
    assert content["correlation"]["edge_radius"]["underlap"] == pytest.approx(0.93)
    assert set(content["residual_rms"]) == set(content["noise"]) == {"leakage", "pressure_gain", "flow_gain"}
    assert {"condition_number", "weak_directions"} <= set(content["identifiability"])
    assert content["rows"] == 146_220


def test_what_is_not_finite_becomes_null():
    broken = replace(fake_fit(), reduced_chi2=float("nan"), covariance=np.full((5, 5), np.inf), converged=False)
    text = json_text(fit_json(broken))
    content = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in the JSON"))
    assert content["reduced_chi2"] is None
    assert content["covariance"]["matrix"][0][0] is None
    assert content["converged"] is False


def test_two_ports_make_one_figure_per_test():
    a, b = (fake_channel("pressure_gain", port, noise, 3) for port, noise in (("pressure_a", 3e4), ("pressure_b", 4e4)))
    content = fit_json(fake_fit(channels=(a, b)))
    assert content["noise"]["pressure_gain"] == pytest.approx(np.sqrt(0.5 * (3e4**2 + 4e4**2)))
    assert set(content["channels"]["pressure_gain"]) == {"pressure_a", "pressure_b"}


def test_names_the_record_its_files_oil_geometry_and_conditions(tmp_path):
    folder = write_record(tmp_path / "mine")
    record = read_record(folder / "bench.toml")
    content = fit_json(fake_fit(record=record))
    found = content["record"]
    assert (found["name"], found["path"], found["version"]) == ("test valve", str(folder), version("thermohyd"))
    assert datetime.fromisoformat(found["date"]).tzinfo is not None
    digest = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.iterdir()}
    assert found["files"] == [
        {"name": "bench.toml", "sha256": digest["bench.toml"], "rows": None, "used": None},
        {"name": "leakage.csv", "sha256": digest["leakage.csv"], "rows": 5, "used": 5},
    ]
    assert content["geometry"]["stroke"] == pytest.approx(200e-6)
    assert content["oil"]["name"] == record.oil.name
    assert content["conditions"]["leakage"] == {
        "temperature": pytest.approx([313.15, 313.15]),
        "supply_pressure": pytest.approx([70e5, 70e5]),
        "return_pressure": [0.0, 0.0],
        "spool_position": pytest.approx([-10e-6, 10e-6]),
    }
    assert fit_json(fake_fit())["record"]["name"] == "seed valve, made by hand"
