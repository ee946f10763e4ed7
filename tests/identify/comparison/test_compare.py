"""Two small benches compared with the short library: what differs is named, what either asks for stands in both; words and files."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import command
from helpers.html_page import Tags
from helpers.small_bench import small_record
from helpers.small_diagnosis import opened

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.sensors import Sensor
from thermohyd.identify.comparison import both_models, study
from thermohyd.identify.comparison.both_models import of_the_bench
from thermohyd.identify.comparison.result import ComparisonResult
from thermohyd.identify.comparison.words import names_of


TOLERANCES = {"leakage_flow": 0.01, "load_pressure": 0.01, "flow": 0.01}


def with_tolerances(record: Any, folder: str) -> Any:
    """A record whose instruments are known to 1 %."""
    tests = {
        name: replace(
            test, channels=tuple(replace(c, sensor=Sensor(c.name, tolerance=TOLERANCES[c.name])) for c in test.channels)
        )
        for name, test in record.tests.items()
    }
    return replace(record, tests=tests, folder=Path(folder))


@pytest.fixture(scope="module")
def compared():
    """Before: nothing wrong. After: 0.3 um more clearance and a leak of the pilot stage."""
    before = with_tolerances(small_record(seed=11), "before")
    after = with_tolerances(small_record({"pilot_leakage": 1e-9}, seed=12, valve={"clearance": 2.7e-6}), "after")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(both_models, "open_case", lambda record, say: opened(record))
        return study.compare(before, after)


@pytest.mark.nightly  # whole diagnoses
def test_what_differs_is_named_and_nothing_else(compared: ComparisonResult):
    assert compared.verdict == "different"
    assert {row.name for row in compared.differing} == {"clearance", "pilot_leakage"}
    assert compared.effects == ("pilot_leakage",)
    for name, truth in (("clearance", 0.3e-6), ("pilot_leakage", 1e-9), ("edge_radius", 0.0)):
        row = compared.row(name)
        assert row.difference is not None
        assert row.std is not None
        assert abs(row.difference - truth) < 3.5 * row.std, name
    assert compared.same_p > compared.level
    with pytest.raises(KeyError, match="nonsense"):
        compared.row("nonsense")


@pytest.mark.nightly  # whole diagnoses
def test_gains_are_one_in_both_and_leave_the_differences(compared: ComparisonResult):
    assert [entry.name for entry in compared.shared] == ["flow_gain", "leakage_flow_gain", "load_pressure_gain"]
    row = compared.row("discharge_coefficient")
    assert row.std is not None
    assert row.std_apart is not None
    assert row.std < 0.5 * row.std_apart
    assert compared.gain < 1.0


@pytest.mark.nightly  # whole diagnoses
def test_words_files_and_json(compared: ComparisonResult, tmp_path: Path):
    text = compared.summary()
    assert "after differs from before in clearance +0.3" in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= 120
    written = {path.name for path in compared.save(tmp_path)}
    assert written == {"compare.json", "report.html", "differences.png", "differences.svg"}
    content = json.loads((tmp_path / "compare.json").read_text())
    assert content == compared.to_dict()
    assert content["verdict"] == "different"
    assert content["differences"]["clearance"]["state"] == "differs"
    assert [record["name"] for record in content["records"]] == ["before", "after"]
    shown = (tmp_path / "report.html").read_text()
    assert "data:image/svg+xml" in shown
    assert "://" not in shown.replace("http://www.w3.org", "")
    words = " ".join(" ".join(Tags(shown).words).split())
    assert "One in both records" in words
    assert compared.to_dataframe().loc["clearance", "state"] == "differs"


def test_what_is_of_the_bench():
    assert of_the_bench("viscosity_shift")
    assert of_the_bench("flowmeter_offset")
    assert of_the_bench("temperature_offset")
    assert not of_the_bench("pilot_leakage")
    assert not of_the_bench("hysteresis")
    assert not of_the_bench("reading_zero|leakage|leakage_flow|")


def test_names_of_records():
    record = small_record()
    at = lambda folder: replace(record, folder=Path(folder))
    assert names_of(at("/bench/before"), at("/bench/after")) == ("before", "after")
    assert names_of(at("/x/valve"), at("/y/valve")) == ("x/valve", "y/valve")
    assert names_of(at("/x/valve"), at("/x/valve")) == ("A", "B")


def test_two_laws_of_an_edge_are_refused():
    record = small_record()
    other = replace(record, valve=replace(record.valve, edge_law="lubrication"), folder=Path("other"))
    with pytest.raises(
        BenchInputError, match='other: has edge_law = "lubrication" where the first record has "orifice"'
    ):
        study.compare(record, other)


def test_the_command_refuses_a_missing_record_and_writes_nothing(monkeypatch, tmp_path: Path):
    ran = command(monkeypatch, "compare", 100)(tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
    assert ran.exit_code == 2
    assert "no such folder" in ran.stderr
    assert len(ran.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.nightly  # whole diagnoses
def test_the_command_shows_writes_and_confesses(monkeypatch, compared: ComparisonResult, tmp_path: Path):
    for result, status in ((compared, 0), (replace(compared, converged=False, message="it ends on a slope"), 1)):
        monkeypatch.setattr("thermohyd.identify.bench.read.read_record", lambda path: path)
        monkeypatch.setattr(study, "compare", lambda a, b, same_bench, progress, result=result: result)
        ran = command(monkeypatch, "compare", 100)("a", "b", "--out", tmp_path, "--json")
        assert ran.exit_code == status
        assert json.loads(ran.stdout) == result.to_dict()
        assert (tmp_path / "report.html").exists()
        assert ("did not converge: it ends on a slope" in ran.stderr) == (status == 1)
