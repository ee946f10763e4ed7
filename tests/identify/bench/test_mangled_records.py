"""Whatever a record holds, the reader returns a record or raises BenchInputError with one line; nothing else, ever."""

import contextlib
import gzip
import io
import zipfile
from collections.abc import Sequence

import numpy as np
import openpyxl
import pandas as pd
from helpers.bench_folder import LEAKAGE, TOML, write_record
from hypothesis import given, settings, strategies as st
from openpyxl.utils.exceptions import IllegalCharacterError
from pyarrow import ArrowException

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


FULL = (
    TOML
    + """noise = "0.01 l/min"
columns = { spool_position = "spool_position [um]" }
ignore = ["remarks"]
missing = "skip"
skip_rows = 0
[tests.step]
file = "step.csv"
noise = { piston_position = "5 um" }
[actuator]
piston_area = "12 cm^2"
controller = { amplifier_gain = "0.01 A/V", sensor_gain = "100 V/m" }
[start]
edge_radius = "10 um"
discharge_coefficient = { value = 0.7, fixed = true, std = 0.1, min = 0.5, max = 1.0 }
"""
)
# What files that went wrong really contain, and what parsers trip over.
PIECES = (
    *(
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        '"',
        '"""',
        "'",
        "=",
        ",",
        ";",
        "\t",
        "\n",
        "\r",
        "\r\n",
        "#",
        ".",
        "-",
        "%",
        '""',
    ),
    *("nan", "NaN", "inf", "-inf", "1e999", "1e-400", "0x1F", "1_000", "True", "true", "null", "1979-05-27", "12:00"),
    *("\ufeff", "\0", "\x0b", "\x1c", "\u2028", "µ", "°C", "²", "٣", "^9^9", "**9", "[um]", "[bar]", "[]", "[%]"),
    *("2026-03-01 12:00:00.5", "03/04/2026 10:00:00", "10:00:00", "Time", "Spool Position (UM)", "um", "n/a", "#N/A"),
    *("temperature [K]", "current [mA]", "run", "time [s]", "leakage_flow_std [l/min]", "_x", "valve.stroke", "[oil]"),
    *("9" * 400, "[" * 300, "a." * 200, "1 dB", "0 K", "-1", "0", "401", "[tests.x]", "sep=;", "99999999999999999999"),
)


@st.composite
def mangled(draw: st.DrawFn, text: str) -> bytes:
    """The text after a few edits: pieces cut, repeated, overwritten or inserted; bytes changed; the end cut off."""
    data = text.encode()
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        end = min(len(data), at + draw(st.integers(0, 30)))
        edit = draw(st.sampled_from(("cut", "repeat", "insert", "overwrite", "bytes", "truncate", "move")))
        piece = draw(st.sampled_from(PIECES)).encode()
        if edit == "cut":
            data = data[:at] + data[end:]
        elif edit == "repeat":
            data = data[:end] + data[at:]
        elif edit == "insert":
            data = data[:at] + piece + data[at:]
        elif edit == "overwrite":
            data = data[:at] + piece + data[end:]
        elif edit == "bytes":
            data = data[:at] + draw(st.binary(max_size=8)) + data[end:]
        elif edit == "truncate":
            data = data[:at]
        else:
            to = draw(st.integers(0, len(data)))
            data = data[:to] + data[at:end] + data[to:]
    return data


def read_or_refuse(folder, **files: bytes) -> None:
    write_record(folder)
    for name, content in files.items():
        (folder / name.replace("_", ".")).write_bytes(content)
    try:
        record = read_record(folder)
    except BenchInputError as error:
        text = str(error)
        assert text.isprintable()  # one line, nothing that disturbs a terminal
        assert len(text) < 1000 + 2 * len(str(folder))
        assert text.startswith(str(folder))
        return
    for test in record.tests.values():
        columns = [test.spool_position, test.supply_pressure, test.return_pressure, test.temperature, test.direction]
        columns += [channel.value for channel in test.channels]
        columns += [array for channel in test.channels if (array := channel.std) is not None]
        for column in columns:
            assert column.shape == (test.rows,)
            assert np.isfinite(column).all()


@settings(max_examples=400)
@given(mangled(LEAKAGE))
def test_mangled_csv(tmp_path_factory, content):
    read_or_refuse(tmp_path_factory.mktemp("csv"), leakage_csv=content)


@settings(max_examples=400)
@given(mangled(FULL))
def test_mangled_toml(tmp_path_factory, content):
    read_or_refuse(tmp_path_factory.mktemp("toml"), bench_toml=content)


@settings(max_examples=50)
@given(mangled(LEAKAGE.replace(",", ";").replace(".", ",")), st.integers(0, 200))
def test_mangled_semicolons_and_gzip(tmp_path_factory, content, cut):
    read_or_refuse(tmp_path_factory.mktemp("german"), leakage_csv=content)
    read_or_refuse(tmp_path_factory.mktemp("gzip"), leakage_csv=gzip.compress(content, mtime=0)[: cut or None])


def sheet(cells: Sequence[Sequence[object]]) -> bytes:
    """An .xlsx file, every part of it stored as it is, so that a changed byte reaches the parser of the sheet."""
    book, made, stored = openpyxl.Workbook(), io.BytesIO(), io.BytesIO()
    page = book.active
    assert page is not None
    for row in cells:
        page.append(list(row))
    book.save(made)
    with zipfile.ZipFile(made) as packed, zipfile.ZipFile(stored, "w", zipfile.ZIP_STORED) as plain:
        for name in packed.namelist():
            plain.writestr(name, packed.read(name))
    return stored.getvalue()


