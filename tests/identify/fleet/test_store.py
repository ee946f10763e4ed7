"""The store: whole files, each result once, older schemas, and what SQL says of it."""

import errno
import json
import os
import re
import resource
import signal
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.fleet_records import stored_row

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fleet import schema
from thermohyd.identify.fleet.query import plain_rows, query
from thermohyd.identify.fleet.store import Store, StoreError


def failure(number: int, **other):
    row = {key: None for key in schema.FAILURES.names} | stored_row(number)
    return (
        {key: row[key] for key in schema.FAILURES.names} | {"kind": "unreadable", "reason": "why", "strikes": 1} | other
    )


def filled(folder: Path, count: int = 6) -> Store:
    store = Store(folder)
    for number in range(count):
        store.write_result(stored_row(number))
    return store


def test_partitions_by_type_and_year(tmp_path):
    store = filled(tmp_path / "store", 2)
    store.write_result(stored_row(2, date=None, type=None))
    places = [path.relative_to(store.folder / "results").parent.as_posix() for path in store.files()]
    undated = "type=unknown/year=__HIVE_DEFAULT_PARTITION__"
    assert places == [
        "type=MOOG%2076%2F1%20%3D%20%C3%A4/year=2020",
        "type=MOOG%2076%2F1%20%3D%20%C3%A4/year=2021",
        undated,
    ]
    table = store.results(["type", "year"]).to_pydict()
    assert table == {"type": ["MOOG 76/1 = ä"] * 2 + ["unknown"], "year": [2020, 2021, None]}
    assert query(store, "SELECT type, year FROM records ORDER BY identity").values.tolist()[1] == [
        "MOOG 76/1 = ä",
        2021,
    ]


def test_putting_files_together_changes_no_result(tmp_path):
    store = filled(tmp_path / "store")
    before = store.results()
    assert store.tidy() == 0  # few files stay as they are
    assert store.tidy(all_of_them=True) == 6
    assert len(store.files()) == 2
    assert store.results().equals(before)
    assert store.done() == {f"{number:032x}" for number in range(6)}
    # somebody killed the process after the common file was there, before the small ones were gone
    store.write_result(stored_row(0))
    assert len(store.results()) == 6
    assert len(query(store, "FROM results")) == 6


def test_a_result_takes_the_place_of_an_earlier_failure(tmp_path):
    store = Store(tmp_path / "store")
    store.write_failure(failure(1))
    store.write_failure(failure(2))
    store.write_result(stored_row(1))
    assert [row["identity"] for row in store.failures()] == [f"{2:032x}"]
    assert query(store, "SELECT reason FROM failures").values.tolist() == [["why"]]


def test_unfinished_files_are_no_results(tmp_path):
    store = filled(tmp_path / "store", 2)
    left = store.files()[0].parent / ".writing-1234"
    left.write_bytes(store.files()[0].read_bytes()[:200])
    assert len(store.results()) == 2
    store.tidy()
    assert not left.exists()


