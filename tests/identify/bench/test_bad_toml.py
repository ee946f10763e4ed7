"""Every way in which a bench.toml can be wrong, with the message that its owner reads."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import pytest
from helpers.bench_folder import TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


# What is replaced in a sound file, by what, and the message.
SPOILED = {
    "syntax": (
        'stroke = "200 um"',
        "stroke = 200 um",
        "bench.toml, line 3: is not valid TOML: expected newline or end of document after a statement; texts and quantities are written in quotes",
    ),
    "unknown table": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[star]\n',
        'bench.toml, line 17, [star]: unknown table "star"; did you mean "start"?',
    ),
    "missing valve": (
        '[valve]\nname = "test valve"\nstroke = "200 um"\nslot_width = "12 mm"\nrated_current = "25 mA"\npolarity = -1\n\n[oil]',
        "[oil]",
        "bench.toml, line 1: [valve] is missing; it holds stroke and slot_width",
    ),
    "no tests": (
        '[tests.leakage]\nfile = "leakage.csv"\n',
        "",
        "bench.toml, line 1: [tests] is missing; it holds [tests.leakage]",
    ),
    "no oil": (
        '[oil]\npreset = "mil-prf-5606"\n',
        "",
        "bench.toml, line 1: [oil] is missing; it holds a preset or viscosity points",
    ),
    "unknown key": (
        'slot_width = "12 mm"',
        'slot_with = "12 mm"',
        'bench.toml, line 4, [valve] slot_with: unknown key "slot_with"; did you mean "slot_width"?',
    ),
    "no stroke": (
        'stroke = "200 um"\nslot_width = "12 mm"',
        'slot_width = "12 mm"',
        'bench.toml, line 1, [valve]: stroke is missing; write for example stroke = "213 um"',
    ),
    "unitless": (
        'stroke = "200 um"',
        "stroke = 200",
        'bench.toml, line 3, [valve] stroke: "200" has no unit; write it in quotes, such as "1.5 um"',
    ),
    "unitless2": (
        'stroke = "200 um"',
        'stroke = "200"',
        "bench.toml, line 3, [valve] stroke: the unit is missing; expected a length such as um",
    ),
    "dimension": (
        'stroke = "200 um"',
        'stroke = "200 bar"',
        'bench.toml, line 3, [valve] stroke: "bar" is a pressure; expected a length such as um',
    ),
    "negative": (
        'stroke = "200 um"',
        'stroke = "-200 um"',
        'bench.toml, line 3, [valve] stroke: "-200 um" must be positive',
    ),
    "list": (
        'stroke = "200 um"',
        'stroke = ["200 um"]',
        "bench.toml, line 3, [valve] stroke: \"['200 um']\" is not a quantity; expected a length such as um",
    ),
    "polarity": (
        "polarity = -1",
        "polarity = 2",
        'bench.toml, line 6, [valve] polarity: "2" must be 1, or -1 where a positive current gives a negative flow',
    ),
    "preset": (
        'preset = "mil-prf-5606"',
        'preset = "mil-prf-5660"',
        'bench.toml, line 9, [oil] preset: no oil preset "mil-prf-5660"; did you mean "mil-prf-5606"?',
    ),
    "both": (
        "[conditions]",
        "viscosity=[]\n[conditions]",
        "bench.toml, line 11, [oil] viscosity: both a preset and viscosity points; keep one of them",
    ),
    "one point": (
        'preset = "mil-prf-5606"',
        'viscosity=[["40 degC","32 cSt"]]',
        "bench.toml, line 9, [oil] viscosity: a viscosity law needs at least two points at different temperatures",
    ),
    "points form": (
        'preset = "mil-prf-5606"',
        'viscosity=["40 degC","32 cSt"]',
        'bench.toml, line 9, [oil] viscosity: must be a list of points, each a temperature and a viscosity: viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]',
    ),
    "points dim": (
        'preset = "mil-prf-5606"',
        'viscosity=[["40 degC","32 bar"],["50 degC","20 cSt"]]',
        'bench.toml, line 9, [oil] viscosity: "bar" is a pressure; expected a kinematic viscosity such as cSt',
    ),
    "rising": (
        'preset = "mil-prf-5606"',
        'viscosity=[["40 degC","32 cSt"],["50 degC","40 cSt"]]',
        "bench.toml, line 9, [oil] viscosity: the viscosity must fall as the temperature rises",
    ),
    "empty oil": (
        'preset = "mil-prf-5606"',
        "",
        'bench.toml, line 8, [oil]: the oil is missing; write preset = "mil-prf-5606", or points: viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]',
    ),
    "cond": (
        'temperature = "40 degC"',
        'temperature = "-300 degC"',
        'bench.toml, line 13, [conditions] temperature: "-300 degC" is at or below absolute zero (-273.15 degC, 0 K)',
    ),
    "cond unknown": (
        'temperature = "40 degC"',
        'temprature = "40 degC"',
        'bench.toml, line 13, [conditions] temprature: unknown key "temprature"; did you mean "temperature"?',
    ),
    "no supply": (
        'supply_pressure = "70 bar"\ntemperature = "40 degC"',
        'temperature = "40 degC"',
        'bench.toml, line 11, [conditions]: supply_pressure is missing: leakage.csv has no such column; write supply_pressure = "70 bar" in [conditions]',
    ),
    "no temp": (
        'temperature = "40 degC"\n',
        "",
        'bench.toml, line 11, [conditions]: temperature is missing: leakage.csv has no such column; write temperature = "40 degC" in [conditions]',
    ),
    "test unknown": (
        "[tests.leakage]",
        "[tests.leakge]",
        'bench.toml, line 15, [tests] leakge: unknown test "leakge"; did you mean "leakage"?',
    ),
    "tests not table": (
        "[tests.leakage]",
        "[tests]",
        'bench.toml, line 16, [tests] file: unknown test "file"; known: leakage, pressure_gain, flow_gain, load_flow, step, frequency',
    ),
    "test key": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\nnois = "1 l/min"\n',
        'bench.toml, line 17, [tests.leakage] nois: unknown key "nois"; did you mean "noise"?',
    ),
    "no file": (
        'file = "leakage.csv"\n',
        "",
        'bench.toml, line 15, [tests.leakage]: file is missing; write for example file = "leakage.csv"',
    ),
    "file missing": (
        'file = "leakage.csv"',
        'file = "leakge.csv"',
        'bench.toml, line 16, [tests.leakage] file: there is no file "leakge.csv"; did you mean "leakage.csv"?',
    ),
    "noise unit": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\nnoise = "1 bar"\n',
        'bench.toml, line 17, [tests.leakage] noise: "bar" is a pressure; expected a flow such as l/min',
    ),
    "noise zero": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\nnoise = "0 l/min"\n',
        'bench.toml, line 17, [tests.leakage] noise: "0 l/min" must be positive',
    ),
    "noise reading": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\nnoise = {flow="1 l/min"}\n',
        'bench.toml, line 17, [tests.leakage.noise] flow: unknown reading "flow"; known: leakage_flow, spool_position',
    ),
    "columns unknown": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\ncolumns = {spool="LVDT"}\n',
        'bench.toml, line 17, [tests.leakage.columns] spool: unknown standard column "spool"; known: run, time, spool_position, current, supply_pressure, return_pressure, temperature, leakage_flow, leakage_flow_std',
    ),
    "columns absent": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\ncolumns = {spool_position="LVDT [um]"}\n',
        'bench.toml, line 17, [tests.leakage] columns: spool_position is to be "LVDT [um]", but leakage.csv has no such header; known: time [s], run, spool_position [um], leakage_flow [l/min]',
    ),
    "columns type": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\ncolumns = {spool_position=3}\n',
        'bench.toml, line 17, [tests.leakage.columns] spool_position: "3" is not a text; write it in quotes',
    ),
    "columns twice": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\ncolumns = {spool_position="a", time="a"}\n',
        'bench.toml, line 17, [tests.leakage.columns] time: "a" stands for two columns',
    ),
    "ignore": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\nignore = "remarks"\n',
        'bench.toml, line 17, [tests.leakage] ignore: must be a list of headers, such as ignore = ["remarks"]',
    ),
    "start unknown": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nedge_radios = "1 um"\n',
        'bench.toml, line 18, [start] edge_radios: unknown parameter "edge_radios"; did you mean "edge_radius"?',
    ),
    "start unit": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nedge_radius = 1\n',
        'bench.toml, line 18, [start] edge_radius: "1" has no unit; write it in quotes, such as "1.5 um"',
    ),
    "start range": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nclearance = "0 um"\n',
        'bench.toml, line 18, [start] clearance: "0 um" is out of range; it must be above zero, up to the stroke',
    ),
    "start coefficient": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\ndischarge_coefficient = 11\n',
        'bench.toml, line 18, [start] discharge_coefficient: "11" is out of range; it must be from 0.001 to 10',
    ),
    "meter": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\nmeter = "tank"\n',
        "bench.toml, line 17, [tests.leakage] meter: must be one of return, supply",
    ),
    "start key": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nclearance = { val = "1 um" }\n',
        'bench.toml, line 18, [start.clearance] val: unknown key "val"; did you mean "value"?',
    ),
    "start minmax": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nclearance = { value = "1 um", min="2 um", max="1 um" }\n',
        "bench.toml, line 18, [start.clearance] min: min must be below max",
    ),
    "start outside": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nclearance = { value = "1 um", min="2 um" }\n',
        'bench.toml, line 18, [start.clearance] value: the starting value "1 um" lies outside min and max',
    ),
    "start flag": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nclearance = { value = "1 um", fixed="yes" }\n',
        'bench.toml, line 18, [start.clearance] fixed: "yes" is neither true nor false (without quotes)',
    ),
    "start eta": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nheat_retention = 1.5\n',
        'bench.toml, line 18, [start] heat_retention: "1.5" is out of range; it must be from 0 (isothermal) to 1 (adiabatic)',
    ),
    "start eta type": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[start]\nheat_retention = true\n',
        'bench.toml, line 18, [start] heat_retention: "True" is not a quantity; expected a plain number such as 1',
    ),
    "only dynamic": (
        "[tests.leakage]",
        "[tests.step]",
        'leakage.csv, line 2: the step test needs a column command [um] or command [mA], but the file has "time [s]", "run", "spool_position [um]", "leakage_flow [l/min]"',
    ),
    "chamber": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[actuator]\nchamber_volume="30 cm^3"\n',
        "bench.toml, line 18, [actuator] chamber_volume: the chamber volume 30 cm^3 must be larger than piston_area * piston_stroke / 2 = 30 cm^3, which the piston sweeps from mid stroke",
    ),
    "area": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[actuator]\npiston_area="30 cm^2"\n',
        "bench.toml, line 17, [actuator]: the chamber volume 60 cm^3 must be larger than piston_area * piston_stroke / 2 = 75 cm^3, which the piston sweeps from mid stroke",
    ),
    "mass": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[actuator]\nmoving_mass="-1 kg"\n',
        'bench.toml, line 18, [actuator] moving_mass: "-1 kg" must be positive',
    ),
    "heat": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[actuator]\nheat="warm"\n',
        "bench.toml, line 18, [actuator] heat: must be one of adiabatic, isothermal",
    ),
    "actuator key": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[actuator]\npiston_aera="1 cm^2"\n',
        'bench.toml, line 18, [actuator] piston_aera: unknown key "piston_aera"; did you mean "piston_area"?',
    ),
    "ctl": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[actuator]\ncontroller={amplifier_gain="0.01 A/V"}\n',
        "bench.toml, line 18, [actuator.controller]: sensor_gain is missing; a controller needs amplifier_gain and sensor_gain",
    ),
    "output": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[tests.frequency]\nfile="f"\noutput="flow"\n',
        "bench.toml, line 19, [tests.frequency] output: must be one of spool_position, piston_velocity, piston_position",
    ),
    "step output": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[tests.step]\nfile="f"\noutput="flow"\n',
        'bench.toml, line 19, [tests.step] output: unknown key "output"; known: kind, file, date, noise, columns, ignore, missing, skip_rows, sheet, variable, group, command',
    ),
    "step noise": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[tests.step]\nfile="f"\nnoise="1 um"\n',
        'bench.toml, line 19, [tests.step] noise: the readings differ in kind; write one value per reading: { spool_position = "...", pressure_a = "..." }',
    ),
    "absolute": (
        'file = "leakage.csv"\n',
        'file = "leakage.csv"\n[tests.frequency]\nfile="f"\nabsolute=1\n',
        'bench.toml, line 19, [tests.frequency] absolute: "1" is neither true nor false (without quotes)',
    ),
}

WHOLE = {
    "controller without rated current": (
        TOML.replace('rated_current = "25 mA"\n', "")
        + '[actuator]\ncontroller = { amplifier_gain = "0.01 A/V", sensor_gain = "100 V/m" }\n',
        "bench.toml, line 17, [actuator.controller]: a controller drives the valve by a current: [valve] needs rated_current",
    ),
    "huge hexadecimal": (
        TOML.replace("= -1", "= 0x" + "f" * 5000),
        'bench.toml, line 6, [valve] polarity: "a number of thousands of digits" must be 1, or -1 where a positive current gives a negative flow',
    ),
    "huge integer": (TOML.replace("= -1", "= " + "9" * 5000), "bench.toml: holds a number of thousands of digits"),
    "deep nesting": (TOML + "a=" + "[" * 5000, "bench.toml: is nested too deeply to be a bench.toml"),
    "too large": (
        "#" * 1_000_001,
        "bench.toml: has 1,000,001 bytes, more than the 1,000,000 that are read; a bench.toml is a page",
    ),
}


def message(folder) -> str:
    with pytest.raises(BenchInputError) as caught:
        read_record(folder)
    return str(caught.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_file(tmp_path, name):
    old, new, expected = SPOILED[name]
    assert TOML.count(old) == 1
    assert message(write_record(tmp_path, TOML.replace(old, new))) == expected


@pytest.mark.parametrize("name", WHOLE)
def test_a_file_that_is_far_off(tmp_path, name):
    content, expected = WHOLE[name]
    assert message(write_record(tmp_path, content)) == expected


def test_a_file_that_is_not_utf8(tmp_path):
    folder = write_record(tmp_path)
    (folder / "bench.toml").write_bytes(TOML.replace("test valve", "Prüfling").encode("latin-1"))
    assert message(folder) == "bench.toml, line 2: is not UTF-8 text; save the file as UTF-8"


def test_folders_that_hold_no_record(tmp_path):
    assert message(tmp_path / "none") == f"{tmp_path}/none: no such folder"
    assert message(tmp_path) == f"{tmp_path}: holds no bench.toml; `thermohyd new` writes a template"
    (tmp_path / "file").write_text("")
    assert message(tmp_path / "file") == f"{tmp_path}/file: is a file; give the folder of the record or its bench.toml"
