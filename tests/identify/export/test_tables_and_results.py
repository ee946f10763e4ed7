"""Tables of a valve for other programs, with the error that they state, and results as CSV, Parquet and a spreadsheet."""

import json
import re
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from helpers.commands import command
from helpers.fake_fit import fake_fit
from scipy.io import loadmat

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ValveData
from thermohyd.identify.export.results import load_result, result_files, result_tables
from thermohyd.identify.export.table_writers import amesim, error_words, modelica, simscape
from thermohyd.identify.export.valve_tables import (
    Axis,
    ValveTable,
    ValveTables,
    chosen_nodes,
    interpolated,
    valve_tables,
)
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import save_model
from thermohyd.identify.report.fit_json import fit_json, json_text
from thermohyd.oil_definition import OilDefinition, walther_coefficients


STROKE = 213e-6
NUMBERS = {"edge_radius": 9e-6, "clearance": 2.4e-6, "underlap": 7e-6, "discharge_coefficient": 0.69, "transition_number": 95.0,
           "null_bias": 1.5e-6}  # fmt: skip
MODEL = Model(
    ValveData("valve Ä", STROKE, 12e-3),
    OilDefinition(*walther_coefficients([233.15, 343.15], [4000e-6, 30e-6])),
    NUMBERS,
    effects={"hysteresis": 2e-6, "flowmeter_scale": 0.02},
)


@pytest.fixture(scope="module")
def made() -> ValveTables:
    return valve_tables(MODEL, supply_pressure=70e5, return_pressure=1e5, temperature=313.15, positions=41, across=15)


def small() -> ValveTables:
    x, y = Axis("spool_position", "m", np.array([-1e-4, 0.0, 1e-4])), Axis("load_pressure", "Pa", np.array([-1e5, 1e5]))
    values = np.array([[-1.0, -2.0], [0.25, 1 / 3], [3.0, 4.0]])
    table = ValveTable("load_flow", "m3/s", "flow from A to B through the load", x, y, values, 0.05, 0.01)
    return ValveTables("valve Ä", 70e5, 0.0, 313.15, (table,), ())


# ---- what is in them


def test_the_nodes_are_the_models(made):
    import jax.numpy as jnp

    from thermohyd import Valve, load_flow, oil_from_definition, operating_points

    valve = Valve(oil=oil_from_definition(MODEL.oil), stroke=STROKE, slot_width=12e-3, **NUMBERS)
    table = made.tables[0]
    x, load = table.x.nodes, table.y.nodes
    i, j = np.array([0, 7, 20, 33]), np.array([0, 14, 7, 3])
    at = operating_points(
        jnp.asarray(x[i]),
        supply_pressure=70e5,
        return_pressure=1e5,
        temperature=313.15,
        load_pressure=jnp.asarray(load[j]),
    )
    np.testing.assert_allclose(table.values[i, j], load_flow(valve, at), rtol=1e-9, atol=1e-15)
    assert made.left_out == ("flowmeter_scale",)


def test_the_error_stated_is_that_between_the_nodes(made):
    """At places of our own the error is of the size that was stated, and more nodes make less of it."""
    table = made.tables[0]
    finer = valve_tables(MODEL, supply_pressure=70e5, return_pressure=1e5, temperature=313.15, positions=161, across=45)
    for coarse, fine in zip(made.tables, finer.tables, strict=True):
        assert fine.largest < 0.5 * coarse.largest
        assert 0.0 < coarse.mean < coarse.largest < 0.03 * coarse.span, error_words(coarse)
    fine = finer.tables[0]
    found = interpolated(table.x.nodes, table.y.nodes, table.values, fine.x.nodes, fine.y.nodes)
    assert np.max(np.abs(found - fine.values)) < 1.2 * table.largest


def test_nodes_stand_where_curves_bend():
    x = np.linspace(-1.0, 1.0, 201)
    curves = np.stack([np.abs(x - 0.3), np.zeros_like(x)], axis=1)
    nodes = x[chosen_nodes(x, curves, 5)]
    assert {-1.0, 0.0, 1.0} <= set(nodes)
    assert np.min(np.abs(nodes - 0.3)) < 1e-12
    assert len(nodes) == 5
    np.testing.assert_array_equal(chosen_nodes(x, curves, 999), np.arange(201))


# ---- as three programs read them


def test_modelica_reads_a_table_of_its_text():
    (text,) = (content.decode() for content in modelica(small()).values())
    lines = text.splitlines()
    assert lines[0] == "#1"  # the version, by which the program knows the file
    start = lines.index("double load_flow(4,3)")
    table = np.array([[float(cell) for cell in line.split()] for line in lines[start + 1 :]])
    np.testing.assert_array_equal(table[0], [0.0, -1e5, 1e5])
    np.testing.assert_array_equal(table[1:, 0], [-1e-4, 0.0, 1e-4])
    np.testing.assert_array_equal(table[1:, 1:], small().tables[0].values)
    assert all(line.startswith("#") for line in lines[:start])
    assert "misses the model by at most 0.05 m3/s (0.83 % of the range)" in text


def test_matlab_reads_a_struct_per_table(tmp_path):
    ((name, content),) = simscape(small()).items()
    assert name == "valve_simscape.mat"
    (tmp_path / name).write_bytes(content)
    read = loadmat(tmp_path / name, squeeze_me=True, struct_as_record=False)["load_flow"]
    np.testing.assert_array_equal(read.f, small().tables[0].values)
    np.testing.assert_array_equal(read.x, [-1e-4, 0.0, 1e-4])
    assert "misses the model by at most" in str(read.about)
    assert simscape(small())[name] == content


