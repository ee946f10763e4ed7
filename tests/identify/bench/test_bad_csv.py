"""Every way in which a CSV file can be wrong, with the message that its owner reads."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import gzip

import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


HEADERS = "time [s],run,spool_position [um],leakage_flow [l/min]"

# What is replaced in a sound file, by what, and the message.
SPOILED = {
    "unknown unit": (
        HEADERS,
        "time [s],run,spool_position [umm],leakage_flow [l/min]",
        'leakage.csv, line 2, column "spool_position [umm]": "umm" is not a unit; did you mean "um"?',
    ),
    "wrong dimension": (
        HEADERS,
        "time [s],run,spool_position [um],leakage_flow [bar]",
        'leakage.csv, line 2, column "leakage_flow [bar]": "bar" is a pressure; expected a flow such as l/min',
    ),
    "no unit": (
        HEADERS,
        "time [s],run,spool_position,leakage_flow [l/min]",
        'leakage.csv, line 2, column "spool_position": the unit is missing; write for example spool_position [um], or columns = { spool_position = "spool_position [um]" } in [tests.leakage]',
    ),
    "empty unit": (
        HEADERS,
        "time [s],run,spool_position [],leakage_flow [l/min]",
        'leakage.csv, line 2, column "spool_position []": the unit is missing; expected a length such as um',
    ),
    "unknown column": (
        HEADERS,
        "time [s],run,spool_position [um],leackage_flow [l/min]",
        'leakage.csv, line 2, column "leackage_flow [l/min]": unknown column "leackage_flow"; did you mean "leakage_flow"? Correct the header, or write columns = { leakage_flow = "leackage_flow [l/min]" } in [tests.leakage] (extra columns: start the name with _ or list it in ignore)',
    ),
    "unknown column far": (
        HEADERS,
        "xyz [s],run,spool_position [um],leakage_flow [l/min]",
        'leakage.csv, line 2, column "xyz [s]": unknown column "xyz"; known: run, time, spool_position, current, supply_pressure, return_pressure, temperature, leakage_flow, leakage_flow_std (extra columns: start the name with _ or list it in ignore)',
    ),
    "missing reading": (
        HEADERS,
        "time [s],run,spool_position [um],_leakage_flow [l/min]",
        'leakage.csv, line 2: the leakage test needs a column leakage_flow [l/min], but the file has "time [s]", "run", "spool_position [um]", "_leakage_flow [l/min]"; if that is "_leakage_flow [l/min]", write columns = { leakage_flow = "_leakage_flow [l/min]" } in [tests.leakage]',
    ),
    "missing position": (
        HEADERS,
        "time [s],run,_x [um],leakage_flow [l/min]",
        'leakage.csv, line 2: the leakage test needs a column spool_position [um] or current [mA], but the file has "time [s]", "run", "_x [um]", "leakage_flow [l/min]"; if that is "_x [um]", write columns = { spool_position = "_x [um]" } in [tests.leakage]',
    ),
    "text": (
        "1,up,0,0.3",
        "1,up,0,abc",
        'leakage.csv, line 4, column "leakage_flow [l/min]": "abc" is not a number; expected a number such as 1.5',
    ),
    "nan": (
        "1,up,0,0.3",
        "1,up,0,NaN",
        'leakage.csv, line 4, column "leakage_flow [l/min]": "NaN" is not a number; leave the row out, or write missing = "skip" in [tests.leakage]',
    ),
    "inf": (
        "1,up,0,0.3",
        "1,up,0,inf",
        'leakage.csv, line 4, column "leakage_flow [l/min]": inf is not a finite number; leave the row out',
    ),
    "empty cell": (
        "1,up,0,0.3",
        "1,up,0,",
        'leakage.csv, line 4, column "leakage_flow [l/min]": the cell is empty; leave the row out, or write missing = "skip" in [tests.leakage]',
    ),
    "true": (
        "1,up,0,0.3",
        "1,up,0,True",
        'leakage.csv, line 4, column "leakage_flow [l/min]": "True" is not a number; expected a number such as 1.5',
    ),
    "comma decimal quoted": (
        "1,up,0,0.3",
        '1,up,0,"0,3"',
        'leakage.csv, line 4, column "leakage_flow [l/min]": "0,3" is not a number; decimal commas need semicolons or tabs between the columns',
    ),
    "far": (
        "1,up,0,0.3",
        "1,up,401,0.3",
        'leakage.csv, line 4, column "spool_position [um]": 401 is beyond twice the stroke (200 um); is the unit right?',
    ),
    "abs zero": (
        "time [s],run,spool_position [um],leakage_flow [l/min]\n0,up,-10,0.1\n1,up,0,0.3",
        "temperature [degC],run,spool_position [um],leakage_flow [l/min]\n0,up,-10,0.1\n-273.15,up,0,0.3",
        'leakage.csv, line 4, column "temperature [degC]": -273.15 is at or below absolute zero (-273.15 degC, 0 K)',
    ),
    "kelvin": (
        HEADERS,
        "temperature [K],run,spool_position [um],leakage_flow [l/min]",
        'leakage.csv, line 3, column "temperature [K]": 0 is at or below absolute zero (-273.15 degC, 0 K)',
    ),
    "below vacuum": (
        "time [s],run,spool_position [um],leakage_flow [l/min]\n0,up,-10,0.1\n1,up,0,0.3",
        "supply_pressure [bar],run,spool_position [um],leakage_flow [l/min]\n0,up,-10,0.1\n-1.1,up,0,0.3",
        'leakage.csv, line 4, column "supply_pressure [bar]": -1.1 is below absolute zero pressure (-1.01325 bar gauge); pressures are gauge',
    ),
    "too high": (
        HEADERS,
        "supply_pressure [GPa],run,spool_position [um],leakage_flow [l/min]",
        'leakage.csv, line 4, column "supply_pressure [GPa]": 1 is above 700 bar, more than a servovalve bears; is the unit right?',
    ),
    "duplicate": (
        HEADERS,
        "leakage_flow [l/min],run,spool_position [um],leakage_flow [l/min]",
        'leakage.csv, line 2, column "leakage_flow [l/min]": duplicate header; each column needs a name of its own',
    ),
    "duplicate 2": (
        HEADERS,
        "leakage_flow [ml/min],run,spool_position [um],leakage_flow [l/min]",
        'leakage.csv, line 2, column "leakage_flow [l/min]": duplicate header: "leakage_flow [ml/min]" already gives leakage_flow; remove one, or list it in ignore',
    ),
    "short": (
        "1,up,0,0.3",
        "1,up,0",
        "leakage.csv, line 4: the row has 3 cells, but there are 4 headers; is the line cut off, or the separator wrong?",
    ),
    "long": (
        "1,up,0,0.3",
        "1,up,0,0.3,4",
        "leakage.csv, line 4: the row has 5 cells, but there are 4 headers; is the line cut off, or the separator wrong?",
    ),
    "unnamed": (
        HEADERS,
        "time [s],,spool_position [um],leakage_flow [l/min]",
        "leakage.csv, line 2: column 2 has no header; name it, or start its name with _ to leave it out",
    ),
    "time back": (
        "2,up,10,0.1",
        "0.5,up,10,0.1",
        'leakage.csv, line 6, column "time [s]": time runs backwards within one run; keep the order of the sweep, and give each sweep its own run',
    ),
    "std zero": (
        HEADERS,
        "leakage_flow_std [l/min],run,spool_position [um],leakage_flow [l/min]",
        'leakage.csv, line 3, column "leakage_flow_std [l/min]": a standard deviation must be above zero',
    ),
    "quote": (
        HEADERS,
        '"time [s],run,spool_position [um],leakage_flow [l/min]',
        'leakage.csv, line 2: a quote is not closed in ""time [s],run,spool_position [um],leakage_flow [l/min]"',
    ),
    "quote cell": ("1,up,0,0.3", '1,"up,0,0.3', 'leakage.csv, line 4: a quote is not closed in "1,"up,0,0.3"'),
}

WHOLE = {
    "empty": (b"", "leakage.csv: is empty; expected a line of headers and at least one row"),
    "endless header": (
        b"a" * 200_000 + b"\n1\n",
        "leakage.csv, line 1: the line of headers has 200,000 characters; expected one name and unit per column, such as spool_position [um]",
    ),
    "only comments": (b"# a\n\n# b\n", "leakage.csv: is empty; expected a line of headers and at least one row"),
    "only headers": (HEADERS.encode(), "leakage.csv, line 1: has headers but no rows"),
    "no headers": (
        b"0,up,1,2\n1,up,2,3\n",
        "leakage.csv, line 1: the headers are missing; the first line must name the columns, such as spool_position [um]",
    ),
    "not text": (b"spool\n\0\0", "leakage.csv, line 2: is not text; expected a CSV file"),
    "half a UTF-16 file": (b"\xff\xfea", "leakage.csv: is not text; expected a CSV file"),
    "half a gzip file": (
        gzip.compress(LEAKAGE.encode())[:40],
        "leakage.csv: is a damaged gzip file; compress it again",
    ),
    "decimal points and commas": (
        b"spool_position [um];leakage_flow [l/min]\n1;0,1\n\n2;1.000,5\n",
        'leakage.csv, line 4, column "leakage_flow [l/min]": "1.000,5" has a decimal point where other rows have decimal commas; use one of them',
    ),
}


def message(folder) -> str:
    with pytest.raises(BenchInputError) as caught:
        read_record(folder)
    return str(caught.value).removeprefix(f"{folder}/")


@pytest.mark.parametrize("name", SPOILED)
def test_a_spoiled_file(tmp_path, name):
    old, new, expected = SPOILED[name]
    assert LEAKAGE.count(old) == 1
    assert message(write_record(tmp_path, leakage=LEAKAGE.replace(old, new))) == expected


@pytest.mark.parametrize("name", WHOLE)
def test_a_file_that_is_no_table(tmp_path, name):
    content, expected = WHOLE[name]
    assert message(write_record(tmp_path, leakage=content)) == expected


def test_a_flow_in_a_pressure_column(tmp_path):
    toml = TOML.replace("[tests.leakage]", "[tests.pressure_gain]")
    folder = write_record(tmp_path, toml, leakage="spool_position [um],load_pressure [l/min]\n0,1\n")
    expected = '"l/min" is a flow; expected a pressure such as bar'
    assert message(folder) == f'leakage.csv, line 1, column "load_pressure [l/min]": {expected}'


def test_one_gauge_without_the_other(tmp_path):
    toml = TOML.replace("[tests.leakage]", "[tests.pressure_gain]")
    folder = write_record(tmp_path, toml, leakage="spool_position [um],pressure_b [bar]\n0,1\n")
    expected = 'the pressure_gain test needs a column pressure_a [bar] beside pressure_b, but the file has "spool_position [um]", "pressure_b [bar]"'
    assert message(folder) == f"leakage.csv, line 1: {expected}"


def test_a_load_flow_test_without_its_load_pressure(tmp_path):
    toml = TOML.replace("[tests.leakage]", "[tests.load_flow]")
    folder = write_record(tmp_path, toml, leakage="spool_position [um],flow [l/min]\n0,1\n")
    expected = 'the load_flow test needs a column load_pressure [bar], the imposed load pressure, but the file has "spool_position [um]", "flow [l/min]"'
    assert message(folder) == f"leakage.csv, line 1: {expected}"


def test_a_current_beyond_twice_the_rated_one(tmp_path):
    folder = write_record(tmp_path, leakage="current [A],leakage_flow [l/min]\n0,1\n25,1\n")
    expected = "25 is beyond twice the rated current (25 mA); is the unit right?"
    assert message(folder) == f'leakage.csv, line 3, column "current [A]": {expected}'


def test_a_current_without_a_rated_one(tmp_path):
    toml = TOML.replace('rated_current = "25 mA"\n', "")
    folder = write_record(tmp_path, toml, leakage="current [mA],leakage_flow [l/min]\n0,1\n")
    expected = 'rated_current is missing, but leakage.csv has a current; write rated_current = "25 mA"'
    assert message(folder) == f"bench.toml, line 1, [valve]: {expected}"