def test_full_disk(tmp_path):
    """A real limit on the size of a file, which the system refuses in the middle of writing."""
    store = filled(tmp_path / "store", 1)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        with pytest.raises(StoreError, match=r"cannot be written .*; free some space, then call again"):
            store.write_result(stored_row(1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert [path.name for path in store.files()[0].parent.parent.rglob("*") if path.is_file()] == [f"{0:032x}.parquet"]


def flipped(content: bytes) -> bytes:
    """The first column's data otherwise, and what says where they are as it was."""
    return content[:4] + bytes(byte ^ 0x5A for byte in content[4:90]) + content[90:]


DAMAGED = {
    "cut short": lambda content: content[: len(content) // 2],
    "empty": lambda content: b"",
    "no Parquet": lambda content: b"PAR1",
    "other data": flipped,
}


@pytest.mark.parametrize("how", DAMAGED)
@pytest.mark.parametrize("kind", ["result", "together", "failure"])
def test_a_damaged_file_is_named_and_the_others_answer(tmp_path, how, kind):
    store = filled(tmp_path / "store")
    for number in (7, 8):
        store.write_failure(failure(number))
    if kind == "together":
        store.tidy(all_of_them=True)
    path = (store.failed_files() if kind == "failure" else store.files())[0]
    path.write_bytes(DAMAGED[how](path.read_bytes()))
    lost = {"result": 1, "together": 3, "failure": 0}[kind]
    for opened in (Store(store.folder), Store(store.folder)):
        assert len(query(opened, "FROM results")) == 6 - lost
        assert len(query(opened, "SELECT * FROM failures")) == (1 if kind == "failure" else 2)
        assert len(query(opened, "FROM parameters")) == 6 - lost
        assert [*opened.set_aside] == [path]
        assert re.match(
            r"cannot be read \(.+\); remove it, and its records are computed again$", opened.set_aside[path]
        )
    opened = Store(store.folder)
    assert (len(opened.results()), len(opened.failures())) == (6 - lost, 1 if kind == "failure" else 2)
    assert opened.tidy(all_of_them=True) == (5 if kind == "result" else 0 if kind == "together" else 6)
    assert [*opened.set_aside] == [path]
    assert len(opened.done()) == 6 - lost
    assert path.exists()


@pytest.mark.parametrize("how", ["columns", "kinds", "folder"])
def test_what_is_no_file_of_a_store_is_set_aside(tmp_path, how):
    store = filled(tmp_path / "store", 2)
    path = store.files()[0].with_name("planted.parquet")
    if how == "folder":
        path = path.parent.with_name("year=next") / path.name
        path.parent.mkdir()
    table = pq.ParquetFile(store.files()[0]).read()
    other = {"columns": table.drop_columns(["job"]), "folder": table}.get(how)
    if other is None:
        other = table.set_column(table.column_names.index("rows"), "rows", pa.array(["x"]))
    pq.write_table(other, path)
    opened = Store(store.folder)
    assert len(opened.results()) == 2
    assert [*opened.set_aside] == [path]
    opened = Store(store.folder)
    assert len(query(opened, "FROM results")) == 2


@pytest.mark.parametrize("how", DAMAGED)
def test_a_damaged_file_of_an_older_store_does_not_stop_it(tmp_path, how):
    store = filled(tmp_path / "store", 2)
    path = store.files()[0]
    path.write_bytes(DAMAGED[how](path.read_bytes()))
    (store.folder / "store.json").write_text(json.dumps({"schema": 1}))
    opened = Store(store.folder)
    assert [*opened.set_aside] == [path]
    assert len(query(opened, "FROM results")) == 1


# What SQL can do to files, networks and settings; {file}: another file, {new}: one that is not there, {store}: the store's own.
HOSTILE = [
    "FROM read_csv('{file}')",
    "FROM '{file}'",
    "FROM read_text('{file}')",
    "FROM read_blob('{file}')",
    "FROM read_json('{file}')",
    "FROM sniff_csv('{file}')",
    "FROM query_table('{file}')",
    "FROM glob('/*')",
    "FROM read_parquet('{store}')",
    "FROM parquet_metadata('{store}')",
    "FROM 'http://127.0.0.1:9/x.csv'",
    "COPY results TO '{new}'",
    "COPY (SELECT 1) TO '{new}' (FORMAT parquet)",
    "COPY (SELECT 1 AS identity) TO '{store}' (FORMAT parquet)",
    "EXPORT DATABASE '{new}'",
    "IMPORT DATABASE '{new}'",
    "ATTACH '{new}'",
    "INSTALL httpfs",
    "FORCE INSTALL httpfs FROM 'http://127.0.0.1:9'",
    "LOAD httpfs",
    "LOAD '{new}'",
    "UPDATE EXTENSIONS",
    "CREATE SECRET s (TYPE HTTP, BEARER_TOKEN 'a')",
    "CREATE PERSISTENT SECRET s (TYPE HTTP, BEARER_TOKEN 'a')",
    "FROM duckdb_secrets()",
    "SELECT getenv('HOME')",
    "SET enable_external_access = true",
    "RESET enable_external_access",
    "PRAGMA enable_external_access = true",
    "SET lock_configuration = false",
    "SET temp_directory = '{new}'",
    "SET home_directory = '/'",
    "SET allowed_directories = ['/']",
    "SET python_enable_replacements = true",
    "PRAGMA enable_profiling = 'json'",
    "PRAGMA profiling_output = '{new}'",
    "SET log_query_path = '{new}'",
    "CALL enable_logging(storage = 'file', storage_path = '{new}')",
    "CREATE OR REPLACE VIEW results AS FROM read_csv('{file}')",
    "SELECT 1; COPY (SELECT 1) TO '{new}'",
    "FROM sql",
    "FROM HOSTILE",
    "DELETE FROM results",
    "INSERT INTO files_of_results SELECT * FROM files_of_results",
]


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_a_question_reads_and_writes_nothing_but_the_store(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    (tmp_path / "secret.csv").write_text("a,b\n1,2\n")
    store = filled(tmp_path / "store", 2)
    before = everything(tmp_path)
    places = {"file": tmp_path / "secret.csv", "new": tmp_path / "here" / "new", "store": store.files()[0]}
    for sql in HOSTILE:
        with pytest.raises(BenchInputError, match="the question cannot be answered"):
            query(store, sql.format(**places))
    assert everything(tmp_path) == before
    assert [*(tmp_path / "here").iterdir()] == []
    assert store.set_aside == {}
    assert len(query(store, "SELECT r.identity FROM records AS r JOIN results USING (identity)")) == 2


def test_no_folder_of_another_kind(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(BenchInputError, match="holds other files"):
        Store(tmp_path)
    with pytest.raises(BenchInputError, match="is no fleet's store"):
        Store(tmp_path / "nowhere", make=False)
    assert not (tmp_path / "nowhere").exists()


def test_newer_schema_is_refused(tmp_path):
    store = filled(tmp_path / "store", 1)
    (store.folder / "store.json").write_text(json.dumps({"schema": 99}))
    with pytest.raises(BenchInputError, match=r"has schema 99, but this program knows up to .*: update thermohyd"):
        Store(store.folder)


def test_one_run_at_a_time(tmp_path):
    store = Store(tmp_path / "store")
    with store.held(), pytest.raises(BenchInputError, match="another run of this store"), Store(store.folder).held():
        pass
    with store.held():
        pass


def test_views(tmp_path):
    store = filled(tmp_path / "store", 3)
    later = datetime(2099, 1, 1)
    # the same record of a newer program; a diagnosis of it; the same folder with other content
    store.write_result(stored_row(10, content="content 0", path="/records/0", version="2", written=later))
    store.write_result(stored_row(11, content="content 1", path="/records/1", job="diagnose"))
    store.write_result(stored_row(12, path="/records/2", written=later))
    found = query(store, "SELECT identity FROM records ORDER BY path")
    assert [int(text, 16) for text in found["identity"]] == [10, 11, 12]
    assert query(store, "SELECT count(*) FROM results").iloc[0, 0] == 6
    (first,) = plain_rows(query(store, "SELECT serial, name, value, std, unit FROM parameters ORDER BY path LIMIT 1"))
    assert first == {"serial": "S1", "name": "clearance", "value": pytest.approx(2.1e-6), "std": 1e-8, "unit": "m"}
    assert query(store, "SELECT DISTINCT name, alternatives[1] FROM effects").values.tolist() == [["oil_lag", "other"]]
    assert len(query(store, "FROM faults")) == 0
    with pytest.raises(BenchInputError, match=r"the question cannot be answered: .*nonsense"):
        query(store, "FROM nonsense")


def test_an_empty_store_answers(tmp_path):
    store = Store(tmp_path / "store")
    for view in ("records", "results", "parameters", "effects", "faults", "failures"):
        assert len(query(store, f"FROM {view}")) == 0


def test_what_cannot_be_written_says_so():
    from thermohyd.identify.fleet.store import _trouble

    assert "free some space" in str(_trouble(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "x")))
    assert "free some space" not in str(_trouble(OSError(errno.EACCES, os.strerror(errno.EACCES), "x")))


def test_a_table_says_its_version(tmp_path):
    store = filled(tmp_path / "store", 1)
    table = pq.ParquetFile(store.files()[0]).read()
    assert schema.version_of(table) == schema.SCHEMA
    with pytest.raises(ValueError, match="no file of a fleet's store"):
        schema.version_of(pa.table({"x": [1]}))


# What schema 1 had: written by the program of its time, and never to be edited.
SCHEMA_1 = {
    "identity": pa.string(), "content": pa.string(), "job": pa.string(), "settings": pa.string(), "version": pa.string(),
    "path": pa.string(), "serial": pa.string(), "port": pa.string(), "order_number": pa.string(), "date": pa.timestamp("us"),
    "operating_hours": pa.float64(), "iso_4406": pa.string(), "oil_temperature_low": pa.float64(),
    "oil_temperature_high": pa.float64(), "supply_pressure_low": pa.float64(), "supply_pressure_high": pa.float64(),
    "verdict": pa.string(), "converged": pa.bool_(), "gap_before": pa.float64(), "gap_after": pa.float64(),
    "parameters": pa.list_(schema.PARAMETER), "effects": pa.list_(schema.EFFECT), "faults": pa.list_(schema.FAULT),
    "sentences": pa.list_(pa.string()), "warnings": pa.list_(pa.string()), "rows": pa.int64(), "report": pa.string(),
    "seconds": pa.float64(), "written": pa.timestamp("us"),
}  # fmt: skip


def test_a_store_of_schema_1_is_brought_up_to_date(tmp_path):
    store = filled(tmp_path / "store", 2)
    for path in store.files():  # as they were; a migration that was interrupted left the second as it is today
        old = pa.Table.from_pylist(pq.ParquetFile(path).read().to_pylist(), pa.schema(SCHEMA_1))
        pq.write_table(old.replace_schema_metadata({schema.VERSION_KEY: b"1"}), path)
        break
    (store.folder / "store.json").write_text(json.dumps({"schema": 1}))
    opened = Store(store.folder)
    assert json.loads((store.folder / "store.json").read_text()) == {"schema": schema.SCHEMA}
    for path in opened.files():
        table = pq.ParquetFile(path).read()
        assert schema.version_of(table) == schema.SCHEMA
        assert table.schema.equals(schema.RESULTS)
    assert query(opened, "SELECT held_out, len(parameters) FROM records ORDER BY identity").fillna(
        0
    ).values.tolist() == [[0, 1], [0, 1]]


def test_rows_of_real_results(tmp_path):
    """What a fit and a diagnosis give as JSON becomes a row, and comes back out of the store."""
    from helpers.fake_diagnosis import fake_diagnosis
    from helpers.fake_fit import fake_fit

    from thermohyd.identify.bench.service import Service
    from thermohyd.identify.fleet.identity import Found, Settings
    from thermohyd.identify.fleet.rows import row_of

    store = Store(tmp_path / "store")
    record = replace(
        fake_fit().record, service=Service("7", "T", 12.0, "2026-03-01T12:00:00+02:00", iso_4406="18/16/13")
    )
    for job, result in (("fit", fake_fit()), ("diagnose", fake_diagnosis())):
        store.write_result(row_of(Found(f"/{job}", job, ()), Settings(job), record, result.to_dict(), 1.0))
    fitted, diagnosed = plain_rows(query(store, "FROM records ORDER BY job DESC"))
    assert fitted["verdict"] in ("fitted", "misfit")
    assert {p["name"]: p["value"] for p in fitted["parameters"]} == {
        n: p.value for n, p in fake_fit().parameters.items()
    }
    assert [e["name"] for e in diagnosed["effects"]] == [e.name for e in fake_diagnosis().effects]
    assert diagnosed["verdict"] == fake_diagnosis().verdict
    assert (diagnosed["type"], diagnosed["serial"], diagnosed["date"][:13]) == ("T", "7", "2026-03-01T10")