HEADERS = ["time [s]", "run", "spool_position [um]", "leakage_flow [l/min]"]
SHEET = sheet([HEADERS, [0, "up", -10, 0.1], [1, "up", 0, 0.3], [2, "up", 10, 0.1]])
SHEET_PIECES = (
    "<",
    "</c>",
    "<row",
    'r="9"',
    'r="ZZZ1"',
    'r="99999999"',
    't="s"',
    't="e"',
    't="d"',
    "<v>9</v>",
    "&#0;",
    "nan",
    "1e999",
)
AS_SHEET, AS_PARQUET = (TOML.replace("leakage.csv", f"leakage.{ending}").encode() for ending in ("xlsx", "parquet"))


@settings(max_examples=150)
@given(st.data())
def test_mangled_sheets(tmp_path_factory, data):
    """A part of the archive after a few edits, under a directory that is right again."""
    stored = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(SHEET)) as sound, zipfile.ZipFile(stored, "w") as spoiled:
        chosen = data.draw(st.sampled_from(sound.namelist()))
        for name in sound.namelist():
            content = sound.read(name)
            if name == chosen:
                for _ in range(data.draw(st.integers(1, 3))):
                    at = data.draw(st.integers(0, len(content)))
                    piece = data.draw(st.sampled_from(SHEET_PIECES)).encode()
                    content = content[:at] + piece + content[at + data.draw(st.integers(0, 20)) :]
            spoiled.writestr(name, content)
    read_or_refuse(tmp_path_factory.mktemp("sheet"), bench_toml=AS_SHEET, leakage_xlsx=stored.getvalue())
    at = data.draw(st.integers(0, len(SHEET)))
    cut = SHEET[:at] + data.draw(st.binary(max_size=8)) + SHEET[at + 4 :]
    read_or_refuse(tmp_path_factory.mktemp("archive"), bench_toml=AS_SHEET, leakage_xlsx=cut)


CELLS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.datetimes(), st.times(), st.timedeltas(), st.text(max_size=9),
    st.sampled_from(["um", "l/min", "n/a", "10:00:00", "2026-03-01 10:00:00", *HEADERS]),
)  # fmt: skip


@settings(max_examples=150)
@given(st.lists(st.lists(CELLS, min_size=4, max_size=4), min_size=1, max_size=6))
def test_tables_of_any_cells(tmp_path_factory, rows):
    frame = pd.DataFrame(rows, columns=HEADERS)
    written = io.BytesIO()
    with contextlib.suppress(ArrowException, OverflowError):  # columns of mixed types
        frame.to_parquet(written)
        read_or_refuse(tmp_path_factory.mktemp("parquet"), bench_toml=AS_PARQUET, leakage_parquet=written.getvalue())
    with contextlib.suppress(ValueError, OverflowError, IllegalCharacterError):  # what a spreadsheet cannot hold
        content = sheet([HEADERS, *rows])
        read_or_refuse(tmp_path_factory.mktemp("sheet"), bench_toml=AS_SHEET, leakage_xlsx=content)


@settings(max_examples=100)
@given(st.binary(max_size=200), st.binary(max_size=200))
def test_files_of_any_bytes(tmp_path_factory, toml, csv):
    read_or_refuse(tmp_path_factory.mktemp("toml"), bench_toml=toml)
    read_or_refuse(tmp_path_factory.mktemp("csv"), leakage_csv=csv)
    read_or_refuse(tmp_path_factory.mktemp("xlsx"), bench_toml=AS_SHEET, leakage_xlsx=csv)
    read_or_refuse(tmp_path_factory.mktemp("parquet"), bench_toml=AS_PARQUET, leakage_parquet=csv)


# Right names, wrong types: what byte edits seldom make.
TEXTS = (
    '"213 um"',
    '"1 bar"',
    '"x"',
    '""',
    "1",
    "-1",
    "0.7",
    "nan",
    "-inf",
    "true",
    "[]",
    "{}",
    "1979-05-27",
    "[1, 2]",
    '"skip"',
    '"leakage.xlsx"',
    '"leakage.parquet"',
)
TABLES = ('{ value = "1 um" }', "{ value = 1 }", '{ leakage_flow = "1 l/min" }', '[["40 degC", "30 cSt"]]', "[[1, 2]]")
VALUES = st.sampled_from([*TEXTS, *TABLES])
KEYS = {
    "valve": "name stroke slot_width land_diameter rated_flow rated_pressure_drop rated_current polarity",
    "oil": "preset viscosity density expansion bulk_modulus specific_heat pressure_viscosity name",
    "conditions": "supply_pressure return_pressure temperature",
    "tests.leakage": "file noise columns ignore missing skip_rows sheet",
    "tests.frequency": "file noise columns ignore output absolute missing skip_rows sheet",
    "actuator": "piston_area chamber_volume piston_stroke moving_mass spool_damping controller heat",
    "start": "edge_radius clearance underlap discharge_coefficient transition_number null_bias heat_retention",
}


@settings(max_examples=300)
@given(
    st.fixed_dictionaries(
        {}, optional={name: st.dictionaries(st.sampled_from(k.split()), VALUES, max_size=3) for name, k in KEYS.items()}
    )
)
def test_values_of_wrong_types(tmp_path_factory, tables):
    sound = {"valve": {"stroke": '"200 um"', "slot_width": '"12 mm"'}, "oil": {"preset": '"iso-vg-32"'}}
    sound |= {"conditions": {"supply_pressure": '"70 bar"', "temperature": '"40 degC"'}}
    sound |= {"tests.leakage": {"file": '"leakage.csv"'}}
    merged = sound | {name: sound.get(name, {}) | table for name, table in tables.items()}
    text = "\n".join(
        f"[{name}]\n" + "".join(f"{k} = {v}\n" for k, v in table.items()) for name, table in merged.items()
    )
    read_or_refuse(tmp_path_factory.mktemp("types"), bench_toml=text.encode())
