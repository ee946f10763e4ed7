"""Files that lead elsewhere, claim more than they hold or hold what takes for ever: each is refused in one sentence, before it is read."""

import gzip
import io
import os
import struct
import tracemalloc
import zipfile
import zlib
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record
from nptdms import ChannelObject, TdmsWriter
from pyarrow import parquet
from scipy.io import savemat

from thermohyd.identify.bench import input_file
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.headers import split_header
from thermohyd.identify.bench.parquet_pages import refuse_large_pages
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.units import UnitError, parse_quantity, parse_unit
from thermohyd.identify.checking.check import check


X, Q = np.linspace(-50.0, 50.0, 5), np.linspace(0.1, 0.3, 5)
OWN = 'columns = { spool_position = "xv [um]", leakage_flow = "ql [l/min]" }\n'
MORE = "or more, which is more than the 4,000,000 that are read; thin the log before fitting"


def named(file: str, more: str = "") -> str:
    return TOML.replace("leakage.csv", file) + more


@pytest.fixture
def small_limit(monkeypatch):
    """A hundredth of the limit, so that files on its other side are quick to write."""
    monkeypatch.setattr(input_file, "LARGEST", 4_000_000)


def message(folder) -> str:
    with pytest.raises(BenchInputError) as caught:
        read_record(folder)
    assert str(caught.value).isprintable()
    return str(caught.value).removeprefix(f"{folder}/")


# ---- MATLAB


def elsewhere(place, file):
    """Spoils of a sound version 7.3 file, by name; what another file holds must never be read."""
    secret = place / "secret.h5"
    with h5py.File(secret, "w") as other:
        other["ql"] = Q[None, :]
    (place / "raw").write_bytes(Q.tobytes())
    layout = h5py.VirtualLayout((1, 5), float)
    layout[:] = h5py.VirtualSource(str(secret), "ql", (1, 5))
    return {
        "external link": lambda: file.update({"ql": h5py.ExternalLink(str(secret), "/ql")}),
        "soft link": lambda: file.update({"ql": h5py.SoftLink("/xv")}),
        "dangling link": lambda: file.update({"ql": h5py.SoftLink("/nowhere")}),
        "cyclic link": lambda: file.update({"ql": h5py.SoftLink("/ql")}),
        "external data": lambda: file.create_dataset("ql", (1, 5), float, external=[(str(place / "raw"), 0, 40)]),
        "virtual data": lambda: file.create_virtual_dataset("ql", layout),
    }


SPOILS = {
    "external link": "is a link to another place or file",
    "soft link": "is a link to another place or file",
    "dangling link": "is a link to another place or file",
    "cyclic link": "is a link to another place or file",
    "external data": "keeps its data in another file",
    "virtual data": "keeps its data in another file",
}


@pytest.mark.parametrize("within", ["", "log"])
@pytest.mark.parametrize("spoil", SPOILS)
def test_no_other_file_is_read_through_a_mat_file(tmp_path, spoil, within):
    folder = write_record(tmp_path / "record", named("leakage.mat", OWN))
    with h5py.File(folder / "leakage.mat", "w") as file:
        group = file.require_group(within) if within else file
        group["xv"] = X[None, :]
        elsewhere(tmp_path, group)[spoil]()
    assert SPOILS[spoil] in message(folder)
    assert message(folder).startswith("leakage.mat: variable ")


def hdf5_claims(file):
    return {
        "one that is huge": lambda: file.create_dataset("ql", (600_000, 1), float, chunks=(1000, 1)),
        "many that are large": lambda: [
            file.create_dataset(f"v{i}", (90_000, 1), float, chunks=(1000, 1)) for i in range(6)
        ],
        "a large piece": lambda: file.create_dataset("ql", (5, 1), float, maxshape=(None, 1), chunks=(600_000, 1)),
        "large items": lambda: file.create_dataset("ql", (50, 1), np.dtype("S90000"), chunks=(1, 1)),
    }


@pytest.mark.parametrize("claim", hdf5_claims(None))
def test_what_a_version_7_3_file_claims(tmp_path, small_limit, claim):
    folder = write_record(tmp_path, named("leakage.mat", OWN))
    with h5py.File(folder / "leakage.mat", "w") as file:
        file["xv"] = X[None, :]
        hdf5_claims(file)[claim]()
    assert (folder / "leakage.mat").stat().st_size < 30_000
    assert message(folder).startswith("leakage.mat: unpacks to ")
    assert MORE in message(folder)


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def matrix(kind: int, sizes: tuple[int, ...], *parts: bytes) -> bytes:
    flags = element(6, struct.pack("<II", kind, 0))
    return element(14, flags + element(5, struct.pack(f"<{len(sizes)}i", *sizes)) + element(1, b"ql") + b"".join(parts))


def packed(content: bytes) -> bytes:
    small = zlib.compress(content, 9)
    return struct.pack("<II", 15, len(small)) + small


