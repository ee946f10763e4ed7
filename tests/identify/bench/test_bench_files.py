"""Files as benches really write them: headers, rows of units, preambles, date-times, missing readings, sheets; and their messages."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import re
import sys
import zipfile
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import openpyxl
import pandas as pd
import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


HEADERS = "time [s],run,spool_position [um],leakage_flow [l/min]"
SOUND = LEAKAGE.split("\n", 1)[1].replace("# another\n", "").replace("\n\n", "\n")  # headers in line 1, rows below
L_MIN = 1e-3 / 60.0
POSITION = [-10e-6, 0.0, 10e-6, 10e-6, 0.0]


def leakage(folder):
    return read_record(folder).tests["leakage"]


def message(folder) -> str:
    with pytest.raises(BenchInputError) as caught:
        read_record(folder)
    return str(caught.value).removeprefix(f"{folder}/")


def same_rows(test) -> None:
    assert test.spool_position == pytest.approx(POSITION)
    assert test.channels[0].value == pytest.approx(np.multiply([0.1, 0.3, 0.1, 0.1, 0.3], L_MIN))
    assert test.time == pytest.approx([0.0, 1.0, 2.0, 0.0, 1.0])
    assert test.run_names == ("up", "down")


# ---- headers and units

UNITS_BELOW = SOUND.replace(HEADERS, "time,run,spool_position,leakage_flow\ns,-,um,l/min")
HEADER_VARIANTS = {
    "parentheses": SOUND.replace("[", "(").replace("]", ")"),
    "letter case": SOUND.replace(HEADERS, "Time [S],RUN,Spool_Position [um],LEAKAGE_FLOW [L/MIN]"),
    "blanks": SOUND.replace(HEADERS, "time[s] , Run,Spool Position (UM),leakage-flow [LPM]"),
    "a row of units": UNITS_BELOW,
    "a row of units in brackets": UNITS_BELOW.replace("s,-,um,l/min", "[s],,[um],(L/min)"),
    "some units below": SOUND.replace(HEADERS, "time [s],run,spool_position,leakage_flow [l/min]\n,,um,"),
    "a separator behind every line": SOUND.replace("\n", ",\n"),
    "a separator behind every row": SOUND.replace("\n", ",\n").replace("[l/min],", "[l/min]"),
    "a separator behind the headers": SOUND.replace("[l/min]", "[l/min],"),
}


@pytest.mark.parametrize("variant", HEADER_VARIANTS)
def test_headers_and_units_as_people_write_them(tmp_path, variant):
    same_rows(leakage(write_record(tmp_path, leakage=HEADER_VARIANTS[variant])))


def test_the_users_own_headers_with_their_units_below(tmp_path):
    toml = TOML + 'columns = { spool_position = "lvdt (left)", leakage_flow = "QL [l/min]" }\n'
    text = UNITS_BELOW.replace("spool_position", "LVDT (left)").replace("leakage_flow", "QL")
    same_rows(leakage(write_record(tmp_path, toml, leakage=text)))
    text = text.replace("s,-,um,l/min", "s,-,um,ml/min")
    expected = '"ml/min" stands below the header, but bench.toml says "l/min"'
    assert message(write_record(tmp_path, toml, leakage=text)) == f'leakage.csv, line 2, column "QL": {expected}'


HEADER_MESSAGES = {
    "no units at all": (
        SOUND.replace(" [s]", "").replace(" [um]", "").replace(" [l/min]", ""),
        'leakage.csv, line 1, column "time": the unit is missing; write for example time [s], or columns = { time = "time [s]", spool_position = "spool_position [um]", leakage_flow = "leakage_flow [l/min]" } in [tests.leakage]; 2 more have none',
    ),
    "a wrong unit below": (
        UNITS_BELOW.replace("l/min", "bar"),
        'leakage.csv, line 2, column "leakage_flow": "bar" is a pressure; expected a flow such as l/min',
    ),
    "units below and no rows": (
        UNITS_BELOW[: UNITS_BELOW.index("l/min") + 5],
        "leakage.csv, line 1: has headers but no rows",
    ),
    "own headers": (
        SOUND.replace(HEADERS, "Zeit [s],run,Hub [um],Leckage [l/min]"),
        'leakage.csv, line 1: unknown columns "Zeit [s]", "Hub [um]", "Leckage [l/min]"; if this is what they are, write columns = { time = "Zeit [s]", spool_position = "Hub [um]", leakage_flow = "Leckage [l/min]" } in [tests.leakage] (extra columns: start the name with _ or list it in ignore)',
    ),
    "one own header": (
        SOUND.replace("time [s]", "Zeit [s]"),
        'leakage.csv, line 1, column "Zeit [s]": unknown column "Zeit"; if it is time, write columns = { time = "Zeit [s]" } in [tests.leakage] (extra columns: start the name with _ or list it in ignore)',
    ),
    "columns that nothing resembles": (
        SOUND.replace("time [s],run", "qqq [kg],zzz"),
        'leakage.csv, line 1: unknown columns "qqq [kg]", "zzz"; known: run, time, spool_position, current, supply_pressure, return_pressure, temperature, leakage_flow, leakage_flow_std (extra columns: start the name with _ or list it in ignore)',
    ),
    "two spellings of one": (
        SOUND.replace("run", "Time [s]"),
        'leakage.csv, line 1, column "Time [s]": duplicate header: "time [s]" already gives time; remove one, or list it in ignore',
    ),
}


@pytest.mark.parametrize("name", HEADER_MESSAGES)
def test_headers_that_are_refused(tmp_path, name):
    text, expected = HEADER_MESSAGES[name]
    assert message(write_record(tmp_path, leakage=text)) == expected


def test_what_is_mapped_already_stays_in_the_line_to_copy(tmp_path):
    toml = TOML + 'columns = { time = "Zeit [s]" }\n'
    text = SOUND.replace("time [s]", "Zeit [s]").replace("spool_position [um]", 'My "LVDT" um')
    expected = r'unknown column "My "LVDT" um"; if it is spool_position, write columns = { time = "Zeit [s]", spool_position = "My \"LVDT\" um [um]" } in [tests.leakage]'
    assert expected in message(write_record(tmp_path, toml, leakage=text))


# A logger's file: its own headers, units in the row below, a remark with a word of the run's beside it.
LOG = """Zeit;Druck Versorgung;Weg;Leckage;Temp;Sweep remark;Zyklus
s;psi;um;l/min;degF;;
0;1015;-10;0.1;104;;1
1;1015;0;0.2;104;Luft im Lauf;1
2;1015;10;0.1;104;;1
"""
BARE = TOML.replace('supply_pressure = "70 bar"\n', "").replace('temperature = "40 degC"\n', "")


def test_every_column_of_a_log_is_proposed_at_once_and_the_line_is_right(tmp_path):
    said = message(write_record(tmp_path, BARE, leakage=LOG))
    columns = 'columns = { time = "Zeit", supply_pressure = "Druck Versorgung", spool_position = "Weg", leakage_flow = "Leckage", temperature = "Temp" }'
    ignore = 'ignore = ["Sweep remark", "Zyklus"]'
    assert f"write {columns} and {ignore} in [tests.leakage]" in said
    test = leakage(write_record(tmp_path, f"{BARE}{columns}\n{ignore}\n", leakage=LOG))
    assert test.supply_pressure == pytest.approx([1015 * 6894.757] * 3)
    assert test.temperature == pytest.approx([313.15] * 3)


@pytest.mark.parametrize(
    ("header", "unit", "cells", "column"),
    [
        ("Druck", "degF", "1", "temperature"),
        ("Pressure system", "degF", "1", "temperature"),
        ("Fluss", "bar", "1", "supply_pressure"),
        ("QL", "bar", "1", "supply_pressure"),
        ("Supply", "bara", "1", None),
        ("Supply psi", "", "1", "supply_pressure"),
        ("Supply degF", "", "1", "temperature"),
        ("Uhrzeit", "hh:mm:ss", "12:00:00", "time"),
        ("Remark", "", "1", None),
        ("Remark", "", "burnt", None),
        ("Bemerkung zum Lauf", "", "1", None),
        ("Oil", "", "cold", None),
        ("Lauf", "", "up", "run"),
        ("Lauf", "", "", None),
        ("runner", "", "up", None),
    ],
)
def test_what_a_column_is_proposed_for(tmp_path, header, unit, cells, column):
    rows = "\n".join(f"{position},0.1,{cells}" for position in (-10, 0, 10))
    text = f"spool_position,leakage_flow,{header}\num,l/min,{unit}\n{rows}\n"
    said = message(write_record(tmp_path, BARE, leakage=text))
    proposed = re.search(r"columns = \{ (\w+) = ", said)
    assert (proposed and proposed[1]) == column, said


def test_all_that_is_missing_is_said_at_once(tmp_path):
    text = "_Weg [um],_QL [l/min],_T [degC],_x\n0,1,40,1\n1,1,40,1\n"
    assert message(write_record(tmp_path, BARE, leakage=text)) == (
        "leakage.csv, line 1: the leakage test needs columns spool_position [um] or current [mA]; leakage_flow [l/min]; supply_pressure [bar]; "
        'temperature [degC] (or supply_pressure = "70 bar" and temperature = "40 degC" in [conditions]), but the file has "_Weg [um]", '
        '"_QL [l/min]", "_T [degC]", "_x"; if those are "_Weg [um]" and "_QL [l/min]" and "_T [degC]", write columns = { spool_position = '
        '"_Weg [um]", leakage_flow = "_QL [l/min]", temperature = "_T [degC]" } in [tests.leakage]'
    )
    unknown = message(write_record(tmp_path, BARE, leakage=text.replace("_", "")))
    assert "; then still missing: supply_pressure [bar] (extra" in unknown or unknown.endswith("supply_pressure [bar]")


def test_a_run_of_one_row_is_refused(tmp_path):
    text = "spool_position [um],leakage_flow [l/min],run\n0,1,a\n1,1,a\n2,1,b\n3,1,c\n"
    end = "a run is a whole sweep, and each of its rows bears its name: correct it, or list the column in ignore"
    said = message(write_record(tmp_path, leakage=text))
    assert said == f'leakage.csv, line 4, column "run": run "b" has one row (2 runs are such); {end}'
    whole = text.replace(",c", ",b")
    assert leakage(write_record(tmp_path, leakage=whole)).rows == 4
    # What is left of a whole one beside gaps is no mistake of the column.
    gap = 'missing = "skip"\n'
    assert leakage(write_record(tmp_path, TOML + gap, leakage=whole.replace("3,1", "3,"))).rows == 3


def test_a_condition_that_stands_under_another_name(tmp_path):
    toml = TOML.replace('temperature = "40 degC"\n', "") + 'ignore = ["Oil temp [C]"]\n'
    text = "spool_position [um],leakage_flow [l/min],Oil temp [C]\n0,1,40\n1,1,40\n"
    assert message(write_record(tmp_path, toml, leakage=text)) == (
        'bench.toml, line 11, [conditions]: temperature is missing: leakage.csv has no such column; write temperature = "40 degC" in [conditions]'
        '; or, if it is "Oil temp [C]", columns = { temperature = "Oil temp [C]" } in [tests.leakage]'
    )
    mapped = toml + 'columns = { temperature = "Oil temp [C]" }\n'
    assert leakage(write_record(tmp_path, mapped, leakage=text)).temperature == pytest.approx([313.15] * 2)


# ---- lines above the headers

PREAMBLE = 'Operator:;Smith\nDate:,2026-03-01\n\nStand 5, "left"\n'


def test_lines_above_the_headers(tmp_path):
    text = PREAMBLE + SOUND
    same_rows(leakage(write_record(tmp_path, TOML + "skip_rows = 4\n", leakage=text)))
    assert message(write_record(tmp_path, leakage=text)) == (
        "leakage.csv, line 1: these are not the headers, which seem to stand in line 5: write skip_rows = 4 in [tests.leakage]"
    )
    numbers = leakage(write_record(tmp_path, TOML + "skip_rows = 4\n", leakage=text)).lines
    assert numbers is not None
    assert numbers.tolist() == [6, 7, 8, 9, 10]


def test_lines_above_the_headers_and_units_below(tmp_path):
    text = "1;2;3\nfile 7\n" + UNITS_BELOW
    assert message(write_record(tmp_path, leakage=text)).endswith("write skip_rows = 2 in [tests.leakage]")
    same_rows(leakage(write_record(tmp_path, TOML + "skip_rows = 2\n", leakage=text)))


def test_more_lines_left_out_than_there_are(tmp_path):
    folder = write_record(tmp_path, TOML + "skip_rows = 40\n", leakage=SOUND)
    assert message(folder) == "leakage.csv: has 7 lines, but skip_rows leaves out 40"


# ---- missing readings and other bad cells

GAPS = (
    SOUND.replace("1,up,0,0.3", "1,up,0,NaN")
    .replace("0,down,10,0.1", "0,down,,0.1")
    .replace("1,down,0,0.3", "1,down,0,n/a")
)


def test_all_bad_cells_of_a_file_in_one_message(tmp_path):
    assert message(write_record(tmp_path, leakage=GAPS)) == (
        'leakage.csv: 3 bad cells: line 3, column "leakage_flow [l/min]": "NaN" is not a number; line 5, column "spool_position [um]": the cell is empty; '
        'line 6, column "leakage_flow [l/min]": "n/a" is not a number. Leave such rows out, or write missing = "skip" in [tests.leakage]'
    )


def test_all_bad_cells_of_all_files_in_one_message(tmp_path):
    toml = TOML + '[tests.flow_gain]\nfile = "flow.csv"\n'
    flow = (
        "spool_position [um],flow [l/min]\n" + "".join(f"{i},{'over' if i % 2 else i}\n" for i in range(20)) + "1,2,3\n"
    )
    assert message(write_record(tmp_path, toml, leakage=GAPS, flow=flow)) == (
        f'{tmp_path}: 14 bad cells in 2 files: leakage.csv, line 3, column "leakage_flow [l/min]": "NaN" is not a number; line 5, column "spool_position [um]": '
        'the cell is empty; line 6, column "leakage_flow [l/min]": "n/a" is not a number; flow.csv, line 3, column "flow [l/min]": "over" is not a number; '
        'line 5, column "flow [l/min]": "over" is not a number; and 9 more. Leave such rows out, or write missing = "skip" in [tests.leakage]; '
        "expected a number such as 1.5"
    )


def test_rows_without_a_reading_are_skipped_on_request(tmp_path):
    test = leakage(write_record(tmp_path, TOML + 'missing = "skip"\n', leakage=GAPS))
    assert test.spool_position == pytest.approx([-10e-6, 10e-6])
    assert test.lines is not None
    assert test.lines.tolist() == [2, 4]
    assert test.run_names == ("up",)
    assert test.table is not None
    assert len(test.table) == 2
    assert test.notes == (
        'leakage.csv: 3 rows with a missing reading left out, as missing = "skip" asks: lines 3, 5-6',
    )


def test_skipping_forgives_no_text_and_needs_a_row(tmp_path):
    toml = TOML + 'missing = "skip"\n'
    text = GAPS.replace("2,up,10,0.1", "2,up,10,overload")
    assert message(write_record(tmp_path, toml, leakage=text)) == (
        'leakage.csv, line 4, column "leakage_flow [l/min]": "overload" is not a number; expected a number such as 1.5'
    )
    text = "spool_position [um],leakage_flow [l/min]\n0,nan\n,1\n"
    assert message(write_record(tmp_path, toml, leakage=text)) == (
        'leakage.csv, line 1: no row is left: missing = "skip" leaves out every one of them'
    )


def test_a_gap_in_a_column_that_is_not_used_matters_to_nobody(tmp_path):
    text = "spool_position [um],leakage_flow [l/min],_note,flow [l/min]\n0,1,,nan\n1,1,,\n"
    assert leakage(write_record(tmp_path, leakage=text)).rows == 2


CELLS = {
    "thousands": ('"1,234.5"', '"1,234.5" is not a number; write numbers without separators between the thousands'),
    "unit": ("0.3 l/min", '"0.3 l/min" is not a number; the unit stands in the header only'),
    "percent": ("30 %", '"30 %" is not a number; the unit stands in the header only'),
    "too large": ("1e999", "inf is not a finite number; leave the row out"),
    "a date": ("2026-03-01", '"2026-03-01" is not a number; expected a number such as 1.5'),
    "no flow": ("70000", "70000.0 is above 60,000 l/min; is the unit right?"),
}


@pytest.mark.parametrize("name", CELLS)
def test_single_cells(tmp_path, name):
    cell, expected = CELLS[name]
    folder = write_record(tmp_path, leakage=SOUND.replace("1,up,0,0.3", f"1,up,0,{cell}"))
    assert message(folder) == f'leakage.csv, line 3, column "leakage_flow [l/min]": {expected}'


def test_headers_in_the_middle(tmp_path):
    folder = write_record(tmp_path, leakage=SOUND.replace("0,down", f"{HEADERS}\n0,down"))
    assert message(folder) == (
        "leakage.csv, line 5: the headers stand here again; are these two logs in one file? Remove the line, and give each log its own run"
    )


# ---- dates and times of day

CLOCKS = {
    "ISO": "2026-03-01 23:59:59.5|2026-03-02 00:00:00.5|2026-03-02 00:00:01,5",
    "ISO with T and zone": "2026-03-01T23:59:59.5Z|2026-03-02T01:00:00.5+01:00|2026-03-02T00:00:01.5+0000",
    "German": "01.03.2026 23:59:59,5|02.03.2026 00:00:00,5|02.03.2026 0:00:01,5",
    "day first": "31/12/2026 23:59:59|01/01/2027 00:00:00|01/01/2027 00:00:01",
    "month first": "12/31/2026 11:59:59 PM|1/1/2027 12:00:00 AM|1/1/2027 12:00:01 am",
    "either, on one day": "03/04/2026 10:00:00|03/04/2026 10:00:01|03/04/2026 10:00:02",
    "time of day over midnight": "23:59:59.25|00:00:00.25|00:00:01.25",
    "hours since the start": "0:00:00|0:00:01|0:00:02",
    "slashes, year first": "2026/03/01 00:00:00|2026/03/01 00:00:01|2026/03/01 00:00:02",
}


@pytest.mark.parametrize("header", ["time", "time [s]", "Time (hh:mm:ss)"])
@pytest.mark.parametrize("name", CLOCKS)
def test_date_times_become_seconds_since_the_first_row(tmp_path, name, header):
    rows = "".join(f"{cell};{i};1\n" for i, cell in enumerate(CLOCKS[name].split("|")))
    folder = write_record(tmp_path, leakage=f"{header};spool_position [um];leakage_flow [l/min]\n{rows}")
    assert leakage(folder).time == pytest.approx([0.0, 1.0, 2.0], abs=1e-9)


def test_date_times_with_units_below(tmp_path):
    text = "time;spool_position;leakage_flow\nhh:mm:ss;um;l/min\n10:00:00;0;1\n10:00:05;1;1\n"
    assert leakage(write_record(tmp_path, leakage=text)).time == pytest.approx([0.0, 5.0])


CLOCK_MESSAGES = {
    "day or month": (
        "03/04/2026 10:00:00|04/04/2026 10:00:00",
        'line 2, column "time": the day and the month of these dates cannot be told apart; write them as 2026-03-01 or 01.03.2026',
    ),
    "no time": (
        "2026-03-01 10:00:00|later",
        'line 3, column "time": "later" is no date and time; expected one such as 2026-03-01 12:00:00.5, as in the first row',
    ),
    "no such day": (
        "2026-02-28 10:00:00|2026-02-30 10:00:00",
        'line 3, column "time": "2026-02-30 10:00:00" is no date and time; expected one such as 2026-03-01 12:00:00.5, as in the first row',
    ),
    "backwards": (
        "10:00:01|10:00:00",
        'line 3, column "time": time runs backwards within one run; keep the order of the sweep, and give each sweep its own run',
    ),
    "hours and minutes, or minutes and seconds": (
        "10:00|10:01",
        'line 1, column "time": the unit is missing; write for example time [s], or columns = { time = "time [s]" } in [tests.leakage]',
    ),
}


@pytest.mark.parametrize("name", CLOCK_MESSAGES)
def test_date_times_that_are_refused(tmp_path, name):
    cells, expected = CLOCK_MESSAGES[name]
    rows = "".join(f"{cell},{i},1\n" for i, cell in enumerate(cells.split("|")))
    folder = write_record(tmp_path, leakage=f"time,spool_position [um],leakage_flow [l/min]\n{rows}")
    assert message(folder) == f"leakage.csv, {expected}"


def test_a_row_without_a_time_is_a_missing_reading(tmp_path):
    text = "time,spool_position [um],leakage_flow [l/min]\n,0,1\n10:00:00,0,1\nnan,1,1\n10:00:02,2,1\n"
    test = leakage(write_record(tmp_path, TOML + 'missing = "skip"\n', leakage=text))
    assert test.time == pytest.approx([0.0, 2.0])


# ---- sheets

SHEET = TOML.replace("leakage.csv", "leakage.xlsx")
PARQUET = TOML.replace("leakage.csv", "leakage.parquet")
ROWS: list[list[Any]] = [
    [float(c) if i != 1 else c for i, c in enumerate(line.split(","))] for line in SOUND.strip().split("\n")[1:]
]


def write_sheet(folder, rows, toml=SHEET, **others):
    write_record(folder, toml)
    book = openpyxl.Workbook()
    page = book.active
    assert page is not None
    page.title = "log"
    for row in rows:
        page.append(row)
    for title, table in others.items():
        extra = book.create_sheet(title)
        for row in table:
            extra.append(row)
    book.save(folder / "leakage.xlsx")
    return folder


def test_a_sheet_reads_as_its_csv_does(tmp_path):
    test = leakage(write_sheet(tmp_path, [HEADERS.split(","), *ROWS]))
    same_rows(test)
    assert test.lines is not None
    assert test.lines.tolist() == [2, 3, 4, 5, 6]


def test_a_sheet_with_all_that_sheets_have(tmp_path):
    start = datetime(2026, 3, 1, 10)
    rows = [[start + timedelta(seconds=row[0]), *row[1:], None] for row in ROWS]
    table = [
        ["Stand 5"],
        [],
        ["Time", "Run", "Spool Position", "Leakage_Flow"],
        [None, None, "um", "L/min"],
        *rows,
        [],
        ["# end"],
    ]
    toml = SHEET + 'skip_rows = 2\nsheet = "data"\n'
    test = leakage(write_sheet(tmp_path, [["nothing"]], toml, data=table))
    same_rows(test)
    assert test.lines is not None
    assert test.lines.tolist() == [5, 6, 7, 8, 9]
    unskipped = write_sheet(tmp_path, [["nothing"]], SHEET + 'sheet = "data"\n', data=table)
    assert message(unskipped) == (
        "leakage.xlsx, row 1: these are not the headers, which seem to stand in row 3: write skip_rows = 2 in [tests.leakage]"
    )


def test_gaps_in_a_sheet(tmp_path):
    rows = [list(row) for row in ROWS]
    rows[1][3], rows[3][2], rows[4][3] = None, "#N/A", "over"
    folder = write_sheet(tmp_path, [HEADERS.split(","), *rows])
    assert message(folder) == (
        'leakage.xlsx: 3 bad cells: row 3, column "leakage_flow [l/min]": the cell is empty; row 5, column "spool_position [um]": "#N/A" is not a number; '
        'row 6, column "leakage_flow [l/min]": "over" is not a number. Leave such rows out, or write missing = "skip" in [tests.leakage]; expected a number such as 1.5'
    )
    rows[4][3] = 0.3
    test = leakage(write_sheet(tmp_path, [HEADERS.split(","), *rows], SHEET + 'missing = "skip"\n'))
    assert test.notes == ('leakage.xlsx: 2 rows with a missing reading left out, as missing = "skip" asks: rows 3, 5',)


def test_sheets_that_are_refused(tmp_path):
    head = HEADERS.split(",")
    assert (
        message(write_sheet(tmp_path, [])) == "leakage.xlsx: is empty; expected a row of headers and at least one row"
    )
    assert message(write_sheet(tmp_path, [head])) == "leakage.xlsx, row 1: has headers but no rows"
    assert (
        message(write_sheet(tmp_path, [head, [*ROWS[0], 1.0]]))
        == "leakage.xlsx, row 2: the row has 5 cells, but there are 4 headers"
    )
    assert (
        message(write_sheet(tmp_path, [head, *ROWS], SHEET + 'sheet = "x"\n'))
        == 'leakage.xlsx: has no sheet "x"; it has "log"'
    )
    far = [head, [0.0, "a", 401.0, 0.1]]
    assert message(write_sheet(tmp_path, far)) == (
        'leakage.xlsx, row 2, column "spool_position [um]": 401 is beyond twice the stroke (200 um); is the unit right?'
    )
    damaged = "leakage.xlsx: is no .xlsx file, or a damaged one; save it again, or as CSV"
    whole = (tmp_path / "leakage.xlsx").read_bytes()
    for content in (b"", b"time [s]\n1\n", whole[:500], whole[:-40], whole[:300] + b"\xff" * 100 + whole[400:]):
        (tmp_path / "leakage.xlsx").write_bytes(content)
        assert message(tmp_path) == damaged
    (tmp_path / "leakage.xlsx").write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")
    assert message(tmp_path) == (
        "leakage.xlsx: has a password, or the format of Excel before 2007; save it as .xlsx without a password"
    )


def test_an_archive_that_unpacks_without_end_is_not_unpacked(tmp_path):
    folder = write_sheet(tmp_path, [HEADERS.split(","), *ROWS])
    with zipfile.ZipFile(folder / "leakage.xlsx", "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet9.xml", b" " * 201_000_000)
    assert message(folder) == "leakage.xlsx: unpacks to more than 200,000,000 bytes; save the log as CSV"


FAR = {
    "a row that Excel does not have": (b'<row r="3"', b'<row r="999999999"', "20,000,000 cells or 1,048,576 rows"),
    "far columns in many rows": (b"</sheetData>", b'<row><c r="ZZZ9"><v>1</v></c></row>' * 1200 + b"</sheetData>", "20,000,000 cells or 1,048,576 rows"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAR)
def test_a_small_sheet_that_claims_to_be_huge(tmp_path, name):
    old, new, expected = FAR[name]
    folder = write_sheet(tmp_path, [HEADERS.split(","), *ROWS])
    with zipfile.ZipFile(folder / "leakage.xlsx") as sound:
        parts = {part: sound.read(part) for part in sound.namelist()}
    assert old in parts["xl/worksheets/sheet1.xml"]
    parts["xl/worksheets/sheet1.xml"] = parts["xl/worksheets/sheet1.xml"].replace(old, new)
    with zipfile.ZipFile(folder / "leakage.xlsx", "w", zipfile.ZIP_DEFLATED) as spoiled:
        for part, content in parts.items():
            spoiled.writestr(part, content)
    assert message(folder) == f"leakage.xlsx: has more than {expected}; save the log as CSV"


def test_a_sheet_under_the_name_of_a_csv(tmp_path):
    folder = write_sheet(tmp_path, [HEADERS.split(","), *ROWS])
    (folder / "leakage.xlsx").rename(folder / "leakage.csv")
    write_record(tmp_path, leakage=(folder / "leakage.csv").read_bytes())
    assert message(folder) == "leakage.csv: is no CSV file but an .xlsx or zip file; give it its own ending"


def parquet_frame():
    return pd.DataFrame(ROWS, columns=HEADERS.split(","))


def test_a_parquet_file_reads_as_its_csv_does(tmp_path):
    folder = write_record(tmp_path, PARQUET)
    parquet_frame().to_parquet(folder / "leakage.parquet")
    same_rows(leakage(folder))
    frame = parquet_frame().rename(columns={"time [s]": "time"})
    frame["time"] = pd.Timestamp(2026, 3, 1) + pd.to_timedelta(frame["time"].to_numpy(), unit="s")
    frame.set_index("time").to_parquet(folder / "leakage.parquet")
    same_rows(leakage(folder))
    frame["time"] -= frame["time"].iloc[0]
    frame.to_parquet(folder / "leakage.parquet")
    same_rows(leakage(folder))


def test_parquet_files_that_are_refused(tmp_path):
    folder = write_record(tmp_path, PARQUET)
    frame = parquet_frame()
    frame.loc[2, "leakage_flow [l/min]"] = np.nan
    frame.to_parquet(folder / "leakage.parquet")
    expected = 'column "leakage_flow [l/min]": the cell is empty; leave the row out, or write missing = "skip" in [tests.leakage]'
    assert message(folder) == f"leakage.parquet, row 3, {expected}"
    frame.drop(columns="leakage_flow [l/min]").to_parquet(folder / "leakage.parquet")
    assert message(folder).startswith(
        "leakage.parquet: the leakage test needs a column leakage_flow [l/min], but the file has "
    )
    whole = (folder / "leakage.parquet").read_bytes()
    for content in (b"", b"PAR1", whole[:-20], whole[:100] + whole[120:]):
        (folder / "leakage.parquet").write_bytes(content)
        assert message(folder) == "leakage.parquet: is no .parquet file, or a damaged one; write it again"
    write_record(tmp_path, PARQUET + "skip_rows = 1\n")
    assert message(folder) == "leakage.parquet: a .parquet file has no lines above its headers; remove skip_rows"


def test_parquet_needs_a_package_and_says_so(tmp_path, monkeypatch):
    folder = write_record(tmp_path, PARQUET)
    (folder / "leakage.parquet").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert message(folder) == (
        "leakage.parquet: needs the package pyarrow: pip install -c constraints.txt '.[parquet]' in the source folder of thermohyd; or "
        "save the log as CSV"
    )


def test_old_excel_is_told_what_to_do(tmp_path):
    folder = write_record(tmp_path, TOML.replace("leakage.csv", "leakage.xls"))
    (folder / "leakage.xls").write_bytes(b"")
    assert message(folder) == "leakage.xls: has the format of Excel before 2007; save it as .xlsx or CSV"
