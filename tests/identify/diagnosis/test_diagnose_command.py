"""The shell around `diagnose`: which folder gets which files, and what a failure loses (nothing but itself)."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from helpers.fake_diagnosis import fake_diagnosis
from typer.testing import CliRunner

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.cli import jax_setup
from thermohyd.identify.cli.commands import app
from thermohyd.identify.report.diagnosis_page import diagnosis_files


def stand_in(monkeypatch, name: str, **functions) -> None:
    """Put a module of our own in the place of `thermohyd.identify.<name>`."""
    module = ModuleType(f"thermohyd.identify.{name}")
    vars(module).update(functions)
    monkeypatch.setitem(sys.modules, module.__name__, module)


class Bench:
    """A bench whose reader and engine are stand-ins: `kinds` says what becomes of a record, by its folder's name."""

    def __init__(self, kinds: dict[str, str | BaseException]):
        self.kinds = kinds
        self.computed: list[str] = []
        self.learned: list[bool] = []
        self.asked_other_law: list[bool] = []

    def read_record(self, folder: Path):
        if str(folder).endswith("unreadable"):
            raise BenchInputError("no such folder", file=folder)
        return replace(fake_diagnosis(points=4).record, folder=Path(folder))

    def diagnose(self, record, *, learn, model_form, progress):
        self.computed.append(record.folder.name)
        self.learned.append(learn)
        self.asked_other_law.append(model_form)
        progress("working")
        kind = self.kinds.get(record.folder.name, "named")
        if isinstance(kind, BaseException):
            raise kind
        return replace(fake_diagnosis(kind, points=4), record=record)

    def __call__(self, *arguments):
        return CliRunner().invoke(app, ["diagnose", *(str(argument) for argument in arguments)])


@pytest.fixture
def bench(monkeypatch):
    made = Bench({})
    monkeypatch.setattr(jax_setup, "set_up_jax", lambda: None)
    monkeypatch.setenv("COLUMNS", "110")
    monkeypatch.delenv("THERMOHYD_DEBUG", raising=False)
    monkeypatch.setattr("thermohyd.identify.cli.several_records.read_record", made.read_record)
    stand_in(monkeypatch, "diagnosis.diagnose", diagnose=made.diagnose)
    stand_in(
        monkeypatch, "report.diagnosis_page", diagnosis_files=lambda result, model: {"report.html": result.headline}
    )
    return made


def names(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


def test_one_record_writes_into_the_folder_itself(bench, tmp_path, monkeypatch):
    stand_in(monkeypatch, "report.diagnosis_page", diagnosis_files=diagnosis_files)
    ran = bench("valve", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 0, ran.stderr
    assert names(tmp_path / "out") >= {"diagnosis.json", "model.json", "report.html", "leakage.png", "residual_map.svg"}
    assert json.loads(ran.stdout) == json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert json.loads(ran.stdout)["verdict"] == "named"
    assert ran.stderr.startswith("Leakage is 0.64 l/min too high everywhere")
    assert bench.learned == [False]
    assert bench.asked_other_law == [True]
    assert bench("valve", "--no-model-form").exit_code == 0
    assert bench.asked_other_law == [True, False]


def test_several_records_get_a_folder_each(bench, tmp_path):
    bench.kinds = {"b": "consistent"}
    ran = bench(tmp_path / "a", "x/b", "--out", tmp_path / "out", "--json", "--learn")
    assert ran.exit_code == 0, ran.stderr
    assert names(tmp_path / "out") == {"a", "b"}
    assert "report.html" in names(tmp_path / "out" / "b")
    assert [record["folder"] for record in json.loads(ran.stdout)["records"]] == ["a", "b"]
    assert "red. chi2" in ran.stderr
    assert str(tmp_path / "out" / "a" / "report.html") in ran.stderr
    assert bench.learned == [True, True]


def test_without_out_nothing_is_written(bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = bench("a", "other/a")
    assert ran.exit_code == 0, ran.stderr
    assert "red. chi2" in ran.stdout
    assert "thermohyd: warning:" not in ran.stderr
    assert not list(tmp_path.iterdir())


def test_two_folders_of_one_name(bench, tmp_path):
    ran = bench("x/a", "y/a", "--out", tmp_path / "out")
    assert ran.exit_code == 2
    assert ran.stderr.startswith('thermohyd: y/a: has the folder name "a" of another record of this command, x/a')
    assert len(ran.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert bench.computed == []


def test_all_are_read_before_any_is_computed(bench, tmp_path):
    ran = bench("a", "unreadable", "--out", tmp_path / "out")
    assert ran.exit_code == 2
    assert ran.stderr.strip() == "thermohyd: unreadable: no such folder"
    assert bench.computed == []
    assert not (tmp_path / "out").exists()


def test_one_failure_does_not_lose_the_others(bench, tmp_path):
    bench.kinds = {"b": ValueError("singular"), "c": "unexplained"}
    ran = bench("a", "b", "c", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 1
    assert bench.computed == ["a", "b", "c"]
    assert names(tmp_path / "out") == {"a", "c"}
    content = json.loads(ran.stdout)
    assert [record["verdict"] for record in content["records"]] == ["named", "unexplained"]
    assert content["failed"][0]["folder"] == "b"
    assert "1 of 3 records failed: b: the computation failed: ValueError: singular" in ran.stderr


@pytest.mark.parametrize(("error", "status"), [(BenchInputError("no time", file="a.csv"), 2), (ValueError("x"), 1)])
def test_a_single_failure(bench, tmp_path, error, status):
    bench.kinds = {"a": error}
    ran = bench("a", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == status
    assert ran.stdout == ""
    assert len(ran.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_interrupted_between_records(bench, tmp_path):
    bench.kinds = {"b": KeyboardInterrupt()}
    ran = bench("a", "b", "c", "--out", tmp_path / "out")
    assert ran.exit_code == 130
    done = tmp_path / "out" / "a"
    assert ran.stderr == f"thermohyd: interrupted; the files in {done} are complete, nothing else was written\n"
    assert names(tmp_path / "out") == {"a"}


def test_not_converged_is_a_failure_that_still_reports(bench, tmp_path, monkeypatch):
    result = fake_diagnosis("named", points=4)
    result = replace(result, after=replace(result.after, converged=False, message="100 steps were not enough"))
    stand_in(
        monkeypatch, "diagnosis.diagnose", diagnose=lambda record, learn=False, model_form=True, progress=None: result
    )
    ran = bench("a", "--out", tmp_path / "out")
    assert ran.exit_code == 1
    assert "thermohyd: the fit did not converge: 100 steps were not enough" in ran.stderr
    assert "report.html" in names(tmp_path / "out")
