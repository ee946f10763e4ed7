"""Whatever a record holds, the reader returns a record or raises BenchInputError with one line; nothing else, ever."""

import gzip

import numpy as np
from helpers.bench_folder import LEAKAGE, TOML, write_record
from hypothesis import given, settings, strategies as st

from thermohyd.identify.errors import BenchInputError
from thermohyd.identify.read_record import read_record


FULL = (
    TOML
    + """noise = "0.01 l/min"
columns = { spool_position = "spool_position [um]" }
ignore = ["remarks"]
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


@settings(max_examples=100)
@given(st.binary(max_size=200), st.binary(max_size=200))
def test_files_of_any_bytes(tmp_path_factory, toml, csv):
    read_or_refuse(tmp_path_factory.mktemp("toml"), bench_toml=toml)
    read_or_refuse(tmp_path_factory.mktemp("csv"), leakage_csv=csv)


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
)
TABLES = ('{ value = "1 um" }', "{ value = 1 }", '{ leakage_flow = "1 l/min" }', '[["40 degC", "30 cSt"]]', "[[1, 2]]")
VALUES = st.sampled_from([*TEXTS, *TABLES])
KEYS = {
    "valve": "name stroke slot_width land_diameter rated_flow rated_pressure_drop rated_current polarity",
    "oil": "preset viscosity density expansion bulk_modulus specific_heat pressure_viscosity name",
    "conditions": "supply_pressure return_pressure temperature",
    "tests.leakage": "file noise columns ignore",
    "tests.frequency": "file noise columns ignore output absolute",
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