BOMBS = {
    "several packed variables": lambda: 3 * packed(element(1, b"\0" * 1_400_000)),
    "a cell array of empty arrays": lambda: packed(matrix(1, (1, 21_000), 21_000 * element(14, b""))),
    "a huge array inside a cell": lambda: matrix(1, (1, 1), matrix(6, (600_000, 1))),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_a_version_5_file_that_unpacks_without_end(tmp_path, small_limit, bomb):
    whole = io.BytesIO()
    savemat(whole, {})
    folder = write_record(tmp_path, named("leakage.mat", OWN))
    (folder / "leakage.mat").write_bytes(whole.getvalue()[:128] + BOMBS[bomb]())
    assert MORE in message(folder)


# ---- the other formats


def many_rows(rows: int, **columns: object) -> pa.Table:
    return pa.table({name: pa.repeat(value, rows) for name, value in columns.items()})


def test_what_a_parquet_file_claims(tmp_path, small_limit):
    folder = write_record(tmp_path, named("leakage.parquet", OWN))
    parquet.write_table(many_rows(510_000, xv=1), folder / "leakage.parquet")
    assert (folder / "leakage.parquet").stat().st_size < 30_000
    assert message(folder).startswith("leakage.parquet: has rows for 4,080,000 bytes or more")


def test_a_text_that_stands_in_many_rows_is_kept_once(tmp_path, small_limit):
    folder = write_record(tmp_path, named("leakage.parquet", OWN + 'ignore = ["remarks"]\n'))
    table = many_rows(200, remarks="x" * 100_000, xv=1.0, ql=0.1)
    parquet.write_table(table, folder / "leakage.parquet")
    assert read_record(folder).tests["leakage"].rows == 200


def test_pages_speak_for_themselves(tmp_path, monkeypatch):
    """A footer may say anything: the headers of the pages are what counts."""
    path = tmp_path / "a.parquet"
    values = {"a": np.arange(10_000.0), "b": ["up"] * 10_000}
    kinds: tuple[dict[str, Any], ...] = (
        {},
        {"compression": "zstd", "data_page_version": "2.0"},
        {"use_dictionary": False},
    )
    for options in kinds:
        parquet.write_table(pa.table(values), path, data_page_size=1000, row_group_size=6000, **options)
        with path.open("rb") as file:
            refuse_large_pages(path, file)
            monkeypatch.setattr(input_file, "LARGEST", 10_000 * 8 * 2 + 20_000)
            with pytest.raises(BenchInputError, match="unpacks to"):
                refuse_large_pages(path, file)
            monkeypatch.undo()


@pytest.mark.parametrize(
    ("column", "word"),
    [
        ([[0.1]] * 5, "list"),
        ([{"a": 1}] * 5, "struct"),
        ([b"\0"] * 5, "binary"),
        (pa.array([[("a", 1)]] * 5, pa.map_(pa.string(), pa.int64())), "map"),
    ],
)
def test_columns_of_a_parquet_file_that_are_no_numbers(tmp_path, column, word):
    folder = write_record(tmp_path, named("leakage.parquet", OWN + 'ignore = ["other"]\n'))
    parquet.write_table(pa.table({"xv": X, "ql": Q, "other": column}), folder / "leakage.parquet")
    assert read_record(folder).tests["leakage"].rows == 5  # not read: it harms nobody
    parquet.write_table(pa.table({"xv": X, "ql": column, "other": Q}), folder / "leakage.parquet")
    assert message(folder) == (
        f'leakage.parquet, column "ql": holds "{word}" in every cell; expected a column of numbers, times or texts'
    )


def test_what_a_tdms_file_claims(tmp_path, monkeypatch):
    folder = write_record(tmp_path, named("leakage.tdms", OWN))
    with TdmsWriter(folder / "leakage.tdms") as file:
        file.write_segment([ChannelObject("log", "xv", X), ChannelObject("log", "ql", Q)])
    assert read_record(folder).tests["leakage"].rows == 5
    monkeypatch.setattr(input_file, "LARGEST", 79)
    assert message(folder).startswith(
        "leakage.tdms: unpacks to 80 bytes or more, which is more than the 79 that are read"
    )


SHEETS = {
    "elements that are no rows": (b"</sheetData>", b"</sheetData>" + b"<a/>" * 110_000, "holds XML that takes 4,"),
    "texts that grow": (
        b"<worksheet",
        b'<!DOCTYPE a [<!ENTITY b "c">]><worksheet',
        "is no .xlsx file, or a damaged one",
    ),
}


@pytest.mark.parametrize("name", SHEETS)
def test_a_sheet_whose_xml_grows(tmp_path, small_limit, name):
    old, new, expected = SHEETS[name]
    folder = write_record(tmp_path, named("leakage.xlsx"))
    pd.DataFrame({"spool_position [um]": X, "leakage_flow [l/min]": Q}).to_excel(folder / "leakage.xlsx", index=False)
    with zipfile.ZipFile(folder / "leakage.xlsx") as sound:
        parts = {part: sound.read(part) for part in sound.namelist()}
    with zipfile.ZipFile(folder / "leakage.xlsx", "w", zipfile.ZIP_DEFLATED) as spoiled:
        for part, content in parts.items():
            spoiled.writestr(part, content.replace(old, new) if "sheet1" in part else content)
    assert message(folder).startswith(f"leakage.xlsx: {expected}")


def test_packed_text_that_unpacks_without_end(tmp_path, small_limit):
    folder = write_record(tmp_path, named("leakage.csv.gz"))
    with gzip.open(folder / "leakage.csv.gz", "wb", 1) as file:
        for _ in range(5):
            file.write(b"0" * 1_000_000)
    assert message(folder).startswith("leakage.csv.gz: unpacks to 4,")


def test_only_plain_files_are_opened(tmp_path):
    """/proc/kmsg is a plain file of no length, by its mode, and waits for ever."""
    folder = write_record(tmp_path, named("/proc/kmsg"))
    assert "kmsg: " in message(folder)
    os.mkfifo(folder / "pipe.csv")
    with pytest.raises(BenchInputError, match="is no plain file, but a device or a pipe"):
        input_file.open_input(folder / "pipe.csv")
    with pytest.raises(BenchInputError, match="is a folder"):
        input_file.open_input(folder)
    (folder / "long").write_text("12345")
    with pytest.raises(BenchInputError, match="has 5 bytes, more than the 4 that are read; expected less"):
        input_file.open_input(folder / "long", 4, "expected less")


# ---- long texts


LONG = "x" * 201


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("leakage_flow [l/min]", f"leakage_flow [{LONG}]", "line 2, column"),
        ("time [s]", LONG, "the header has 201 characters, more than 200"),
        ("0,up", f"0,{LONG}", 'line 3, column "run": the cell has 201 characters, more than 200'),
        ("2,up,10,0.1", f"2,up,10,{LONG}", 'line 6, column "leakage_flow [l/min]": the cell has 201 characters'),
    ],
    ids=["unit", "header", "run", "text"],
)
def test_long_headers_and_cells_are_refused(tmp_path, old, new, expected):
    text = LEAKAGE.replace(old, new, 1)
    assert expected in message(write_record(tmp_path, leakage=text))


