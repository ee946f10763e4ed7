"""Records that no bench can have measured are refused; those that are only unusual are read with a warning that reaches the user."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit


COLUMNS = "spool_position [um],leakage_flow [l/min],{header}\n-100,0.1,{a}\n0,0.3,{b}\n100,0.1,{a}\n"
POINTS = TOML.replace('preset = "mil-prf-5606"', 'viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]')


def message(folder) -> str:
    with pytest.raises(BenchInputError) as caught:
        read_record(folder)
    return str(caught.value).removeprefix(f"{folder}/")


IMPOSSIBLE = {
    "stroke": (
        'stroke = "200 um"', 'stroke = "213 m"',
        'bench.toml, line 3, [valve] stroke: "213 m" is none: a spool\'s stroke lies between 1 um and 50 mm; did you mean "213 um"?',
    ),
    "stroke in inches": (
        'stroke = "200 um"', 'stroke = "0.008 um"',
        'bench.toml, line 3, [valve] stroke: "0.008 um" is none: a spool\'s stroke lies between 1 um and 50 mm; did you mean "0.008 inch"?',
    ),
    "stroke of nothing known": (
        'stroke = "200 um"', 'stroke = "1e9 m"',
        'bench.toml, line 3, [valve] stroke: "1e9 m" is none: a spool\'s stroke lies between 1 um and 50 mm; is the unit right?',
    ),
    "slot": (
        'slot_width = "12 mm"', 'slot_width = "12 m"',
        'bench.toml, line 4, [valve] slot_width: "12 m" is none: the slots of an edge are 0.01 mm to 1 m wide; is the unit right?',
    ),
    "rated current": (
        'rated_current = "25 mA"', 'rated_current = "25 MA"',
        'bench.toml, line 5, [valve] rated_current: "25 MA" is none: a rated current lies between 0.1 mA and 100 A; is the unit right?',
    ),
    "supply in psi": (
        'supply_pressure = "70 bar"', 'supply_pressure = "1015 bar"',
        'bench.toml, line 12, [conditions] supply_pressure: "1015 bar" is above 700 bar, more than a servovalve bears; is the unit right? 1015 psi would be 70 bar',
    ),
    "hot": (
        'temperature = "40 degC"', 'temperature = "400 C"',
        'bench.toml, line 13, [conditions] temperature: "400 C" lies outside -80 to 250 degC; is the unit right? 400 K would be 127 degC',
    ),
    "no supply": (
        'supply_pressure = "70 bar"', 'supply_pressure = "0 bar"',
        "bench.toml, line 12, [conditions] supply_pressure: the supply pressure, 0 bar, does not exceed the return pressure, 0 bar; is the unit right?",
    ),
    "next to no supply": (
        'supply_pressure = "70 bar"', 'supply_pressure = "0.001 bar"',
        "bench.toml, line 12, [conditions] supply_pressure: the supply pressure, 0.001 bar, does not exceed the return pressure, 0 bar, by as much as 0.1 bar; is the unit right?",
    ),
    "next to no return pressure": (
        'supply_pressure = "70 bar"', 'supply_pressure = "70 bar"\nreturn_pressure = "0.001 bar"',
        "bench.toml, line 13, [conditions] return_pressure: 0.001 bar in every row is next to nothing; is the unit right? If so, write 0 bar",
    ),
    "return above supply": (
        'supply_pressure = "70 bar"', 'supply_pressure = "70 bar"\nreturn_pressure = "90 bar"',
        "bench.toml, line 12, [conditions] supply_pressure: the supply pressure, 70 bar, does not exceed the return pressure, 90 bar; is the unit right?",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_values_in_bench_toml(tmp_path, name):
    old, new, expected = IMPOSSIBLE[name]
    assert TOML.count(old) == 1
    assert message(write_record(tmp_path, TOML.replace(old, new))) == expected


@pytest.mark.parametrize("required", [True, False])
def test_a_reading_that_is_zero_in_every_row(tmp_path, required):
    folder = write_record(tmp_path, leakage=LEAKAGE.replace(",0.1\n", ",0\n").replace(",0.3\n", ",0.0\n"))
    if not required:  # predictions need none
        assert read_record(folder, readings_required=False).tests["leakage"].rows == 5
        return
    expected = "every reading is 0; is the sensor connected, and this its column? Leave the column out otherwise"
    assert message(folder) == f'leakage.csv, line 2, column "leakage_flow [l/min]": {expected}'


IMPOSSIBLE_COLUMNS = {
    "supply in psi": (("supply_pressure [bar]", 1015, 1020), 'line 2, column "supply_pressure [bar]": 1015 is above 700 bar, more than a servovalve bears; is the unit right? 1015 psi would be 70 bar'),
    "supply once off": (("supply_pressure [bar]", 70, 0), 'line 3, column "supply_pressure [bar]": the supply pressure, 0 bar, does not exceed the return pressure, 0 bar; is the unit right? Leave out rows without supply'),
    "supply off": (("supply_pressure [bar]", 0, 70), 'line 2, column "supply_pressure [bar]": the supply pressure, 0 bar, does not exceed the return pressure, 0 bar (so in 2 rows); is the unit right? Leave out rows without supply'),
    "return above supply": (("return_pressure [bar]", 0, 90), 'line 3, column "return_pressure [bar]": the supply pressure, 70 bar, does not exceed the return pressure, 90 bar; is the unit right? Leave out rows without supply'),
    "degrees as kelvin": (("temperature [K]", 40, 40), 'line 2, column "temperature [K]": 40 lies outside -80 to 250 degC; is the unit right? 40 degC would be usual'),
    "kelvin as degrees": (("temperature [degC]", 313, 313), 'line 2, column "temperature [degC]": 313 lies outside -80 to 250 degC; is the unit right? 313 K would be 39.9 degC'),
    "on fire": (("temperature [degC]", 900, 900), 'line 2, column "temperature [degC]": 900 lies outside -80 to 250 degC; is the unit right?'),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPOSSIBLE_COLUMNS)
def test_impossible_columns(tmp_path, name):
    (header, a, b), expected = IMPOSSIBLE_COLUMNS[name]
    folder = write_record(tmp_path, leakage=COLUMNS.format(header=header, a=a, b=b))
    assert message(folder) == f"leakage.csv, {expected}"


def test_a_position_in_another_unit(tmp_path):
    folder = write_record(tmp_path, leakage="spool_position [mm],leakage_flow [l/min]\n-180,0.1\n0,0.3\n")
    expected = "-180 is beyond twice the stroke (200 um); is the unit right? In um it would fit"
    assert message(folder) == f'leakage.csv, line 2, column "spool_position [mm]": {expected}'


UNUSUAL = {
    "supply in bar, named psi": (("supply_pressure [psi]", 70, 70), "leakage.csv: the supply pressure is 4.83 bar, low for a servovalve; are the values in bar?"),
    "hot oil": (("temperature [degC]", 120, 120), "leakage.csv: the oil is at 120 degC, but its viscosity is given for -40 to 70 degC only: what it is there is a guess, and with it the result; is the unit of temperature right?"),
    "hot and cold": (("temperature [degF]", 104, 300), "leakage.csv: the oil is at 40 to 149 degC, but its viscosity is given for -40 to 70 degC only: what it is there is a guess, and with it the result; is the unit of temperature right?"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNUSUAL)
def test_unusual_columns_are_read_with_a_warning(tmp_path, name):
    (header, a, b), expected = UNUSUAL[name]
    assert read_record(write_record(tmp_path, POINTS, leakage=COLUMNS.format(header=header, a=a, b=b))).warnings == (
        expected,
    )


READINGS = {
    "position": ("leakage", "spool_position [um],leakage_flow [l/min]\n-0.2,0.1\n0.2,0.1\n", "x.csv: spool_position reaches only 0.1 % of the stroke: is its unit right?"),
    "current": ("leakage", "current [uA],leakage_flow [l/min]\n-25,0.1\n25,0.1\n", "x.csv: current reaches only 0.1 % of the rated one: is its unit right?"),
    "flow": ("flow_gain", "spool_position [um],flow [l/min]\n0,0\n100,9000\n200,9900\n", "x.csv: flow reaches 9900 l/min (so in 2 rows), but slots of this width and stroke pass 18.5 l/min at most: are the units right, of the flow and in [valve]?"),
    "leakage": ("leakage", "spool_position [um],leakage_flow [l/min]\n0,900\n100,0.1\n", "x.csv: leakage_flow reaches 900 l/min (in one row), but slots of this width and stroke pass 18.5 l/min at most: are the units right, of the flow and in [valve]?"),
    "load pressure": ("pressure_gain", "spool_position [um],load_pressure [bar]\n0,0\n20,690\n-20,-690\n", "x.csv: load_pressure is 690 bar at a supply of 70 bar in line 3 and in 1 more: no load pressure exceeds its supply; are the units right?"),
}  # fmt: skip


@pytest.mark.parametrize("name", READINGS)
def test_unusual_readings_are_read_with_a_warning(tmp_path, name):
    test, text, expected = READINGS[name]
    toml = TOML.replace("[tests.leakage]", f"[tests.{test}]").replace("leakage.csv", "x.csv")
    assert read_record(write_record(tmp_path, toml, x=text)).warnings == (expected,)


def test_volts_of_a_gain_that_is_not_known_say_nothing(tmp_path):
    """8 V are not 8 m3/s."""
    toml = TOML.replace("[tests.leakage]", "[tests.flow_gain]").replace("leakage.csv", "x.csv")
    toml += '\n[sensors]\nflow = { gain = "free" }\n'
    text = "spool_position [um],flow [V]\n-100,-4\n0,0\n100,4\n200,8\n"
    assert read_record(write_record(tmp_path, toml, x=text)).warnings == ()


def test_an_ordinary_record_has_no_warning(tmp_path):
    usual = COLUMNS.format(header="temperature [degC]", a=-60, b=105)
    assert read_record(write_record(tmp_path, POINTS, leakage=usual)).warnings == ()
    assert read_record(write_record(tmp_path)).warnings == ()


def test_the_warning_reaches_the_report(tmp_path):
    held = '[start]\nedge_radius = { value = "10 um", fixed = true }\nclearance = { value = "3 um", fixed = true }\n'
    held += "discharge_coefficient = { value = 0.7, fixed = true }\ntransition_number = { value = 100, fixed = true }\n"
    held += 'underlap = { value = "5 um", fixed = true }\n'
    rows = "".join(f"{x},{0.02 + 0.001 * (x % 7)},70\n" for x in range(-50, 51, 5))
    text = f"spool_position [um],leakage_flow [l/min],supply_pressure [psi]\n{rows}"
    result = fit(read_record(write_record(tmp_path, POINTS + 'noise = "0.01 l/min"\n' + held, leakage=text)))
    assert (
        "leakage.csv: the supply pressure is 4.83 bar, low for a servovalve; are the values in bar?" in result.warnings
    )
