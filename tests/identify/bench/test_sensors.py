"""Columns in volts and counts: what a gain and a zero make of them, and what is refused."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import numpy as np
import pytest
from helpers.bench_folder import TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import Sensor


LEAKAGE = "spool_position [um],leakage_flow [{unit}]\n-10,1.1\n0,1.3\n10,1.1\n"
READ = np.array([1.1, 1.3, 1.1])


def read(folder, sensor: str, unit: str = "V", more: str = "", column: str = "leakage_flow"):
    toml = f"{TOML}{more}\n[sensors]\n{column} = {sensor}\n"
    return read_record(write_record(folder, toml, leakage=LEAKAGE.format(unit=unit)))


def channel(record):
    return record.tests["leakage"].channels[0]


def test_a_stated_gain_is_a_unit(tmp_path):
    found = channel(read(tmp_path, '{ gain = "0.5 l/min/V", zero = "100 mV" }', more='noise = "2 mV"'))
    np.testing.assert_allclose(found.value, 0.5 / 6e4 * (READ - 0.1))
    assert found.std is not None
    np.testing.assert_allclose(found.std, 0.5 / 6e4 * 2e-3)
    assert found.sensor is None
    assert found.signal == ""


@pytest.mark.parametrize(
    ("gain", "unit", "factor"),
    [
        ("0.5 l/min/mV", "V", 500.0 / 6e4),
        ("-0.5 l/min/V", "mV", -0.5e-3 / 6e4),
        ("0.01 l/min/count", "counts", 0.01 / 6e4),
    ],
)
def test_units_of_signals(tmp_path, gain, unit, factor):
    np.testing.assert_allclose(channel(read(tmp_path, f'{{ gain = "{gain}" }}', unit)).value, factor * READ)


def test_a_column_in_si_needs_no_sensor(tmp_path):
    found = channel(read(tmp_path, '{ gain = "0.5 l/min/V", tolerance = "1 %" }', "l/min"))
    np.testing.assert_allclose(found.value, READ / 6e4)
    assert found.sensor is None


def test_a_tolerance_is_a_prior_and_the_reading_stays_si(tmp_path):
    found = channel(read(tmp_path, '{ gain = "0.5 l/min/V", tolerance = "1 %", zero_tolerance = "5 mV" }'))
    np.testing.assert_allclose(found.value, 0.5 / 6e4 * READ)
    assert found.sensor is not None
    assert (found.sensor.tolerance, found.sensor.zero_tolerance) == (pytest.approx(0.01), pytest.approx(5e-3))


def test_a_free_gain_keeps_the_signal(tmp_path):
    record = read(tmp_path, '{ gain = "free", zero = "0.2 V" }', more='noise = "2 mV"')
    found = channel(record)
    np.testing.assert_allclose(found.value, READ)
    assert found.std is not None
    np.testing.assert_allclose(found.std, 2e-3)
    assert found.signal == "V"
    assert record.sensors == {"leakage_flow": Sensor("leakage_flow", None, "V", zero=0.2)}
    assert record.unit_of("leakage", "leakage_flow").label == "V"


def test_a_zero_alone(tmp_path):
    found = channel(read(tmp_path, '{ zero = "free" }', "l/min"))
    np.testing.assert_allclose(found.value, READ / 6e4)
    assert found.sensor == Sensor("leakage_flow", free_zero="free")


def test_an_axis_in_percent_of_the_stroke_per_volt(tmp_path):
    toml = TOML + '\n[sensors]\nspool_position = { gain = "10 %/V" }\n'
    csv = "spool_position [V],leakage_flow [l/min]\n-1,1.1\n0,1.3\n1,1.1\n"
    record = read_record(write_record(tmp_path, toml, leakage=csv))
    np.testing.assert_allclose(record.tests["leakage"].spool_position, [-20e-6, 0.0, 20e-6], atol=1e-18)


def test_a_temperature_per_volt_is_a_difference(tmp_path):
    toml = TOML + '\n[sensors]\ntemperature = { gain = "10 degC/V", zero = "-27.315 V" }\n'
    csv = "spool_position [um],leakage_flow [l/min],temperature [V]\n-10,1.1,4\n0,1.3,4\n10,1.1,5\n"
    record = read_record(write_record(tmp_path, toml, leakage=csv))
    np.testing.assert_allclose(record.tests["leakage"].temperature, [313.15, 313.15, 323.15])


REFUSED = {
    "no table": ('"free"', "V", '[sensors] leakage_flow: must be a table: leakage_flow = { gain = "free" }, or gain = "2.1 mm/V"'),
    "empty": ("{}", "V", '[sensors.leakage_flow]: is empty; write gain = "free", or a value such as gain = "2.1 mm/V"'),
    "no unit": (
        "{ gain = 3 }", "V",
        '[sensors.leakage_flow] gain: "3" must be a quantity per volt or count: "1.5 l/min/V", "0.01 l/min/count" or "free"',
    ),
    "another quantity": (
        '{ gain = "2 mm/V" }', "V",
        '[sensors.leakage_flow] gain: "mm" is a length; expected a flow such as l/min; a gain is written "1.5 l/min/V", "0.01 l/min/count" or "free"',
    ),
    "tolerance of a free gain": (
        '{ gain = "free", tolerance = "1 %" }', "V",
        "[sensors.leakage_flow] tolerance: is of a stated gain; a free gain needs none",
    ),
    "zero of another kind": (
        '{ gain = "free", zero = "1 bar" }', "V",
        '[sensors.leakage_flow] zero: "1 bar" must be a signal such as "1.5 V" or "1.5 count", "free" or "each run"',
    ),
    "counts in the file": (
        '{ gain = "0.5 l/min/V" }', "counts",
        'column "leakage_flow [counts]": "counts" is not a unit of a flow',
    ),
    "a free gain in SI": (
        '{ gain = "free" }', "l/min",
        'column "leakage_flow [l/min]": "l/min" is a flow; expected a voltage such as V',
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_refused(tmp_path, name):
    sensor, unit, expected = REFUSED[name]
    with pytest.raises(BenchInputError) as caught:
        read(tmp_path, sensor, unit)
    if name == "counts in the file":
        assert "counts" in str(caught.value)
        assert "expected a flow" in str(caught.value)
        return
    assert expected in str(caught.value)


def test_volts_without_a_sensor_name_the_table(tmp_path):
    with pytest.raises(BenchInputError, match=r'\[sensors\] says what it means: leakage_flow = \{ gain = "free" \}'):
        read_record(write_record(tmp_path, TOML, leakage=LEAKAGE.format(unit="V")))


def test_noise_of_a_free_gain_is_a_signal(tmp_path):
    with pytest.raises(BenchInputError, match=r'noise: "l/min" is a flow; expected a voltage such as V'):
        read(tmp_path, '{ gain = "free" }', more='noise = "0.1 l/min"')


def test_an_axis_cannot_be_estimated(tmp_path):
    toml = TOML + '\n[sensors]\nspool_position = { gain = "free" }\n'
    csv = "spool_position [V],leakage_flow [l/min]\n-1,1.1\n0,1.3\n1,1.1\n"
    with pytest.raises(
        BenchInputError, match="runs along this column, which is no reading: state its gain and its zero"
    ):
        read_record(write_record(tmp_path, toml, leakage=csv))


def test_from_arrays():
    record = BenchRecord.from_arrays(
        {"leakage": {"spool_position": [-1e-5, 0.0, 1e-5], "leakage_flow": READ}},
        valve={"stroke": 213e-6, "slot_width": "12 mm"},
        oil="mil-prf-5606",
        conditions={"supply_pressure": 70e5, "temperature": "40 degC"},
        sensors={"leakage_flow": {"gain": "free"}},
        noise={"leakage": 1e-3},
    )
    found = channel(record)
    np.testing.assert_allclose(found.value, READ)
    assert found.std is not None
    np.testing.assert_allclose(found.std, 1e-3)


ACTUATOR = '[actuator]\npiston_area = "10 cm^2"\ncontroller = {{ amplifier_gain = "0.01 A/V"{gain} }}\n'
STEP = "time [s],command [V],piston_position [V]\n0,0,0.1\n0.1,1,0.2\n0.2,1,0.3\n"


def step_toml(sensors: str, gain: str = "", test: str = "") -> str:
    own = TOML.split("[tests.leakage]")[0] + ACTUATOR.format(gain=gain)
    return f'{own}[tests.step]\nfile = "step.csv"\n{test}\n[sensors]\n{sensors}\n'


def step(folder, toml: str, csv: str = STEP):
    return read_record(write_record(folder, toml, step=csv))


def test_the_loops_own_sensor_scales_the_setpoint(tmp_path):
    record = step(tmp_path, step_toml('piston_position = { gain = "20 mm/V", zero = "0.5 V" }'))
    found = record.dynamic_tests["step"]
    assert record.actuator is not None
    assert record.actuator.sensor_gain == pytest.approx(50.0)
    np.testing.assert_allclose(found.command, 20e-3 * (np.array([0.0, 1.0, 1.0]) - 0.5))
    np.testing.assert_allclose(found.channels[0].value, 20e-3 * (np.array([0.1, 0.2, 0.3]) - 0.5))
    assert found.command_sensor is None


def test_a_free_sensor_in_the_loop(tmp_path):
    record = step(tmp_path, step_toml('piston_position = { gain = "free" }'))
    found = record.dynamic_tests["step"]
    assert found.command_sensor is not None
    assert found.command_sensor.in_loop
    np.testing.assert_allclose(found.command / found.command_reference, [0.0, 1.0, 1.0])
    assert "command_signal" in found.conditions
    assert found.command_kind == "setpoint"


def test_a_measured_controller_output_drives_the_valve(tmp_path):
    """The loop is closed, but its output was logged: the column drives the valve as in open loop."""
    toml = step_toml("", ', sensor_gain = "100 V/m"', 'command = "controller_output"').replace("[sensors]\n", "")
    csv = "time [s],command [mA],piston_position [mm]\n0,0,0\n0.1,5,0.1\n0.2,5,0.2\n"
    found = step(tmp_path, toml, csv).dynamic_tests["step"]
    assert found.command_kind == "current"
    np.testing.assert_allclose(found.command, [0.0, 5e-3, 5e-3])


def test_a_controller_output_in_volts(tmp_path):
    sensors = 'command = { gain = "10 %/V" }\npiston_position = { gain = "free", zero = "each run" }'
    found = step(
        tmp_path, step_toml(sensors, ', sensor_gain = "100 V/m"', 'command = "controller_output"')
    ).dynamic_tests["step"]
    assert found.command_kind == "spool_position"
    np.testing.assert_allclose(found.command, [0.0, 20e-6, 20e-6])
    assert found.channels[0].signal == "V"


STEPS_REFUSED = {
    "setpoint by another sensor": (
        step_toml('piston_position = { gain = "5 mm/V" }\ncommand = { gain = "free" }', ', sensor_gain = "100 V/m"'),
        "in closed loop the setpoint is compared with the piston's sensor",
    ),
    "no sensor gain": (
        step_toml('pressure_a = { gain = "1 bar/V" }'),
        "sensor_gain is missing; a controller needs amplifier_gain and sensor_gain",
    ),
    "a zero for each run of a loop": (
        step_toml('piston_position = { gain = "free", zero = "each run" }'),
        "the loop has one zero",
    ),
    "a negative gain in the loop": (
        step_toml('piston_position = { gain = "-2 mm/V" }'),
        "needs a positive gain per volt or count",
    ),
    "a word": (
        step_toml('piston_position = { gain = "free" }', test='command = "output"'),
        "[tests.step] command: must be one of setpoint, controller_output",
    ),
}


@pytest.mark.parametrize("name", STEPS_REFUSED)
def test_step_tests_refused(tmp_path, name):
    toml, expected = STEPS_REFUSED[name]
    with pytest.raises(BenchInputError) as caught:
        step(tmp_path, toml)
    assert expected in str(caught.value)


def test_a_setpoint_needs_a_loop(tmp_path):
    toml = step_toml('piston_position = { gain = "free" }', test='command = "setpoint"')
    toml = toml.replace('controller = { amplifier_gain = "0.01 A/V" }\n', "")
    with pytest.raises(BenchInputError, match="a setpoint needs a controller"):
        step(tmp_path, toml)


def with_data_sheet(folder, keys: str, more: str = ""):
    toml = f"{TOML}{keys}\n{more}"
    return read_record(write_record(folder, toml, leakage=LEAKAGE.format(unit="l/min")))


def test_a_data_sheet_is_a_prior(tmp_path):
    found = channel(with_data_sheet(tmp_path, 'gain = "1 %"\nzero = "0.5 %"'))
    np.testing.assert_allclose(found.value, READ / 6e4)
    assert found.sensor is not None
    assert (found.sensor.gain, found.sensor.tolerance) == (1.0, pytest.approx(0.01))
    assert found.sensor.zero_tolerance == pytest.approx(0.005 * 1.3 / 6e4)
    assert found.signal == ""
    only = channel(with_data_sheet(tmp_path, 'zero = "0.5 %"')).sensor
    assert only is not None
    assert not only.tolerance


@pytest.mark.parametrize(
    ("keys", "more", "words"),
    [
        ('gain = "60 %"', "", "must be at most 50 %"),
        ('gain = "-1 %"', "", "positive"),
        ('gain = "1 bar"', "", "gain"),
        ('gain = "1 %"', '[sensors]\nleakage_flow = { gain = "0.5 l/min/V" }', "both speak of one instrument"),
    ],
)
def test_a_data_sheet_that_makes_no_sense(tmp_path, keys, more, words):
    with pytest.raises(BenchInputError, match=words) as caught:
        with_data_sheet(tmp_path, keys, more)
    assert "bench.toml" in str(caught.value)