def test_amesim_reads_sizes_nodes_and_lines_along_the_position():
    ((name, content),) = amesim(small()).items()
    assert name == "valve_load_flow.data"
    lines = content.decode().splitlines()
    assert lines[0] == "# Table format: 2D"
    assert "# table_unit = m**3/s" in lines
    body = [line for line in lines if not line.startswith("#")]
    assert body[:2] == ["3", "2"]
    np.testing.assert_array_equal([float(cell) for cell in body[2].split()], [-1e-4, 0.0, 1e-4])
    values = np.array([[float(cell) for cell in line.split()] for line in body[4:]])
    np.testing.assert_array_equal(values.T, small().tables[0].values)


def test_the_command_writes_those_that_are_asked_for(monkeypatch, tmp_path):
    from thermohyd.identify.export import valve_tables as module

    monkeypatch.setattr(module, "valve_tables", lambda model, **about: small())
    save_model(MODEL, tmp_path / "model.json")
    run = command(monkeypatch, "export", 200)
    options = ("--supply", "70 bar", "--temperature", "40 degC", "--out", tmp_path / "out")
    ran = run("tables", tmp_path / "model.json", *options, "--for", "amesim, modelica", "--json")
    assert ran.exit_code == 0, ran.stderr
    content = json.loads(ran.stdout)
    assert content["tables"]["load_flow"]["largest_error"] == 0.05
    assert {f.name for f in (tmp_path / "out").iterdir()} == {*content["files"], ".thermohyd.json"}
    assert len(content["files"]) == 2
    for wrong, words in (
        (("--supply", "70", "-t", "40 degC"), "--supply"),
        (("--supply", "0 bar", "-t", "40 degC"), "--supply must exceed --return"),
        (("--supply", "70 bar", "-t", "40 degC", "--for", "excel"), 'unknown program "excel"'),
    ):
        bad = run("tables", tmp_path / "model.json", *wrong, "--out", tmp_path / "bad")
        assert bad.exit_code == 2
        assert words in bad.stderr
    assert not (tmp_path / "bad").exists()


# ---- results


@pytest.fixture(scope="module")
def fit_file(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("fit")
    (folder / "fit.json").write_text(json_text(fit_json(fake_fit())), encoding="utf-8")
    return folder / "fit.json"


def test_parameters_come_out_in_every_format(fit_file, tmp_path):
    tables = result_tables(load_result(fit_file))
    assert set(tables) >= {"parameters", "correlation", "readings"}
    for name, content in result_files(tables, ("csv", "parquet", "xlsx")).items():
        (tmp_path / name).write_bytes(content)
    given = json.loads(fit_file.read_text())["parameters"]
    for table in (
        pd.read_csv(tmp_path / "parameters.csv"),
        pd.read_parquet(tmp_path / "parameters.parquet"),
        pd.read_excel(tmp_path / "results.xlsx", sheet_name="parameters"),
    ):
        assert list(table["parameter"]) == list(given)
        np.testing.assert_allclose(table["value"].to_numpy(), [about["value"] for about in given.values()], rtol=1e-15)
    correlation = tables["correlation"].set_index("parameter")
    np.testing.assert_array_equal(correlation.to_numpy(), correlation.to_numpy().T)
    assert openpyxl.load_workbook(tmp_path / "results.xlsx").sheetnames == list(tables)


def test_named_effects_of_a_diagnosis(tmp_path):
    content = {
        "fit": {"parameters": {"clearance": {"value": 2e-6, "unit": "m", "std": None}}},
        "effects": [
            {"name": "hysteresis", "parameter": {"value": 1e-6, "unit": "m", "std": 1e-8, "ci95": [0.98e-6, 1.02e-6]}, "p_value": 1e-9,
             "gap_closed": 0.99, "alternatives": ["position_lag"], "sentence": "=1+1"}
        ],
    }  # fmt: skip
    tables = result_tables(content)
    assert tables["effects"].loc[0, "alternatives"] == "position_lag"
    (tmp_path / "results.xlsx").write_bytes(result_files(tables, ("xlsx",))["results.xlsx"])
    cells = openpyxl.load_workbook(tmp_path / "results.xlsx")["effects"][2]
    assert cells[-1].data_type == "s"  # a user's text is no formula


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is not valid JSON"),
        ("[]", "holds no parameters"),
        ('{"fit": {}}', "holds no parameters"),
        (None, "no such file"),
    ],
)
def test_what_is_no_result_is_refused(content, words, tmp_path):
    if content is not None:
        (tmp_path / "fit.json").write_text(content)
    with pytest.raises(BenchInputError, match=re.escape(words)):
        load_result(tmp_path / "fit.json")


def test_the_command_of_results(fit_file, monkeypatch, tmp_path):
    run = command(monkeypatch, "export", 120)
    ran = run("results", fit_file, "--out", tmp_path / "out", "--format", "csv")
    assert ran.exit_code == 0, ran.stderr
    assert (tmp_path / "out" / "parameters.csv").read_text().startswith("parameter,value,unit,std,ci95_low")
    bad = run("results", fit_file, "--out", tmp_path / "bad", "--format", "pdf")
    assert bad.exit_code == 2
    assert 'unknown format "pdf"; known: csv, parquet, xlsx' in bad.stderr
    assert not (tmp_path / "bad").exists()
