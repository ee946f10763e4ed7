"""What `thermohyd servo` is given: records, models, settings, options, mistakes."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thermohyd.data import sample_record
from thermohyd.identify.sensitivity.settings import Settings
from thermohyd.identify.sensitivity.source import read_source, seed_model
from thermohyd.identify.servo.request import Request, read_request, read_temperatures
from thermohyd.identify.servo.subject import subject_of


@pytest.fixture
def model_file(tmp_path):
    """A model.json with a jack without a controller, a play and a delay."""
    seed = seed_model()
    content = {
        "schema": "thermohyd-model/1",
        "valve": {"name": "mine", "stroke": seed.valve.stroke, "slot_width": seed.valve.slot_width},
        "oil": {"viscosity_a": seed.oil.viscosity_a, "viscosity_b": seed.oil.viscosity_b},
        "parameters": seed.parameters,
        "effects": {"backlash": 1e-6, "spool_delay": 2e-3, "hysteresis": 1e-6, "coulomb_friction": 50.0},
        "actuator": {"piston_area": 20e-4, "chamber_volume": 80e-6, "moving_mass": 80.0},
    }
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    return path


def test_model_with_a_jack_of_its_own(model_file):
    source = read_source(model_file, None, None)
    subject = subject_of(source, read_request("0 40 degC", "2 mm", "140 bar", "0.1 A/V", Settings()))
    assert float(subject.actuator.areas) == pytest.approx(20e-4)
    assert float(subject.actuator.amplifier_gain) == pytest.approx(0.1)
    assert (subject.supply_pressure, subject.return_pressure) == pytest.approx((140e5, 2e5))
    assert subject.margins_without == ("backlash",)
    notes = " ".join(subject.notes)
    for words in (
        "backlash has no small-signal response",
        "hysteresis",
        "Dry friction of 50 N",
        "delay shifts the setpoint",
    ):
        assert words in notes


def test_record_with_a_model_and_settings(model_file, tmp_path):
    (tmp_path / "mine.toml").write_text('[actuator]\nmoving_mass = "30 kg"\n[conditions]\ntemperatures = ["0 degC"]\n')
    source = read_source(sample_record("seed_valve"), model_file, tmp_path / "mine.toml")
    subject = subject_of(source, read_request(None, "2 mm", None, None, source.settings))
    assert subject.temperatures == pytest.approx((273.15,))
    assert subject.supply_pressure == pytest.approx(70e5, rel=1e-2)
    assert float(subject.actuator.moving_mass) == 30.0
    assert float(subject.actuator.areas) == pytest.approx(20e-4)
    assert any("No controller" in note for note in subject.notes)


def test_settings_replace_what_a_model_says_of_a_side(model_file):
    request = read_request("0 40 degC", "2 mm", None, None, Settings())
    sides = {"piston_area_a": 12e-4, "piston_area_b": 8e-4}
    jack = subject_of(replace(read_source(model_file, None, None), settings=Settings(actuator=sides)), request)
    assert jack.actuator.piston_area is None
    assert np.asarray(jack.actuator.areas) == pytest.approx([12e-4, 8e-4])
    assert float(jack.actuator.volumes) == pytest.approx(80e-6)
    assert any("sides are unequal" in note for note in jack.notes)


@pytest.mark.parametrize("text", ["40, -20 ,0 degC", "40 -20 0 °C", "313.15 253.15 273.15 K", "-20 0 40 40 degC"])
def test_lists_of_temperatures(text):
    assert read_temperatures(text) == pytest.approx((253.15, 273.15, 313.15))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "nowhere"),
        (["nowhere.json"], "there is no such file"),
        (["broken.json"], "is not valid JSON"),
        (["--settings", "nowhere.toml"], "no such file"),
        (["--temperatures", "cold"], "is not a list of numbers and a unit"),
        (["--temperatures", "10 20"], "is not a list of numbers and a unit"),
        (["--temperatures", "10 20 bar"], "expected a temperature"),
        (["--temperatures", "-200 20 degC"], "must lie between -93 and 226 degC"),
        (["--temperatures", "1 2 3 4 5 6 7 8 9 10 11 12 13 degC"], "at most 12"),
        (["--step", "5 bar"], "--step"),
        (["--step", "0 mm"], "a step of nothing"),
        (["--step", "30 mm"], "half the piston's stroke, 25 mm"),
        (["--supply", "-10 bar"], "must be positive"),
        (["--supply", "1 bar"], "must be above the return pressure"),
        (["--gain", "3"], "--gain"),
    ],
)
def test_bad_input_ends_with_status_2_and_writes_nothing(run, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.json").write_text("{")
    ran = run(*arguments, "--out", tmp_path / "out")
    assert ran.exit_code == 2
    assert ran.stderr.startswith("thermohyd: ")
    assert len(ran.stderr.splitlines()) == 1
    assert words in ran.stderr
    assert ran.stdout == ""
    assert not (tmp_path / "out").exists()


def test_help_needs_no_jax():
    code = (
        "import sys; from thermohyd.identify.cli import commands, process; from thermohyd.identify.servo import request"
    )
    code += "; assert 'jax' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path.home())
    assert Request((300.0,), 1e-3).supply_pressure is None
