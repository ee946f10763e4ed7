"""What `simulate` shows and writes, from tables made by hand."""

import io
import json

import pandas as pd
from rich.console import Console

from thermohyd.identify.model.simulation_output import simulation_files, simulation_json, simulation_table
from thermohyd.identify.report.fit_json import json_text


TABLES = {
    "leakage": pd.DataFrame(
        {
            "LVDT [um]": [-10.0, 0.0, 10.0],
            "note": ["a, b", "", "c"],
            "leakage_flow_predicted [l/min]": [0.1, 0.42, 0.1234567891],
            "leakage_flow_predicted_std [l/min]": [0.001, 0.002, float("nan")],
        }
    )
}


def test_csv_keeps_the_users_columns():
    text = simulation_files(TABLES)["leakage.csv"]
    assert isinstance(text, str)
    assert text.splitlines()[0] == "LVDT [um],note,leakage_flow_predicted [l/min],leakage_flow_predicted_std [l/min]"
    assert text.splitlines()[1] == '-10,"a, b",0.1,0.001'
    back = pd.read_csv(io.StringIO(text))
    pd.testing.assert_frame_equal(
        back.drop(columns="note"), TABLES["leakage"].drop(columns="note"), rtol=1e-8, check_dtype=False
    )


def test_json_is_strict():
    content = json.loads(json_text(simulation_json(TABLES)))
    assert content["leakage"]["LVDT [um]"] == [-10.0, 0.0, 10.0]
    assert content["leakage"]["leakage_flow_predicted_std [l/min]"] == [0.001, 0.002, None]


def test_table_sums_up():
    out = io.StringIO()
    Console(file=out, width=80).print(simulation_table(TABLES))
    assert out.getvalue().splitlines()[-1].split() == [
        "leakage",
        "leakage_flow",
        "l/min",
        "3",
        "0.1000",
        "0.4200",
        "nan",
    ]
