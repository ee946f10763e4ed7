"""Rows outside what a model was fitted to: named by quantity and line, in the table, in JSON and in words."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import command
from helpers.small_bench import conditions_only, record_of

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ValveData
from thermohyd.identify.model.fitted_range import COLUMN, STANDS_FOR, outside, ranges_of, sentences
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import load_model
from thermohyd.identify.model.predict import simulate


PARAMETERS = {
    "edge_radius": 8e-6,
    "clearance": 2.5e-6,
    "underlap": 6e-6,
    "discharge_coefficient": 0.68,
    "transition_number": 90.0,
    "null_bias": 1.2e-6,
}


def bench(**columns):
    """A leakage test at 0 to 60 degC, 70 and 210 bar, without readings; columns replace its own."""
    test = replace(conditions_only("leakage"), channels=(), lines=None)
    return record_of({"leakage": replace(test, **{n: f(getattr(test, n)) for n, f in columns.items()})})


FITTED = bench()
MODEL = Model(FITTED.valve, FITTED.oil, PARAMETERS, ("clearance",), np.array([[1e-16]]), fitted=ranges_of(FITTED.tests))


def test_what_was_fitted_is_inside():
    assert MODEL.fitted["leakage"]["temperature"] == pytest.approx((273.15, 333.15))
    assert MODEL.fitted["leakage"]["supply_pressure"] == (70e5, 210e5)
    assert outside(MODEL, FITTED) == []
    noisy = bench(temperature=lambda t: t + 0.5, supply_pressure=lambda p: 1.005 * p)
    assert outside(MODEL, noisy) == []
    found = simulate(FITTED, MODEL)
    assert COLUMN not in found.tables["leakage"]
    assert found.notes == ()


def test_rows_beyond_are_named_by_quantity():
    hot = bench(temperature=lambda t: t + 30.0, spool_position=lambda x: 1.3 * x)
    found = simulate(hot, MODEL)
    names = found.tables["leakage"][COLUMN].tolist()
    test = hot.tests["leakage"]
    warm = test.temperature > 334.15
    far = np.abs(test.spool_position) > 213e-6 * 1.01
    assert [("temperature" in name) for name in names] == warm.tolist()
    assert [("spool_position; stroke" in name) for name in names] == far.tolist()
    assert all(name == "" for name, w, f in zip(names, warm, far, strict=True) if not w and not f)
    table = found.to_dataframe()
    assert table[COLUMN].tolist() == names
    assert set(table["test"]) == {"leakage"}
    text = "\n".join(found.notes)
    assert (
        f"leakage: {warm.sum()} of 256 rows lie outside what the model was fitted to: temperature 90.00 degC, " in text
    )
    assert "fitted 0 to 60.00 degC (rows " in text
    assert (
        f"leakage: {far.sum()} of 256 rows lie beyond the stroke -276.9 to 276.9 um, stroke -213.0 to 213.0 um (rows 1, "
        in text
    )
    assert found.notes[-1] == STANDS_FOR


def test_lines_of_the_file_and_stretches():
    test = FITTED.tests["leakage"]
    beyond = replace(
        test,
        path=Path("new.csv"),
        lines=np.arange(256) + 2,
        temperature=np.where(np.arange(256) < 9, 390.0, test.temperature),
    )
    record = record_of({"leakage": beyond})
    (entry,) = [e for e in outside(MODEL, record) if e.quantity == "temperature"]
    assert entry.stretches == [(2, 10)]
    assert "(new.csv lines 2 to 10)" in sentences([entry], record, MODEL)[0]


def test_beyond_what_is_known_of_the_oil():
    oil = replace(MODEL.oil, coldest=283.15, hottest=313.15)
    record = replace(FITTED, oil=oil)
    found = simulate(record, replace(MODEL, oil=oil))
    cold = FITTED.tests["leakage"].temperature
    names = found.tables["leakage"][COLUMN]
    assert [name == "oil_temperature" for name in names] == ((cold < 282.15) | (cold > 314.15)).tolist()
    assert "at which nothing is stated of the oil 0 to 60.00 degC, known 10.00 to 40.00 degC" in found.notes[0]


def test_a_test_that_was_not_fitted_stands_on_the_others():
    test = replace(FITTED.tests["leakage"], name="flow_gain", temperature=FITTED.tests["leakage"].temperature + 50.0)
    record = record_of({"flow_gain": test})
    found = simulate(record, MODEL)
    assert "temperature" in set(found.tables["flow_gain"][COLUMN])
    assert "flow_gain: the model was not fitted to such a test; the ranges of leakage stand in" in found.notes


def test_a_model_of_an_earlier_version_says_nothing_of_it():
    found = simulate(bench(temperature=lambda t: t + 30.0), replace(MODEL, fitted={}))
    assert COLUMN not in found.tables["leakage"]
    assert found.notes == (
        'the model does not say what it was fitted to (no "fitted_range"): rows outside of that cannot be pointed out',
    )


def test_the_record_s_oil_and_geometry_are_used():
    thick = replace(FITTED.oil, viscosity_a=FITTED.oil.viscosity_a + 0.1, name="other oil")
    wide = ValveData("other", 250e-6, 14e-3, rated_current=25e-3)
    other = replace(FITTED, oil=thick, valve=wide)
    found = simulate(other, replace(MODEL, effects={"viscosity_shift": 0.1}))
    same = replace(MODEL, valve=wide, oil=thick, effects={"viscosity_shift": 0.1})
    name = "leakage_flow_predicted [l/min]"
    np.testing.assert_allclose(found.tables["leakage"][name], simulate(other, same).tables["leakage"][name], rtol=1e-12)
    plain = simulate(FITTED, replace(MODEL, effects={"viscosity_shift": 0.1})).tables["leakage"][name]
    assert np.max(np.abs(found.tables["leakage"][name] / plain - 1.0)) > 0.05
    assert found.notes[:4] == (
        "stroke: the record states 250 um and gets it; the model was fitted with 213 um",
        "slot_width: the record states 14 mm and gets it; the model was fitted with 12 mm",
        "oil: the record states other oil (32.5 cSt at 40 degC) and gets it; the model was fitted with user oil "
        "(15.5 cSt at 40 degC)",
        "oil: viscosity_shift of the model was found with that other oil and is kept",
    )


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ([], '"fitted_range" must be a table of tests'),
        ({"leak": {}}, '"fitted_range" has the unknown key "leak"; known are leakage,'),
        ({"leakage": 3}, '"fitted_range" "leakage" must be a table of quantities'),
        ({"leakage": {"colour": [0, 1]}}, '"fitted_range leakage" has the unknown key "colour"'),
        ({"leakage": {"temperature": [0]}}, '"temperature" must be a list of its least and greatest value'),
        ({"leakage": {"temperature": ["a", 1]}}, '"temperature" must be a finite number in SI units'),
        ({"leakage": {"temperature": [2, 1]}}, '"temperature" must have its least value first'),
    ],
)
def test_a_mistake_in_the_ranges(tmp_path, ranges, message):
    with pytest.raises(BenchInputError) as caught:
        load_model(written(tmp_path, fitted_range=ranges))
    assert message in str(caught.value)


def written(folder: Path, **more) -> Path:
    content = {
        "schema": "thermohyd-model/1",
        "valve": {"stroke": 213e-6, "slot_width": 12e-3},
        "oil": {"viscosity_a": 9.0, "viscosity_b": 3.5, "coldest": None},
        "parameters": PARAMETERS,
        **more,
    }
    path = folder / "model.json"
    path.write_text(json.dumps(content))
    return path


def test_without_ranges_a_model_still_loads(tmp_path):
    assert load_model(written(tmp_path)).fitted == {}
    ranges = {"leakage": {"temperature": [300.0, 310.0]}}
    assert load_model(written(tmp_path, fitted_range=ranges)).fitted == {"leakage": {"temperature": (300.0, 310.0)}}


def test_the_command_says_it_everywhere(tmp_path, monkeypatch):
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "bench.toml").write_text(
        '[valve]\nstroke = "213 um"\nslot_width = "12 mm"\n[oil]\npreset = "skydrol-ld-4"\n[conditions]\n'
        'supply_pressure = "70 bar"\n[tests.leakage]\nfile = "leakage.csv"\n'
    )
    rows = "".join(f"{x},{t}\n" for x, t in ((-10, 40), (0, 40), (10, 150), (300, 40)))
    (tmp_path / "bench" / "leakage.csv").write_text(f"spool_position [um],temperature [degC]\n{rows}")
    ranges = {"leakage": {"temperature": [303.15, 323.15], "spool_position": [-213e-6, 213e-6]}}
    model = written(tmp_path, fitted_range=ranges)
    ran = command(monkeypatch, "simulate", 400)(
        tmp_path / "bench", "--model", model, "--out", tmp_path / "out", "--json"
    )
    assert ran.exit_code == 0, ran.output
    assert "* oil: the record states skydrol-ld-4" in ran.stderr
    assert "temperature 150.0 degC, fitted 30.00 to 50.00 degC (leakage.csv lines 4)" in ran.stderr
    content = json.loads(ran.stdout)
    expected = ["", "", "temperature; oil_temperature", "spool_position; stroke"]
    assert content["leakage"][COLUMN] == expected
    assert [e["quantity"] for e in content["outside_fitted_range"]["leakage"]] == [
        "temperature", "spool_position", "stroke", "oil_temperature",
    ]  # fmt: skip
    assert content["outside_fitted_range"]["leakage"][0]["lines"] == [[4, 4]]
    assert STANDS_FOR in content["notes"]
    lines = (tmp_path / "out" / "leakage.csv").read_text().splitlines()
    assert lines[0].endswith(f",{COLUMN}")
    assert [line.rsplit(",", 1)[1] for line in lines[1:]] == expected
