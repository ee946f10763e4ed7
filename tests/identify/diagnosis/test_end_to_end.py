"""`thermohyd diagnose` on kept records whose effect is hidden, as a user runs it; the truth is read here alone."""

import json
import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest


HIDDEN = Path(str(files("thermohyd.data"))) / "hidden"
NOTHING, SINGLE, RIVALS = "bench_27", "bench_76", "bench_69"
SCRIPT = "from thermohyd.identify.cli.commands import main; main()"


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Three records in one command, which share what is compiled."""
    out = tmp_path_factory.mktemp("diagnosis")
    records = [str(HIDDEN / name) for name in (NOTHING, SINGLE, RIVALS)]
    command = [sys.executable, "-P", "-c", SCRIPT, "diagnose", *records, "--out", str(out), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "110"})
    return out, done


@pytest.fixture(scope="module")
def answers(run) -> dict[str, dict]:
    out, done = run
    assert done.returncode == 0, done.stderr
    return {name: json.loads((out / name / "diagnosis.json").read_text()) for name in (NOTHING, SINGLE, RIVALS)}


@pytest.fixture(scope="module")
def truth() -> dict[str, dict]:
    return json.loads((HIDDEN / "truth.json").read_text())


@pytest.mark.nightly  # whole diagnoses
def test_nothing_is_named_where_nothing_is_hidden(answers, truth):
    assert truth[NOTHING]["kind"] == "none"
    assert answers[NOTHING]["verdict"] == "consistent"
    assert answers[NOTHING]["effects"] == []


@pytest.mark.nightly  # whole diagnoses
def test_the_hidden_effect_is_named_with_an_interval_around_its_amount(answers, truth):
    [(name, amount)] = truth[SINGLE]["effects"].items()
    answer = answers[SINGLE]
    assert answer["verdict"] == "named"
    [effect] = answer["effects"]
    assert effect["name"] == name
    assert abs(effect["parameter"]["value"] - amount) < 4.0 * effect["parameter"]["std"]
    assert answer["gap_after"] < answer["gap_before"]


@pytest.mark.nightly  # whole diagnoses
def test_exact_rivals_are_both_said_with_the_next_test(answers, truth):
    [(name, _)] = truth[RIVALS]["effects"].items()
    answer = answers[RIVALS]
    assert answer["verdict"] == "ambiguous"
    [effect] = answer["effects"]
    assert name in {effect["name"], *effect["alternatives"]}
    assert answer["next_test"]


@pytest.mark.nightly  # whole diagnoses
def test_another_effect_in_the_named_ones_place_closes_less_on_rows_held_out(answers):
    for name in (SINGLE, RIVALS):
        held = answers[name]["held_out"]
        assert held["exchange"]
        assert all(closed < held["gap_closed"] - 0.05 for closed in held["exchange"].values())


@pytest.mark.nightly  # whole diagnoses
def test_every_record_has_its_page_its_plots_and_its_model(run, answers):
    out, _ = run
    for name in answers:
        names = {path.name for path in (out / name).iterdir()}
        assert {"report.html", "diagnosis.json", "model.json", "candidates.png", "leakage.svg"} <= names
        assert [n for n in names if n.startswith((".", "tmp"))] == [".thermohyd.json"]


@pytest.mark.nightly  # whole diagnoses
def test_json_goes_to_stdout_and_nothing_else_does(run, answers):
    printed = json.loads(run[1].stdout)
    verdicts = [entry["verdict"] for entry in (printed if isinstance(printed, list) else printed["records"])]
    assert sorted(verdicts) == sorted(answer["verdict"] for answer in answers.values())


def test_a_folder_that_is_no_record_is_one_line_and_writes_nothing(tmp_path):
    command = [sys.executable, "-P", "-c", SCRIPT, "diagnose", str(tmp_path / "none"), "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
