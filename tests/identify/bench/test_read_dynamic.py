"""Step and frequency tests as they are read, and every way in which they can be wrong, with the message that is printed."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import json
import re

import numpy as np
import pytest
from helpers.bench_folder import TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.provenance import record_json
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.record import ActuatorData, BenchRecord
from thermohyd.identify.model.model_file import load_model, nominal_model, save_model


CLOSED = 'controller = { amplifier_gain = "0.01 A/V", sensor_gain = "100 V/m" }\n'
BENCH = (
    TOML.split("[tests.leakage]")[0]
    + '[tests.step]\nfile = "step.csv"\nnoise = { piston_position = "5 um", pressure_a = "0.2 bar" }\n'
    + '[tests.frequency]\nfile = "f.csv"\n[actuator]\nmoving_mass = "80 kg"\n'
    + CLOSED
)
STEP = (
    "time [s],run,command [mm],external_force [kN],piston_position [mm],pressure_a [bar]\n"
    "0,a,0,1,0,20\n0.1,a,1,1,0.2,21\n0.5,b,0,1,0,20\n0.6,b,1,1,0.2,21\n"
)
RESPONSE = "frequency [Hz],amplitude_ratio [1],phase [deg]\n1,1,-1\n10,0.9,-20\n"


def read(folder, toml=BENCH, step=STEP, f=RESPONSE, **options):
    return read_record(write_record(folder, toml, step=step, f=f), **options)


def test_both_tests_in_si(tmp_path):
    record = read(tmp_path)
    assert not record.static_tests
    assert record.actuator is not None
    step, response = record.dynamic_tests["step"], record.dynamic_tests["frequency"]
    assert (record.actuator.moving_mass, record.actuator.piston_area) == (80.0, pytest.approx(12e-4))
    assert record.actuator.closed_loop
    assert (step.command_kind, step.run_names) == ("setpoint", ("a", "b"))
    assert step.external_force is not None
    np.testing.assert_allclose(step.external_force, 1e3)
    np.testing.assert_allclose(step.command, [0.0, 1e-3, 0.0, 1e-3])
    assert {c.name: None if c.std is None else c.std[0] for c in step.channels} == {
        "pressure_a": pytest.approx(0.2e5),
        "piston_position": pytest.approx(5e-6),
    }
    assert response.frequency is not None
    np.testing.assert_allclose(np.rad2deg(response.channels[1].value), [-1.0, -20.0])


def test_static_and_dynamic_together(tmp_path):
    toml = BENCH.replace("[tests.step]", '[tests.leakage]\nfile = "leakage.csv"\n[tests.step]')
    record = read(tmp_path, toml)
    assert list(record.static_tests) == ["leakage"]
    assert list(record.tests) == ["leakage", "step", "frequency"]


OWN = BENCH.replace("[tests.step]\n", '[tests.step_slow]\nkind = "step"\n')


def test_several_step_tests_have_names_of_their_own(tmp_path):
    again = '[tests.step]\nfile = "again.csv"\n[tests.frequency_cold]\nfile = "f.csv"\noutput = "piston_position"\n'
    record = read_record(
        write_record(tmp_path, again + OWN, step=STEP, f=RESPONSE, again=STEP.replace("0.1,a", "0.2,a"))
    )
    assert record.actuator is not None
    tests = record.dynamic_tests
    assert {name: (test.name, test.kind) for name, test in tests.items()} == {
        "step": ("step", "step"),
        "frequency_cold": ("frequency_cold", "frequency"),
        "step_slow": ("step_slow", "step"),
        "frequency": ("frequency", "frequency"),
    }
    assert tests["frequency_cold"].output == "piston_position"
    assert [c.name for c in tests["step"].channels] == [c.name for c in tests["step_slow"].channels]
    assert [tests[name].place[1] for name in ("step", "step_slow")] == [0.2, 0.1]
    assert tests["step"].channels[0].std is None
    assert tests["step_slow"].channels[0].std is not None


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("slow", "step", '[tests] slow: a step test\'s own name must begin with its kind: [tests.step_slow]'),
        ("step_slow", "frequency", '[tests.step_slow] kind: must be "step", with which the name of the test begins'),
        ("step", "frequency", '[tests.step] kind: must be "step", with which the name of the test begins'),
        ("step_Slow", "step", '[tests] step_Slow: "step_Slow" becomes the name of files: use only small letters, digits and underscores'),
        ("leakage_cold", "leakage", '[tests] leakage_cold: a record has one leakage test; put all its sweeps into one file, told apart by a column run'),
        ("steps", "steps", '[tests] steps: unknown test "steps"; did you mean "step"?'),
    ],
)  # fmt: skip
def test_a_name_that_no_test_can_have(tmp_path, name, kind, words):
    toml = OWN.replace("step_slow", name).replace('kind = "step"', f'kind = "{kind}"')
    with pytest.raises(BenchInputError) as raised:
        read(tmp_path, toml)
    assert str(raised.value).partition(", line ")[2].partition(", ")[2] == words


@pytest.mark.parametrize(("unit", "kind"), [("um", "spool_position"), ("mA", "current"), ("%", "spool_position")])
def test_an_open_loop_is_told_by_position_or_current(tmp_path, unit, kind):
    record = read(tmp_path, BENCH.replace(CLOSED, ""), STEP.replace("command [mm]", f"command [{unit}]"))
    assert record.actuator is not None
    assert record.dynamic_tests["step"].command_kind == kind


def test_predictions_need_no_reading(tmp_path):
    step = "time [s],command [mm]\n0,0\n0.1,1\n"
    record = read(tmp_path, BENCH.replace("noise", "# noise"), step, readings_required=False)
    assert record.actuator is not None
    assert record.dynamic_tests["step"].channels == ()


UNEQUAL = 'piston_area_a = "12.5 cm^2"\npiston_area_b = "8.5 cm^2"\nchamber_volume_a = "55 cm^3"\nchamber_volume_b = "40 cm^3"'


def test_a_jack_of_unequal_sides_to_and_from_model_json_and_arrays(tmp_path):
    record = read(tmp_path, BENCH.replace('moving_mass = "80 kg"', UNEQUAL))
    jack = record.actuator
    assert jack is not None
    assert (jack.piston_area, jack.chamber_volume) == (None, None)
    sides = {"piston_area_a": 12.5e-4, "piston_area_b": 8.5e-4, "chamber_volume_a": 55e-6, "chamber_volume_b": 40e-6}
    assert {name: getattr(jack, name) for name in sides} == pytest.approx(sides)
    written = record_json(record)["actuator"]
    assert {key for key in written if key.startswith(("piston_area", "chamber_volume"))} == set(sides)
    path = save_model(nominal_model(record), tmp_path / "model.json")
    assert load_model(path).actuator == jack
    time = np.array([0.0, 0.1])
    made = BenchRecord.from_arrays(
        {"step": {"time": time, "command": np.array([0.0, 1e-3]), "piston_position": np.zeros(2)}},
        valve=record.valve, oil=record.oil, actuator=jack,
        conditions={"supply_pressure": 70e5, "return_pressure": 0.0, "temperature": 313.15},
    )  # fmt: skip
    assert made.actuator == jack


def test_one_pair_leaves_the_other_quantity_to_both_sides(tmp_path):
    lines = read(tmp_path, BENCH.replace('moving_mass = "80 kg"', UNEQUAL.split("\n", 2)[2])).actuator
    assert lines is not None
    assert (lines.piston_area, lines.chamber_volume, lines.chamber_volume_a) == pytest.approx((12e-4, None, 55e-6))
    assert {"piston_area", "chamber_volume_a"} < set(lines.to_dict())
    plain = ActuatorData()
    assert (plain.piston_area, plain.chamber_volume) == (12e-4, 60e-6)
    assert not any(key.endswith(("_a", "_b")) for key in plain.to_dict())


@pytest.mark.parametrize(
    ("sides", "words"),
    [
        ({"piston_area": 12e-4, "piston_area_a": 12e-4, "piston_area_b": 8e-4}, '"actuator" "piston_area" holds for both sides'),
        ({"chamber_volume_a": 50e-6}, '"actuator" "chamber_volume_a" is of one side only and chamber_volume_b is missing'),
        ({"piston_area_a": 12e-4, "piston_area_b": 0.0}, '"actuator" "piston_area_b" must be positive'),
    ],
)  # fmt: skip
def test_sides_of_a_model_json_written_by_hand(tmp_path, sides, words):
    content = json.loads(save_model(nominal_model(read(tmp_path)), tmp_path / "model.json").read_text())
    own = {key: v for key, v in content["actuator"].items() if key not in ("piston_area", "chamber_volume")}
    path = tmp_path / "by_hand.json"
    path.write_text(json.dumps({**content, "actuator": {**own, **sides}}))
    with pytest.raises(BenchInputError, match=re.escape(words)):
        load_model(path)


SPOILED = {
    "unit": ({"step": STEP.replace("command [mm]", "command [mA]")}, 'step.csv, line 1, column "command [mA]": "mA" is a current; expected a length such as um'),
    "open unit": ({"toml": BENCH.replace(CLOSED, ""), "step": STEP.replace("command [mm]", "command [bar]")}, 'step.csv, line 1, column "command [bar]": "bar" is a pressure; expected a length such as um, or a current such as mA'),
    "time": ({"step": STEP.replace("0.1,a", "0,a")}, 'step.csv, line 3, column "time [s]": time must rise from row to row within a run; give each run of the test its own name in a column run'),
    "one row": ({"step": STEP.replace("0.6,b", "0.6,c")}, 'step.csv, line 4, column "run": run "b" has one row (2 runs are such); a run is a whole sweep, and each of its rows bears its name: correct it, or list the column in ignore'),
    "far setpoint": ({"step": STEP.replace("0.1,a,1", "0.1,a,60")}, 'step.csv, line 3, column "command [mm]": 60 is beyond half the piston\'s stroke (25 mm); is the unit right?'),
    "far piston": ({"step": STEP.replace("1,1,0.2,21\n0.5", "1,1,200.5,21\n0.5")}, 'step.csv, line 3, column "piston_position [mm]": 200.5 is beyond the piston\'s stroke (50 mm); is the unit right?'),
    "no command": ({"step": STEP.replace("command [mm]", "_command")}, 'step.csv, line 1: the step test needs a column command [mm], a setpoint of the piston, but the file has "time [s]", "run", "_command", "external_force [kN]", "piston_position [mm]", "pressure_a [bar]"; if that is "_command", write columns = { command = "_command [um]" } in [tests.step]'),
    "no reading": ({"f": "frequency [Hz]\n1\n"}, 'f.csv, line 1: the frequency test needs a column amplitude_ratio [1] or phase [deg], a reading, but the file has "frequency [Hz]"'),
    "decibels": ({"f": RESPONSE.replace("0.9", "-3")}, 'f.csv, line 3, column "amplitude_ratio [1]": an amplitude ratio must be above zero; it is a ratio, not dB'),
    "zero": ({"f": RESPONSE.replace("\n1,1", "\n0,1")}, 'f.csv, line 2, column "frequency [Hz]": a frequency must be above zero'),
    "text": ({"f": RESPONSE.replace("0.9", "high")}, None),
    "asymptote": ({"toml": BENCH.replace(CLOSED, "").replace('"f.csv"', '"f.csv"\noutput = "piston_position"')}, None),
    "volume": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'chamber_volume = "10 cm^3"')}, None),
    "both and pair": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'piston_area = "12 cm^2"\npiston_area_a = "12 cm^2"\npiston_area_b = "8 cm^2"')}, "bench.toml, line 21, [actuator] piston_area: holds for both sides: give either piston_area or the pair piston_area_a, piston_area_b"),
    "both and half": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'chamber_volume_b = "50 cm^3"\nchamber_volume = "60 cm^3"')}, "bench.toml, line 22, [actuator] chamber_volume: holds for both sides: give either chamber_volume or the pair chamber_volume_a, chamber_volume_b"),
    "half a pair": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'piston_area_b = "8 cm^2"')}, "bench.toml, line 21, [actuator] piston_area_b: is of one side only and piston_area_a is missing: give both of them, or piston_area for a jack of equal sides"),
    "area of a side": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'piston_area_a = "8 cm"\npiston_area_b = "8 cm^2"')}, 'bench.toml, line 21, [actuator] piston_area_a: "cm" is a length; expected an area such as cm^2'),
    "negative side": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'piston_area_a = "8 cm^2"\npiston_area_b = "-8 cm^2"')}, 'bench.toml, line 22, [actuator] piston_area_b: "-8 cm^2" must be positive'),
    "volume of a side": ({"toml": BENCH.replace('moving_mass = "80 kg"', UNEQUAL.replace("40 cm^3", "20 cm^3"))}, "bench.toml, line 24, [actuator] chamber_volume_b: the chamber volume 20 cm^3 must be larger than piston_area_b * piston_stroke / 2 = 21.25 cm^3, which the piston sweeps from mid stroke"),
    "default volume": ({"toml": BENCH.replace('moving_mass = "80 kg"', 'piston_area_a = "30 cm^2"\npiston_area_b = "8 cm^2"')}, "bench.toml, line 20, [actuator]: the chamber volume 60 cm^3 must be larger than piston_area_a * piston_stroke / 2 = 75 cm^3, which the piston sweeps from mid stroke"),
    "loop": ({"toml": BENCH.replace(', sensor_gain = "100 V/m"', "")}, None),
    "start": ({"toml": BENCH + "[start]\nspool_frequncy = \"90 Hz\"\n"}, None),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_record_gets_one_line(tmp_path, name):
    changes, expected = SPOILED[name]
    with pytest.raises(BenchInputError) as raised:
        read(tmp_path, **changes)
    words = str(raised.value).removeprefix(f"{tmp_path}/")
    assert "\n" not in words
    assert ", line " in words
    if expected is not None:
        assert words == expected
