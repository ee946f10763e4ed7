"""A record as it comes out of the reader: SI units, channels, noise, runs, every variant of CSV that benches write."""

import gzip
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record

from thermohyd.data import sample_record
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


REAL = Path(__file__).parents[4] / "shared" / "real" / "servovalve_5329"
L_MIN = 1e-3 / 60.0
ROWS = {"position": [-10e-6, 0.0, 10e-6, 10e-6, 0.0], "flow": [0.1, 0.3, 0.1, 0.1, 0.3]}


def leakage(folder):
    return read_record(folder).tests["leakage"]


def test_a_plain_record(tmp_path):
    record = read_record(str(write_record(tmp_path)))
    test = record.tests["leakage"]
    assert record.name == record.valve.name == "test valve"
    assert (record.valve.stroke, record.valve.polarity) == (pytest.approx(200e-6), -1)
    assert record.oil.name == "mil-prf-5606"
    assert test.rows == 5
    assert test.abscissa == "spool_position"
    assert test.spool_position == pytest.approx(ROWS["position"])
    assert test.channels[0].name == "leakage_flow"
    assert test.channels[0].value == pytest.approx(np.multiply(ROWS["flow"], L_MIN))
    assert test.channels[0].std is None
    assert test.channels[0].std_source == ""
    assert test.supply_pressure == pytest.approx(np.full(5, 70e5))
    assert test.return_pressure == pytest.approx(np.zeros(5))
    assert test.temperature == pytest.approx(np.full(5, 313.15))
    assert test.run.tolist() == [0, 0, 0, 1, 1]
    assert test.run_names == ("up", "down")
    assert test.direction.tolist() == [1, 1, 1, -1, -1]
    assert test.rate == pytest.approx([1e-5, 1e-5, 1e-5, -1e-5, -1e-5])
    assert test.lines is not None
    assert test.lines.tolist() == [3, 4, 6, 8, 9]
    assert test.table is not None
    assert list(test.table.columns) == ["time [s]", "run", "spool_position [um]", "leakage_flow [l/min]"]


