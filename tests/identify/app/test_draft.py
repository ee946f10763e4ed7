"""Clicks as changes of a bench.toml: its own lines stay, and the reader takes what was clicked together."""

import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record

from thermohyd.identify.app.draft import (
    LEFT_OUT,
    Headers,
    described_tests,
    first_draft,
    held_by,
    likely_test,
    value_at,
    with_likely_tests,
    with_test,
    with_value,
)
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.test_file import read_source


OWN = "# 17 May\n" + TOML
LOG = "Zeit [s],LVDT,QL [l/min],note\n0,-10,0.1,x\n1,0,0.3,x\n2,10,0.1,x\n"


def headers(folder) -> Headers:
    test = described_tests(folder)["leakage"]
    return Headers(test, read_source(test))


def test_a_change_leaves_the_other_lines_as_they_are():
    text = with_value(OWN, ("conditions", "temperature"), "30 degC")
    assert text == OWN.replace("40 degC", "30 degC")
    assert with_value(text, ("conditions", "temperature"), "40 degC") == OWN


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("valve", "land_diameter"), "6.9 mm"),
        (("conditions", "return_pressure"), "1 bar"),
        (("tests", "leakage", "skip_rows"), 3),
        (("tests", "leakage", "columns"), {"flow": 'a "b" \\ [l/min]'}),
        (("tests", "flow_gain", "file"), "flow gain.csv"),
        (("start", "clearance"), "2 um"),
        (("oil", "viscosity"), [["40 degC", "32 cSt"], ["100 degC", "5.4 cSt"]]),
    ],
)
def test_what_is_set_is_there_and_goes_again(place, value):
    text = with_value(OWN, place, value)
    assert value_at(text, place) == value
    assert value_at(with_value(text, place, None), place) is None
    assert text.startswith("# 17 May\n[valve]\n")


def test_one_of_the_viscosity_points():
    text = with_value("", ("oil", "viscosity"), [["40 degC", "32 cSt"], ["100 degC", "5.4 cSt"]])
    text = with_value(text, ("oil", "viscosity", 1, 1), "6 cSt")
    assert value_at(text, ("oil", "viscosity")) == [["40 degC", "32 cSt"], ["100 degC", "6 cSt"]]


@pytest.mark.parametrize("text", ["[valve", "valve = 3\n"])
def test_a_text_that_cannot_hold_it_stays_as_it_is(text):
    assert with_value(text, ("valve", "stroke"), "1 mm") == text
    assert value_at(text, ("valve", "stroke")) is None


@pytest.mark.parametrize(
    ("name", "rows", "test"),
    [
        ("Leakage 7.csv", "a\n1\n", "leakage"),
        ("pressure-gain.csv", "a\n1\n", "pressure_gain"),
        ("step_slow.csv", "a\n1\n", "step"),
        ("17.csv", "spool_position [um],leakage_flow [l/min]\n0,1\n", "leakage"),
        ("17.csv", "spool_position [um],flow [l/min]\n0,1\n", "flow_gain"),
        ("17.csv", "spool_position [um],load_pressure [bar],flow [l/min]\n0,1,2\n", "load_flow"),
        ("17.csv", "LVDT [um],QL [l/min]\n0,1\n", "leakage"),
        ("17.csv", "a,b\n0,1\n", None),
        ("17.csv", "", None),
    ],
)
def test_which_test_a_file_seems_to_hold(name, rows, test, tmp_path):
    (tmp_path / name).write_text(rows)
    assert likely_test(tmp_path / name) == test


def test_a_first_draft(tmp_path):
    for name, content in {"leak.csv": LOG, "leakage 2.csv": LOG, "notes.md": "x"}.items():
        (tmp_path / name).write_text(content)
    text = with_likely_tests(first_draft("bench 3"), tmp_path, ["leak.csv", "leakage 2.csv", "notes.md"])
    assert value_at(text, ("valve", "name")) == "bench 3"
    assert value_at(text, ("tests",)) == {"leakage": {"file": "leak.csv"}}