def test_a_long_remark_is_nobodys_trouble(tmp_path):
    lines = LEAKAGE.replace("# another\n", "").replace("\n\n", "\n").splitlines()
    text = "\n".join([lines[0], f"{lines[1]},remarks", *(f"{line},{'y' * 90_000}" for line in lines[2:])])
    folder = write_record(tmp_path, TOML + 'ignore = ["remarks"]\n', leakage=text)
    assert read_record(folder).tests["leakage"].rows == 5


@pytest.mark.parametrize("text", ["1" * 201, "1 " + "m" * 201, "1" * 100 + "." * 101, "1" + " " * 200 + "m"])
def test_long_quantities_are_refused(text):
    with pytest.raises(UnitError):
        parse_quantity(text, "length")


@pytest.mark.parametrize(
    "text",
    ["a" * 39 + "!", "a" * 40, "m**9999999999", "m**9**9", "(" * 20 + "m" + ")" * 19, "m^2^2^2", "m*" * 20, "1e9999 m"],
)
def test_units_that_take_for_ever(text):
    """Of forty letters and a sign, each way to cut the letters into names was tried once: 2^39."""
    with pytest.raises(UnitError):
        parse_unit(text, "length")


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("x [um]", "x", "um"), ("x(um)", "x", "um"), ("LVDT (left) (um)", "LVDT (left)", "um"), ("p (bar (g))", "p", "bar (g)"),
        ("a [b] [c]", "a [b]", "c"), ("[um]", "[um]", None), ("x", "x", None), ("x ((a)(b))", "x ((a)(b))", None),
        ("x [a]]", "x [a]]", None), ("x]", "x]", None), ("x)", "x)", None), ("x []", "x", ""), ("a((b)", "a(", "b"), ("", "", None),
    ],
)  # fmt: skip
def test_a_header_is_split_from_its_end(header, name, unit):
    assert split_header(header) == (name, unit)


def test_a_line_of_bench_toml_has_an_end(tmp_path):
    folder = write_record(tmp_path, TOML + ".".join("a" * 6000) + " = 1\n")
    assert (
        message(folder) == "bench.toml, line 17: the line has 12,003 characters, more than 10,000; write it as several"
    )


# ---- memory


def test_a_log_takes_few_times_its_own_size(tmp_path):
    """Lines and cells as objects of their own took fifty bytes and more each. Checked once before, so that no import counts."""
    places = np.tile(np.round(np.linspace(-90.0, 90.0, 2000), 2), 20)
    rows = "".join(
        f"{i / 100:.2f},up,{x:.3f},{70 + i % 7 / 10:.3f},{0.3 - i % 9 / 100:.5f}\n" for i, x in enumerate(places)
    )
    head = "time [s],run,spool_position [um],supply_pressure [bar],leakage_flow [l/min]\n"
    check(write_record(tmp_path / "before", leakage=head + rows[: len(rows) // 4]))
    folder = write_record(tmp_path, leakage=head + rows)
    for read, most in ((read_record, 16), (check, 20)):
        tracemalloc.start()
        try:
            read(folder)
            assert tracemalloc.get_traced_memory()[1] < most * len(rows)
        finally:
            tracemalloc.stop()
