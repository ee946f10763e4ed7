"""Files that a browser sends: whatever they are called, they lie in the temporary folder, and that goes."""

import gc

import pytest
from helpers.bench_folder import LEAKAGE, TOML

from thermohyd.identify.app import upload
from thermohyd.identify.app.upload import TemporaryHome, refuse_files_elsewhere, safe_parts, write_upload
from thermohyd.identify.bench.errors import BenchInputError


ROWS = LEAKAGE.encode()


@pytest.fixture
def home():
    made = TemporaryHome()
    yield made
    made.remove()


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("leakage.csv", ("leakage.csv",)),
        ("bench 3/log 12:30.csv", ("bench 3", "log 12:30.csv")),
        ("./a//b.csv", ("a", "b.csv")),
        ("a\\b.csv", ("a", "b.csv")),
    ],
)
def test_names_of_files(name, parts):
    assert safe_parts(name) == parts


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../leakage.csv", "leads out of the folder"),
        ("a/../../leakage.csv", "leads out of the folder"),
        ("a\\..\\..\\leakage.csv", "leads out of the folder"),
        ("/etc/passwd", "leads out of the folder"),
        ("\\server\\share", "leads out of the folder"),
        ("", "is no name of a file"),
        ("./", "is no name of a file"),
        ("a\0.csv", "is no name of a file"),
        ("a\n.csv", "is no name of a file"),
        ("/".join("abcdefghij"), "is no name of a file"),
        ("x" * 300, "is too long"),
    ],
)
def test_names_that_are_refused(name, words, home):
    with pytest.raises(BenchInputError, match=words):
        write_upload([("leakage.csv", b""), (name, ROWS)], home)
    assert list(home.dropped.rglob("*")) == []


def test_a_folder_is_the_record_of_its_uppermost_bench_toml(home):
    sent = [
        ("day/valve 7/bench.toml", TOML.encode()),
        ("day/valve 7/logs/leakage.csv", ROWS),
        ("day/valve 7/old/bench.toml", b""),
        ("day/valve 7/.git/config", b"x"),
        ("day/notes.txt", b"x"),
    ]
    found = write_upload(sent, home)
    assert found.record == home.dropped / "valve 7"
    assert found.files == ("bench.toml", "logs/leakage.csv", "old/bench.toml")
    assert sorted(found.left_out) == ["day/notes.txt", "day/valve 7/.git/config"]
    assert found.described
    assert (found.record / "logs" / "leakage.csv").read_bytes() == ROWS


@pytest.mark.parametrize(
    ("names", "record", "files"),
    [
        (["a.csv", "b.csv"], "record", ("a.csv", "b.csv")),
        (["bench/a.csv", "bench/b.csv"], "bench", ("a.csv", "b.csv")),
        (["bench/a.csv", "bench/x/b.csv"], "bench", ("a.csv", "x/b.csv")),
        (["--out/a.csv"], "out", ("a.csv",)),
    ],
)
def test_without_a_bench_toml_it_is_the_dropped_folder(names, record, files, home):
    found = write_upload([(name, ROWS) for name in names], home)
    assert (found.record.name, found.files, found.described) == (record, files, False)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["x/a/bench.toml", "x/b/bench.toml"], r"holds 2 records \(x/a, x/b\); drop the folder of one of them"),
        (["x/a.csv", "x/./a.csv"], '"x/./a.csv" came twice'),
        (["x/a.csv", "X/A.CSV"], '"X/A.CSV" came twice, or in other capitals'),
        (["x/\u00e9.csv", "x/e\u0301.csv"], "came twice"),
        ([f"x/{number}.csv" for number in range(1001)], "is more than 1,000 files or 1,000,000,000 bytes"),
        (["x/.DS_Store"], "holds no file of a record"),
        (["x/a", "x/a/b.csv"], "cannot be written"),
    ],
)
def test_folders_that_are_refused(names, words, home):
    with pytest.raises(BenchInputError, match=words):
        write_upload([(name, ROWS) for name in names], home)


def test_sizes_that_are_refused(home, monkeypatch):
    with pytest.raises(BenchInputError, match=r'"x/bench.toml" is larger than 100,000 bytes'):
        write_upload([("x/bench.toml", b"#" * 100_001)], home)
    monkeypatch.setattr(upload, "MOST_BYTES", 10)
    with pytest.raises(BenchInputError, match="drop the folder of one record"):
        write_upload([("x/a.csv", b"123456"), ("x/b.csv", b"123456")], home)
    assert list(home.dropped.rglob("*")) == []


@pytest.mark.parametrize("file", ["../other/leakage.csv", "/etc/passwd", "a/../../x.csv"])
def test_a_bench_toml_names_no_file_elsewhere(file, home):
    text = TOML.replace("leakage.csv", file)
    record = write_upload([("v/bench.toml", text.encode())], home).record
    with pytest.raises(BenchInputError, match="lies outside the folder that was dropped") as refused:
        refuse_files_elsewhere(record)
    assert home.words(str(refused.value)).startswith("v/bench.toml, line 16, [tests.leakage] file: ")


@pytest.mark.parametrize("text", ["[tests]\nleakage = 3\n", "tests = 1\n", "[tests.leakage]\nfile = 3\n", TOML])
def test_other_mistakes_are_left_to_the_check(text, home):
    refuse_files_elsewhere(write_upload([("v/bench.toml", text.encode())], home).record)


def test_the_folder_goes_with_its_object():
    home = TemporaryHome()
    folder = write_upload([("a.csv", ROWS)], home).record
    assert folder.is_dir()
    assert home.folder.stat().st_mode & 0o077 == 0
    kept = home.folder
    del home
    gc.collect()
    assert not kept.exists()