def test_a_file_becomes_another_test():
    text = with_test(with_value(OWN, ("tests", "leakage", "skip_rows"), 2), "leakage.csv", "flow_gain")
    assert value_at(text, ("tests",)) == {"flow_gain": {"file": "leakage.csv", "skip_rows": 2}}
    assert held_by(text, "leakage.csv") == ["flow_gain"]
    assert value_at(with_test(text, "leakage.csv", None), ("tests",)) is None


def test_headers_are_mapped_until_the_record_reads(tmp_path):
    folder = write_record(tmp_path, OWN, leakage=LOG)
    own = headers(folder)
    assert own.unknown == ["Zeit [s]", "LVDT", "QL [l/min]", "note"]
    assert own.guesses() == {0: "time", 1: "spool_position", 2: "leakage_flow"}
    assert own.needs_unit(1, "spool_position")
    assert not own.needs_unit(2, "leakage_flow")
    assert own.units("spool_position")[:2] == ("um", "mm")
    assert own.units("spool_position")[-1] == "%"
    text = OWN
    for place, standard, unit in (
        (0, "time", ""),
        (1, "spool_position", "um"),
        (2, "leakage_flow", ""),
        (3, LEFT_OUT, ""),
    ):
        text = headers(folder).with_meaning(text, place, standard, unit)
        (folder / "bench.toml").write_text(text)
    own = headers(folder)
    assert own.taken_for == ["time", "spool_position", "leakage_flow", LEFT_OUT]
    assert (own.unknown, own.stated_unit(1), own.stated_unit(2)) == ([], "um", "")
    assert value_at(text, ("tests", "leakage", "columns")) == {
        "time": "Zeit [s]", "spool_position": "LVDT [um]", "leakage_flow": "QL [l/min]"
    }  # fmt: skip
    assert value_at(text, ("tests", "leakage", "ignore")) == ["note"]
    assert read_record(folder).tests["leakage"].spool_position == pytest.approx([-1e-5, 0.0, 1e-5])
    # another unit, and back to what the headers say of themselves
    text = own.with_meaning(text, 1, "spool_position", "mm")
    assert value_at(text, ("tests", "leakage", "columns", "spool_position")) == "LVDT [mm]"
    for place in range(4):
        text = headers(folder).with_meaning(text, place, "")
        (folder / "bench.toml").write_text(text)
    assert text == OWN


def test_a_column_is_given_to_another_header(tmp_path):
    rows = LEAKAGE.replace("leakage_flow [l/min]", "leakage_flow [l/min],QL [l/min]").replace(",0.1", ",0.1,0.2")
    folder = write_record(tmp_path, OWN, leakage=rows.replace(",0.3", ",0.3,0.4"))
    text = headers(folder).with_meaning(OWN, 4, "leakage_flow")
    (folder / "bench.toml").write_text(text)
    assert headers(folder).taken_for == ["time", "run", "spool_position", LEFT_OUT, "leakage_flow"]
    assert read_record(folder).tests["leakage"].channels[0].value[0] == pytest.approx(0.2 / 6e4)
    text = headers(folder).with_meaning(text, 3, "leakage_flow")
    (folder / "bench.toml").write_text(text)
    assert headers(folder).taken_for == ["time", "run", "spool_position", "leakage_flow", ""]


@pytest.mark.parametrize("header", ["LVDT (left)", 'the "old" LVDT', "Weg = x", "a.b"])
def test_headers_with_signs(header, tmp_path):
    quoted = '"' + header.replace('"', '""') + '"'
    folder = write_record(tmp_path, OWN, leakage=f"{quoted},leakage_flow [l/min]\n-10,0.1\n10,0.2\n")
    (folder / "bench.toml").write_text(headers(folder).with_meaning(OWN, 0, "spool_position", "um"))
    assert headers(folder).stated_unit(0) == "um"
    assert read_record(folder).tests["leakage"].spool_position[0] == pytest.approx(-1e-5)
