"""The noise-free rows of tests/conformance/lubrication: valves of the second edge law, of a separately written model."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from reference.oil import Oil, walther
from reference.valve import Effects, Rows, Valve


FOLDER = Path(__file__).parents[1] / "conformance" / "lubrication"
TESTS = ("leakage", "pressure_gain", "flow_gain")


@cache
def truth() -> dict:
    """Geometry, oil, and per file the parameters and effect amounts (SI)."""
    return json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


NAMES = tuple(truth()["files"])


@cache
def rows_and_readings(name: str, test: str) -> tuple[Rows, dict[str, np.ndarray]]:
    """Operating points of one test, and its readings [SI]: "reading", and for pressure_gain "pressure_a", "pressure_b"."""
    path = FOLDER / f"{name}.csv"
    header = [column.split(" [")[0] for column in path.read_text(encoding="utf-8").split("\n", 1)[0].split(",")]
    table = np.loadtxt(path, delimiter=",", skiprows=1, dtype=str, encoding="utf-8")
    table = table[table[:, 0] == test]
    numbers = {column: table[:, i] for i, column in enumerate(header)}
    of = lambda column: numbers[column].astype(float)
    rows = Rows(
        *map(of, ("spool_position", "supply_pressure", "return_pressure", "temperature")),
        direction=np.sign(of("position_rate")),
        time=of("time"),
        run=numbers["run"].astype(int),
        rate=of("position_rate"),
    )
    channels = ("reading", "pressure_a", "pressure_b") if test == "pressure_gain" else ("reading",)
    return rows, {channel: of(channel) for channel in channels}


def valve_of(name: str) -> tuple[Valve, Oil, Effects]:
    t, file = truth(), truth()["files"][name]
    valve = Valve(slot_width=t["geometry"]["width"], edge_law="lubrication", **file["parameters"])
    return valve, Oil(*walther(t["oil"]["viscosity_points_degC_cSt"])), Effects(**file["effects"])
