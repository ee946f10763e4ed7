"""Files are written whole or not at all."""

import hashlib
import os

import pytest

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.cli.new_record import write_template
from thermohyd.identify.report.files import MANIFEST, Writer, checked_folder, write_all


def everything(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_writes_text_and_bytes_into_a_new_folder_with_subfolders(tmp_path):
    paths = write_all(tmp_path / "a" / "b", {"x.txt": "µ\n", "plots/y.png": b"\x00\x01"})
    assert [path.name for path in paths] == ["x.txt", "y.png"]
    assert everything(tmp_path) == {"a/b/x.txt": "µ\n".encode(), "a/b/plots/y.png": b"\x00\x01"}


def test_replaces_former_files_and_leaves_others(tmp_path):
    (tmp_path / "x.txt").write_text("old")
    (tmp_path / "other").write_text("kept")
    write_all(tmp_path, {"x.txt": "new"})
    assert everything(tmp_path) == {"x.txt": b"new", "other": b"kept"}


@pytest.mark.parametrize("failure", [OSError("disk full"), KeyboardInterrupt()])
@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_a_failure_at_any_rename_leaves_everything_as_it_was(tmp_path, monkeypatch, failure, at):
    (tmp_path / "x.txt").write_text("old x")
    (tmp_path / "y.txt").write_text("old y")
    calls = 0
    replace = os.replace

    def failing(source, target):
        nonlocal calls
        calls += 1
        if calls == at:
            raise failure
        replace(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(type(failure)):
        write_all(tmp_path, {"x.txt": "new x", "y.txt": "new y", "sub/z.txt": "new z"})
    assert everything(tmp_path) == {"x.txt": b"old x", "y.txt": b"old y"}
    assert not (tmp_path / "sub").exists()


def test_a_file_that_cannot_be_written_leaves_no_folder_behind(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match=r"Not a directory|exists"):
        write_all(tmp_path / "new", {"a.txt": "a", "a.txt/b.txt": "b"})
    assert everything(tmp_path) == {"file": b"in the way"}
    assert not (tmp_path / "new").exists()


def names(folder):
    return set(everything(folder)) - {MANIFEST}


def test_leftovers_of_the_same_command_go(tmp_path):
    write_all(tmp_path, {"fit.json": "1", "leakage.png": "a", "flow_gain.png": "b"}, Writer("fit", "/a"))
    (tmp_path / "mine.png").write_text("the user's")
    (tmp_path / "flow_gain.png").write_text("edited by the user")
    write_all(tmp_path, {"fit.json": "2"}, Writer("fit", "/a"))
    assert names(tmp_path) == {"fit.json", "mine.png", "flow_gain.png"}
    write_all(tmp_path, {"fit.json": "3"}, Writer("fit", "/b"))
    assert (tmp_path / "fit.json").read_text() == "3"
    assert names(tmp_path) == {"fit.json", "mine.png", "flow_gain.png"}


def test_fit_and_diagnose_share_a_folder_for_one_record_only(tmp_path):
    fit, diagnosis = (
        {"fit.json": "f", "report.html": "f", "parameters.png": "f"},
        {"diagnosis.json": "d", "report.html": "d"},
    )
    write_all(tmp_path, fit, Writer("fit", "/a"))
    write_all(tmp_path, diagnosis, Writer("diagnose", "/a"))
    assert names(tmp_path) == {"fit.json", "parameters.png", "diagnosis.json", "report.html"}
    write_all(tmp_path, diagnosis, Writer("diagnose", "/b"))
    assert names(tmp_path) == {"diagnosis.json", "report.html"}


def test_other_commands_leave_the_model_that_they_may_have_used(tmp_path):
    write_all(tmp_path, {"model.json": "m"}, Writer("fit", "/a"))
    write_all(tmp_path, {"leakage.csv": "p", "flow_gain.csv": "p"}, Writer("simulate", "/b"))
    write_all(tmp_path, {"leakage.csv": "p2"}, Writer("simulate", "/c"))
    write_all(tmp_path, {"sensitivity.json": "s"}, Writer("sensitivity"))
    assert names(tmp_path) == {"model.json", "leakage.csv", "sensitivity.json"}


@pytest.mark.parametrize(
    "content",
    [
        "not JSON",
        "[]",
        '{"schema": "thermohyd-files/1", "written": 3}',
        '{"schema": "thermohyd-files/1", "written": {"fit": {"of": 3, "files": {"kept": "x"}}}}',
        '{"schema": "another", "written": {"fit": {"of": "/a", "files": {"kept": "HASH"}}}}',
        '{"schema": "thermohyd-files/1", "written": {"fit": {"of": "/a", "files": {"../outside": "HASH"}}}}',
        '{"schema": "thermohyd-files/1", "written": {"fit": {"of": "/a", "files": {"link": "HASH"}}}}',
    ],
)
def test_a_list_that_was_tampered_with_removes_nothing(tmp_path, content):
    folder = tmp_path / "out"
    folder.mkdir()
    for path in (folder / "kept", tmp_path / "outside"):
        path.write_text("mine")
    (folder / "link").symlink_to(folder / "kept")
    (folder / MANIFEST).write_text(content.replace("HASH", hashlib.sha256(b"mine").hexdigest()))
    write_all(folder, {"fit.json": "1"}, Writer("fit", "/a"))
    assert names(folder) == {"kept", "link", "fit.json"}
    assert (tmp_path / "outside").read_text() == "mine"


@pytest.mark.parametrize("at", range(1, 8))
def test_a_failure_brings_leftovers_back_too(tmp_path, monkeypatch, at):
    write_all(tmp_path, {"fit.json": "1", "old.png": "old", "older.png": "older"}, Writer("fit", "/a"))
    before, calls, replace = everything(tmp_path), [], os.replace

    def failing(source, target):
        calls.append(source)
        if len(calls) == at:
            raise OSError("disk full")
        replace(source, target)

    monkeypatch.setattr(os, "replace", failing)
    if at < 7:
        with pytest.raises(OSError, match="disk full"):
            write_all(tmp_path, {"fit.json": "2"}, Writer("fit", "/a"))
        assert everything(tmp_path) == before
    else:
        write_all(tmp_path, {"fit.json": "2"}, Writer("fit", "/a"))
        assert names(tmp_path) == {"fit.json"}


def test_a_checked_folder_is_left_as_it_was(tmp_path):
    assert checked_folder(None) is None
    assert checked_folder(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"
    assert not list(tmp_path.iterdir())


def test_the_template_reads_as_it_stands(tmp_path):
    paths = write_template(tmp_path / "bench")
    assert [path.name for path in paths] == ["bench.toml", "leakage.csv", "pressure_gain.csv", "flow_gain.csv"]
    record = read_record(tmp_path / "bench")
    assert {name: test.rows for name, test in record.tests.items()} == dict.fromkeys(record.tests, 160)
    assert list(record.tests) == ["leakage", "pressure_gain", "flow_gain"]
    assert record.warnings == ()


def test_the_template_overwrites_nothing(tmp_path):
    (tmp_path / "mine.txt").write_text("x")
    with pytest.raises(BenchInputError) as caught:
        write_template(tmp_path)
    assert str(caught.value) == f"{tmp_path}: is not empty; name a new folder, so that nothing is overwritten"
    with pytest.raises(BenchInputError) as caught:
        write_template(tmp_path / "mine.txt")
    assert str(caught.value) == f"{tmp_path / 'mine.txt'}: is a file; name a new folder"
    assert everything(tmp_path) == {"mine.txt": b"x"}


def test_the_commented_lines_of_the_template_read_too(tmp_path):
    write_template(tmp_path / "bench")
    toml = tmp_path / "bench" / "bench.toml"
    lines = toml.read_text().split("\n")
    shown = ("rated_current", "polarity", "name", "density", "expansion", "bulk_modulus", "specific_heat", "ignore")
    shown += ("pressure_viscosity", "supply_pressure", "temperature", "edge_radius", "clearance", "underlap", "[start]")
    shown += ("discharge_coefficient", "transition_number", "null_bias", "heat_retention")
    wanted = [line[2:] if line.startswith("# ") and line[2:].startswith(shown) else line for line in lines]
    assert sum(a != b for a, b in zip(lines, wanted, strict=True)) == len(shown)
    toml.write_text("\n".join(wanted))
    record = read_record(tmp_path / "bench")
    assert record.valve.polarity == -1
    assert len(record.start) == 7
    assert record.start["discharge_coefficient"].fixed