def german(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


VARIANTS = {
    "CRLF": LEAKAGE.replace("\n", "\r\n").encode(),
    "old Mac line ends": LEAKAGE.replace("\n", "\r").encode(),
    "BOM": LEAKAGE.encode("utf-8-sig"),
    "UTF-16": LEAKAGE.encode("utf-16"),
    "latin-1": LEAKAGE.replace("[um]", "[µm]").encode("latin-1"),
    "micro sign": LEAKAGE.replace("[um]", "[µm]").encode(),
    "semicolons": LEAKAGE.replace(",", ";").encode(),
    "semicolons and decimal commas": german(LEAKAGE).encode(),
    "tabs and decimal commas": german(LEAKAGE).replace(";", "\t").encode(),
    "quoted headers": LEAKAGE.replace("spool_position [um]", '"spool_position [um]"').encode(),
    "everything quoted": "\n".join(
        line if line.startswith("#") or not line else ",".join(f'"{cell}"' for cell in line.split(","))
        for line in LEAKAGE.split("\n")
    ).encode(),
    "quoted decimal commas": german(LEAKAGE).replace("0,3", '"0,3"').encode(),
    "gzip": gzip.compress(LEAKAGE.encode()),
    "spaces": LEAKAGE.replace(",", " , ").encode(),
    "no last line end": LEAKAGE.rstrip("\n").encode(),
    "rows of empty cells at the end": (LEAKAGE + ",,,\n,,,\n").encode(),
    "Excel's first line": b"sep=,\n" + LEAKAGE.split("\n", 1)[1].encode(),
    "other order": b"leakage_flow [l/min],spool_position [um],run,time [s]\n0.1,-10,up,0\n0.3,0,up,1\n0.1,10,up,2\n"
    b"0.1,10,down,0\n0.3,0,down,1\n",
    "other units": LEAKAGE.replace("[um]", "[mm]")
    .replace(",-10,", ",-1e-2,")
    .replace(",10,", ",0.01,")
    .replace("[s]", "[ms]")
    .encode(),
    "percent of the stroke": LEAKAGE.replace("[um]", "[%]").replace(",-10,", ",-5,").replace(",10,", ",5,").encode(),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_of_the_file_gives_the_same_rows(tmp_path, variant):
    test = leakage(write_record(tmp_path, leakage=VARIANTS[variant]))
    assert test.spool_position == pytest.approx(ROWS["position"])
    assert test.channels[0].value == pytest.approx(np.multiply(ROWS["flow"], L_MIN))
    assert test.run_names == ("up", "down")
    assert test.run.tolist() == [0, 0, 0, 1, 1]


def test_numbers_are_read_to_the_last_digit(tmp_path):
    values = [0.1 + 0.2, 1 / 3, 2e-300, 9.404956263388e-09]
    rows = "".join(f"{i},{value!r}\n" for i, value in enumerate(values))
    folder = write_record(tmp_path, leakage="spool_position [um],leakage_flow [m^3/s]\n" + rows)
    assert leakage(folder).channels[0].value == pytest.approx(values, rel=4e-16, abs=0.0)


def test_currents_as_abscissa(tmp_path):
    folder = write_record(
        tmp_path, leakage="current [mA],leakage_flow [l/min]\n-25,0.1\n-12.5,0.2\n0,0.3\n0,0.3\n25,0.1\n"
    )
    test = leakage(folder)
    assert test.abscissa == "current"
    assert test.spool_position == pytest.approx([200e-6, 100e-6, 0.0, 0.0, -200e-6])
    assert test.direction.tolist() == [-1] * 5
    assert test.time is None
    assert test.rate is None


def test_a_position_goes_before_a_current(tmp_path):
    folder = write_record(tmp_path, leakage="current [mA],spool_position [um],leakage_flow [l/min]\n1,5,0.1\n2,6,0.2\n")
    test = leakage(folder)
    assert test.abscissa == "spool_position"
    assert test.spool_position == pytest.approx([5e-6, 6e-6])
    assert test.notes == ("columns that this test does not use: current",)


def test_columns_go_before_conditions(tmp_path):
    text = "spool_position [um],temperature [degF],return_pressure [psi],supply_pressure [MPa],leakage_flow [gal/min]\n"
    test = leakage(write_record(tmp_path, leakage=text + "0,104,14.5,21,0.1\n1,212,0,21,0.1\n"))
    assert test.temperature == pytest.approx([313.15, 373.15])
    assert test.return_pressure == pytest.approx([99973.98, 0.0], rel=1e-6)
    assert test.supply_pressure == pytest.approx([21e6, 21e6])
    assert test.channels[0].value == pytest.approx([6.30902e-06] * 2, rel=1e-5)


@pytest.mark.parametrize("header", ["LVDT [um]", "LVDT"])
@pytest.mark.parametrize("in_toml", ["LVDT [um]", "LVDT"])
def test_the_users_own_header(tmp_path, header, in_toml):
    toml = TOML + f'columns = {{ spool_position = "{in_toml}" }}\n'
    folder = write_record(tmp_path, toml, leakage=LEAKAGE.replace("spool_position [um]", header))
    if header == in_toml == "LVDT":
        with pytest.raises(BenchInputError, match=r"the unit is missing; write for example spool_position \[um\]"):
            read_record(folder)
    else:
        assert leakage(folder).spool_position == pytest.approx(ROWS["position"])


def test_extra_columns_are_let_through_where_they_are_marked(tmp_path):
    text = (
        "spool_position [um],leakage_flow [l/min],_valve temp,remarks,flow [l/min],leakage_flow_predicted [l/min],"
        "leakage_flow_predicted_std [l/min]\n0,0.1,warm,first,9,0.11,0.01\n1,0.1,,,,,\n"
    )
    test = leakage(write_record(tmp_path, TOML + 'ignore = ["remarks"]\n', leakage=text))
    assert test.rows == 2
    assert test.notes == ("columns that this test does not use: flow",)
    assert test.table is not None
    assert list(test.table.columns) == [
        "spool_position [um]",
        "leakage_flow [l/min]",
        "_valve temp",
        "remarks",
        "flow [l/min]",
    ]


def test_noise_for_the_test_and_per_row(tmp_path):
    folder = write_record(tmp_path, TOML + 'noise = "0.01 l/min"\n')
    channel = leakage(folder).channels[0]
    assert channel.std == pytest.approx(np.full(5, 0.01 * L_MIN))
    assert channel.std_source == "declared in bench.toml"
    text = "spool_position [um],leakage_flow [l/min],leakage_flow_std [ml/min]\n0,0.1,1\n1,0.1,2\n"
    channel = leakage(write_record(tmp_path, TOML + 'noise = "0.01 l/min"\n', leakage=text)).channels[0]
    assert channel.std == pytest.approx(np.array([1e-3, 2e-3]) * L_MIN)
    assert channel.std_source == "declared per row"


PRESSURE_TOML = TOML.replace("[tests.leakage]", "[tests.pressure_gain]").replace("leakage.csv", "dp.csv")


def test_noise_of_the_positions(tmp_path):
    test = leakage(
        write_record(tmp_path, TOML + 'noise = { spool_position = "0.1 um", leakage_flow = "0.01 l/min" }\n')
    )
    assert test.position_std == pytest.approx(1e-7)
    assert test.channels[0].std is not None
    assert leakage(write_record(tmp_path, TOML + 'noise = "0.01 l/min"\n')).position_std is None


def test_pressure_gain_with_both_gauges_and_a_noise_each(tmp_path):
    text = "spool_position [um],load_pressure [bar],pressure_b [bar],pressure_a [bar]\n0,0.5,35,35.5\n1,4,33,37\n"
    toml = PRESSURE_TOML + 'noise = { pressure_a = "0.1 bar", load_pressure = "10 kPa" }\n'
    channels = read_record(write_record(tmp_path, toml, dp=text)).tests["pressure_gain"].channels
    assert [channel.name for channel in channels] == ["load_pressure", "pressure_a", "pressure_b"]
    assert [None if c.std is None else float(c.std[0]) for c in channels] == [
        pytest.approx(1e4),
        pytest.approx(1e4),
        None,
    ]
    assert channels[1].value == pytest.approx([35.5e5, 37e5])


def test_load_flow_has_load_pressure_as_a_condition(tmp_path):
    toml = TOML.replace("[tests.leakage]", "[tests.load_flow]").replace("leakage.csv", "lf.csv")
    text = "spool_position [um],load_pressure [bar],flow [l/min]\n10,20,3\n10,-20,4\n"
    test = read_record(write_record(tmp_path, toml, lf=text)).tests["load_flow"]
    assert test.load_pressure == pytest.approx([20e5, -20e5])
    assert [channel.name for channel in test.channels] == ["flow"]


def test_readings_may_be_missing_for_predictions(tmp_path):
    folder = write_record(tmp_path, leakage="spool_position [um]\n0\n1\n")
    assert read_record(folder, readings_required=False).tests["leakage"].channels == ()
    with pytest.raises(BenchInputError, match="the leakage test needs a column leakage_flow"):
        read_record(folder)


def test_start_values(tmp_path):
    toml = TOML + (
        '[start]\nedge_radius = "10 um"\nunderlap = { value = "5 %", std = "2 um", min = "0 um", max = "20 um" }\n'
        "discharge_coefficient = { value = 0.7, fixed = true }\ntransition_number = 57\n"
        "heat_retention = { fixed = false, max = 0.5 }\n"
    )
    start = read_record(write_record(tmp_path, toml)).start
    assert start["edge_radius"].value == pytest.approx(10e-6)
    assert not start["edge_radius"].fixed
    underlap = start["underlap"]
    assert [underlap.value, underlap.prior_std, underlap.lower, underlap.upper] == pytest.approx([1e-5, 2e-6, 0, 2e-5])
    assert start["discharge_coefficient"].fixed
    assert start["transition_number"].value == 57.0
    assert (start["heat_retention"].value, start["heat_retention"].upper) == (0.0, 0.5)


def test_oil_from_points_and_properties(tmp_path):
    oil = 'viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]\ndensity = "0.85 g/cm^3"\nname = "drum 7"'
    record = read_record(write_record(tmp_path, TOML.replace('preset = "mil-prf-5606"', oil)))
    assert (record.oil.density, record.oil.name) == (pytest.approx(850.0), "drum 7")
    assert record.oil.viscosity_a == pytest.approx(5.976124353286865)
    preset = read_record(write_record(tmp_path, TOML.replace("[conditions]", 'bulk_modulus = "1.5 GPa"\n[conditions]')))
    assert (preset.oil.bulk_modulus, preset.oil.density) == (pytest.approx(1.5e9), 849.2)


def test_samples_read_cleanly():
    seed = read_record(sample_record("seed_valve"))
    assert {name: test.rows for name, test in seed.tests.items()} == dict.fromkeys(
        ("leakage", "pressure_gain", "flow_gain"), 800
    )
    logged = read_record(sample_record("raw_log"))
    assert {test.abscissa for test in logged.tests.values()} == {"current"}


@pytest.mark.skipif(not REAL.exists(), reason="the real record is not part of the repository")
def test_the_real_record_reads():
    record = read_record(REAL)
    assert {name: test.rows for name, test in record.tests.items()} == {
        "leakage": 25176,
        "pressure_gain": 54900,
        "flow_gain": 52000,
    }
    assert record.tests["flow_gain"].spool_position[0] == pytest.approx(-213e-6 * 25.1 / 25.0)


def test_reading_needs_no_jax(tmp_path):
    folder = write_record(tmp_path)
    code = (
        "import sys; from thermohyd.identify.bench.read import read_record; read_record(sys.argv[1]);"
        "sys.exit('jax' in sys.modules)"
    )
    subprocess.run([sys.executable, "-P", "-c", code, str(folder)], check=True)
