"""A hidden effect, end to end through the command line: named, sized, its model simulated; files whole."""

import json

import pytest
from helpers.short_servo import HIDDEN, write_short_servo
from typer.testing import CliRunner

from thermohyd.identify.cli import jax_setup
from thermohyd.identify.cli.commands import app


pytestmark = pytest.mark.nightly  # a whole diagnosis


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The first half of two runs of servo_2, without its pressures: less to compute."""
    return write_short_servo(tmp_path_factory.mktemp("servo"))


def test_the_delay_is_named_and_its_model_predicts(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(jax_setup, "set_up_jax", lambda: None)
    out = tmp_path / "out"
    ran = CliRunner().invoke(app, ["diagnose", str(bench), "--out", str(out), "--json"])
    assert ran.exit_code == 0, ran.stderr
    found = json.loads((out / "diagnosis.json").read_text())
    assert json.loads(ran.stdout)["verdict"] == found["verdict"] == "named"
    (effect,) = found["effects"]
    truth = json.loads((HIDDEN / "truth.json").read_text())["servo_2"]
    assert effect["name"] == "spool_delay"
    amount = effect["parameter"]
    assert abs(amount["value"] - truth["effects"]["spool_delay"]) < 3.5 * amount["std"]
    for name, value in truth["parameters"].items():
        own = found["fit"]["parameters"][name]
        assert own["std"] is None or abs(own["value"] - value) < 4.0 * own["std"], name
    # The ends of these runs, which are held out, are calm: nothing to close there, and nothing opened.
    assert found["held_out"]["reduced_chi2_after"] < 1.4
    assert found["gap_after"] < 1.2 < found["gap_before"]
    assert {"step.png", "candidates.png", "model.json", "report.html"} <= {file.name for file in out.iterdir()}

    ran = CliRunner().invoke(app, ["simulate", str(bench), "--model", str(out / "model.json"), "--json"])
    assert ran.exit_code == 0, ran.stderr
    columns = json.loads(ran.stdout)["step"]
    gap = [
        a - b for a, b in zip(columns["piston_position [mm]"], columns["piston_position_predicted [mm]"], strict=True)
    ]
    assert sum(g * g for g in gap) / len(gap) < 1.5 * 0.01**2
