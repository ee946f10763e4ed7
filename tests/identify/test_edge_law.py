"""The choice of the edge law from bench.toml to model.json: read, fitted with one parameter fewer, carried, refused where wrong."""

import dataclasses
import json

import numpy as np
import pytest
from helpers.records import random_valve, synthetic_record
from reference.valve import Valve

from thermohyd.data import sample_record
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.parameters import identified_by_default, plan_motion, plan_parameters
from thermohyd.identify.model.model_file import load_model, model_of_fit, nominal_model, save_model
from thermohyd.identify.model.predict import simulate
from thermohyd.identify.sensitivity.factors import factors_of


VALVE = Valve(12e-3, 8e-6, 2.5e-6, 6e-6, 0.68, 90.0, 1.2e-6, edge_law="lubrication")


def record_of(valve: Valve, law: str, seed: int = 4):
    record = synthetic_record(valve, np.random.default_rng(seed), points=31)
    return dataclasses.replace(record, valve=dataclasses.replace(record.valve, edge_law=law))


@pytest.fixture(scope="module")
def fitted():
    return fit(record_of(VALVE, "lubrication"))


def test_a_fit_gives_back_its_parameters(fitted):
    assert fitted.converged
    assert 0.9 < fitted.reduced_chi2 < 1.1
    assert fitted.free == ("edge_radius", "clearance", "underlap", "discharge_coefficient", "null_bias")
    assert "transition_number" not in fitted.parameters
    for name in fitted.free:
        estimate, true = fitted.parameters[name], getattr(VALVE, name)
        print(f"{name}: {estimate.value:.5g} +- {estimate.std:.2g}, true {true:.5g}")
        assert abs(estimate.value - true) < 4 * estimate.std


def test_a_model_carries_the_law(fitted, tmp_path):
    model = model_of_fit(fitted)
    path = save_model(model, tmp_path / "model.json")
    again = load_model(path)
    assert again.valve.edge_law == "lubrication"
    assert again.parameters == model.parameters
    assert "transition_number" not in again.parameters
    table = simulate(fitted.record, again).tables["leakage"]
    shown = table[next(c for c in table if c.startswith("leakage_flow_predicted"))].to_numpy(dtype=float)
    expected = next(c.predicted for c in fitted.channels if c.test == "leakage")
    # in litres per minute
    np.testing.assert_allclose(shown / 6e4, expected, rtol=1e-6)
    assert "transition_number" not in {factor.name for factor in factors_of(again, 313.15, 70e5)}


def test_a_model_of_an_earlier_version_has_the_orifice_law(tmp_path):
    record = record_of(random_valve(np.random.default_rng(1)), "orifice")
    path = save_model(nominal_model(record), tmp_path / "model.json")
    content = json.loads(path.read_text())
    assert content["valve"].pop("edge_law") == "orifice"
    path.write_text(json.dumps(content))
    assert load_model(path).valve.edge_law == "orifice"
    content["valve"]["edge_law"] = "turbulent"
    path.write_text(json.dumps(content))
    with pytest.raises(BenchInputError, match='"valve" "edge_law" must be "orifice" or "lubrication"'):
        load_model(path)


def sample_with(tmp_path, law: str, start: str = ""):
    source = sample_record("seed_valve")
    for file in source.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    text = (tmp_path / "bench.toml").read_text()
    (tmp_path / "bench.toml").write_text(text.replace("[valve]", f'[valve]\nedge_law = "{law}"') + start)
    return tmp_path


def test_bench_toml_names_the_law(tmp_path):
    assert read_record(sample_record("seed_valve")).valve.edge_law == "orifice"
    assert read_record(sample_with(tmp_path, "lubrication")).valve.edge_law == "lubrication"


def test_another_word_is_refused(tmp_path):
    with pytest.raises(BenchInputError, match=r'edge_law: "laminar" must be "orifice" or "lubrication"'):
        read_record(sample_with(tmp_path, "laminar"))


def test_a_start_for_what_the_law_lacks_is_refused(tmp_path):
    with pytest.raises(BenchInputError, match='transition_number: the edge law "lubrication" has no such parameter'):
        read_record(sample_with(tmp_path, "lubrication", "\n[start]\ntransition_number = 90\n"))


def test_plans_hold_what_the_law_lacks_and_show_it_nowhere():
    record = read_record(sample_record("seed_actuator"))
    assert record.actuator is not None
    valve = dataclasses.replace(record.valve, edge_law="lubrication")
    assert "transition_number" not in identified_by_default(valve)
    for plans in (plan_parameters(valve, {}), plan_motion(valve, record.actuator, {})):
        plan = plans["transition_number"]
        assert plan.fixed
        assert plan.absent
        assert not plan.shown
    assert plan_parameters(record.valve, {})["transition_number"].shown
