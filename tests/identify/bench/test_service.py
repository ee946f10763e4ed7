"""[valve] serial, type, operating_hours; [test] date, port, order, iso_4406; dates of tests."""

import pytest
from helpers.bench_folder import TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.provenance import record_json
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.service import Service


def record_with(folder, valve: str = "", test: str = "", leakage: str = ""):
    toml = TOML.replace("[valve]\n", f"[valve]\n{valve}\n") + leakage + (f"\n[test]\n{test}\n" if test else "")
    return read_record(write_record(folder, toml))


def test_what_a_shop_notes(tmp_path):
    said = 'date = 2026-03-01\nport = "P1"\norder = 4711\niso_4406 = "18/16/13"'
    record = record_with(tmp_path, 'serial = 42\ntype = "76-101"\noperating_hours = 1200', said)
    assert record.service == Service("42", "76-101", 1200.0, "2026-03-01", "P1", "4711", "18/16/13")
    assert record_json(record)["record"]["service"]["operating_hours"] == 1200.0


def test_without_it_nothing_is_added(tmp_path):
    record = record_with(tmp_path)
    assert record.service == Service()
    assert "service" not in record_json(record)["record"]


@pytest.mark.parametrize(
    ("test", "leakage", "date"),
    [
        ('date = "2026-03-01T14:30:00+02:00"', "", "2026-03-01T14:30:00+02:00"),
        ("date = 2026-03-01T14:30:00", "date = 2027-01-01\n", "2026-03-01T14:30:00"),
        ("", 'date = "2026-05-01"\n', "2026-05-01"),
    ],
)
def test_dates(tmp_path, test, leakage, date):
    assert record_with(tmp_path, test=test, leakage=leakage).service.date == date


@pytest.mark.parametrize(
    ("valve", "test", "words"),
    [
        ("operating_hours = -1", "", '[valve] operating_hours: "-1" must be a number of hours from 0 to 1,000,000'),
        ('operating_hours = "1200 h"', "", "without quotes and unit"),
        ("serial = true", "", '[valve] serial: "True" is not a text'),
        (f'type = "{"x" * 61}"', "", "is too long; at most 60 characters"),
        ("", 'date = "1.3.2026"', '[test] date: "1.3.2026" is not a date; write date = 2026-03-01'),
        ("", "date = 12:30:00", "is not a date"),
        ("", 'iso_4406 = "clean"', '[test] iso_4406: "clean" is no code of ISO 4406, such as "18/16/13"'),
        ("", 'serial = "4"', 'unknown key "serial"; known: date, port'),
        ("", 'leakage = { file = "x.csv" }', "a test is described in [tests.leakage]; [test] says when"),
    ],
)
def test_refusals(tmp_path, valve, test, words):
    with pytest.raises(BenchInputError) as raised:
        record_with(tmp_path, valve, test)
    assert words in str(raised.value)
