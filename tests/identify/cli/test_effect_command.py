"""`thermohyd effect`, `--without` and `--effects` as a user sees them: what is written, and one line for what is wrong."""

import json

import pytest
from helpers.commands import command
from helpers.fake_diagnosis import fake_diagnosis

from thermohyd.effects.library import find_effect, unregister_effect


TERM = {
    "place": "flow_into_a", "variable": "pressure_rate", "law": "proportional", "value": -2e-12, "unit": "m3/Pa",
    "coefficients": [-2e-12], "range": [-1e6, 1e6], "sentence": "a flow into port A in proportion to dp_A/dt, x: what y does",
    "confirmed_by": "a shorter hose", "gap_closed": 0.9,
}  # fmt: skip


@pytest.fixture
def found(tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps({"verdict": "unexplained", "terms": [TERM]}))
    return path


def test_an_effect_and_its_test_are_written_once(monkeypatch, tmp_path, found):
    effect = command(monkeypatch, "effect", 120)
    done = effect("hose_at_a", "--from", found, "--out", tmp_path / "mine")
    assert done.exit_code == 0, done.output
    assert sorted(file.name for file in (tmp_path / "mine").iterdir()) == ["hose_at_a.py", "test_hose_at_a.py"]
    assert "hose_at_a.py" in done.output
    again = effect("hose_at_a", "--from", found, "--out", tmp_path / "mine")
    assert again.exit_code == 2
    assert "is there already; choose another name or folder" in again.stderr


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("hysteresis", None, 'the library has an effect "hysteresis" already'),
        ("mine", "{}", 'has no "terms"'),
        ("mine", "no", "is not valid JSON"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(monkeypatch, tmp_path, found, name, content, message):
    if content is not None:
        found.write_text(content)
    done = command(monkeypatch, "effect", 120)(name, "--from", found, "--out", tmp_path / "mine")
    assert done.exit_code == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "mine").exists()


@pytest.fixture
def asked(monkeypatch):
    """What `diagnose` was called with."""
    calls = []
    monkeypatch.setattr("thermohyd.identify.cli.several_records.read_record", lambda *_, **__: fake_diagnosis().record)
    monkeypatch.setattr(
        "thermohyd.identify.diagnosis.diagnose.diagnose",
        lambda record, **given: (calls.append((given, find_effect("hose_at_a") is not None)), fake_diagnosis())[1],
    )
    return calls


def test_effects_of_a_folder_are_loaded_and_said_once(monkeypatch, tmp_path, found, asked):
    command(monkeypatch, "effect", 120)("hose_at_a", "--from", found, "--out", tmp_path / "mine")
    try:
        done = command(monkeypatch, "diagnose", 120)(tmp_path, "--effects", tmp_path / "mine")
        assert done.exit_code == 0, done.output
        [(_, there)] = asked
        assert there
        assert done.stderr.count("effects of your own from") == 1
        assert "hose_at_a; that is your code, and it runs in this program" in done.stderr
    finally:
        unregister_effect("hose_at_a")


def test_effects_are_taken_out_by_name(monkeypatch, tmp_path, asked):
    diagnose = command(monkeypatch, "diagnose", 120)
    assert diagnose(tmp_path, "--without", "hysteresis, position_lag").exit_code == 0
    [(given, _)] = asked
    assert given["without"] == ("hysteresis", "position_lag")
    done = diagnose(tmp_path, "--without", "histeresis")
    assert done.exit_code == 2
    assert 'the library has no effect "histeresis"; the nearest is "hysteresis"' in done.stderr
    assert len(asked) == 1
