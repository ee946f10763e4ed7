"""The noise-free rows of tests/conformance: one table of operating points, one column of readings per effect."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from reference.oil import Oil, walther
from reference.valve import Effects, Rows, Valve


FOLDER = Path(__file__).parents[1] / "conformance"
TESTS = ("leakage", "pressure_gain", "flow_gain")


@cache
def truth() -> dict:
    """Geometry, oil, parameters and effect amounts behind the rows (SI)."""
    return json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


@cache
def _table() -> tuple[dict[str, int], np.ndarray]:
    path = FOLDER / "readings.csv"
    header = path.read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    names = {name.split(" [")[0]: i for i, name in enumerate(header)}
    return names, np.loadtxt(path, delimiter=",", skiprows=1, dtype=str, encoding="utf-8")


def rows_of(test: str) -> Rows:
    """Operating points of one test."""
    names, table = _table()
    part = table[table[:, names["test"]] == test]
    column = lambda name: part[:, names[name]].astype(float)
    return Rows(
        column("spool_position"),
        column("supply_pressure"),
        column("return_pressure"),
        column("temperature"),
        time=column("time"),
        run=column("run").astype(int),
    )


def readings_of(test: str, effect: str) -> np.ndarray:
    """Readings [SI] of one test with one effect ("none", a name of docs/physics.md section 8.2, or "all")."""
    names, table = _table()
    return table[table[:, names["test"]] == test][:, names[effect]].astype(float)


def valve_and_oil() -> tuple[Valve, Oil]:
    t = truth()
    oil = Oil(*walther(t["oil"]["viscosity_points_degC_cSt"]), density=t["oil"]["density_15degC"])
    return Valve(slot_width=t["geometry"]["width"], **t["parameters"]), oil


@dataclass(frozen=True)
class MoreRows:
    """A file of tests/conformance/more: its rows, test by test, what stands behind them, and every column of readings (SI)."""

    rows: dict[str, Rows]
    readings: dict[str, dict[str, np.ndarray]]
    truth: dict


def more_truth() -> dict:
    return json.loads((FOLDER / "more" / "truth.json").read_text(encoding="utf-8"))


def columns_of(path: Path) -> dict[str, np.ndarray]:
    """{column without its unit: its cells as text} of a CSV."""
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    cells = np.array([line.split(",") for line in lines])
    return {title.split(" [")[0]: cells[:, i] for i, title in enumerate(header.split(","))}


def _rows(columns: dict[str, np.ndarray]) -> Rows:
    return Rows(
        columns["spool_position"],
        columns["supply_pressure"],
        columns["return_pressure"],
        columns["temperature"],
        time=columns["time"],
        run=columns["run"].astype(int),
        rate=columns.get("position_rate"),
    )


def static_file(path: Path) -> tuple[dict[str, Rows], dict[str, dict[str, np.ndarray]]]:
    """({test: rows}, {test: {"reading", and of the pressure gain "pressure_a", "pressure_b": values}}) of a file of static tests."""
    found = columns_of(path)
    rows, readings = {}, {}
    for test in map(str, dict.fromkeys(found["test"])):
        own = {
            k: np.where(c == "", "nan", c)[found["test"] == test].astype(float) for k, c in found.items() if k != "test"
        }
        rows[test] = _rows(own)
        channels = ("reading", "pressure_a", "pressure_b") if test == "pressure_gain" else ("reading",)
        readings[test] = {channel: own[channel] for channel in channels}
    return rows, readings


@cache
def more_rows(name: str) -> MoreRows:
    """The static rows of tests/conformance/more/<name>.csv; "reading" is that of the row's test."""
    return MoreRows(*static_file(FOLDER / "more" / f"{name}.csv"), more_truth()["files"][name])


@cache
def rows_in_time(name: str) -> tuple[Rows, dict[str, np.ndarray], dict]:
    """A file with storage at the ports: its rows, {reading: values}, and what stands behind them (SI)."""
    own = {key: column.astype(float) for key, column in columns_of(FOLDER / "more" / f"{name}.csv").items()}
    readings = {key: own[key] for key in ("supply_flow", "pressure_a", "pressure_b")}
    return _rows(own), {"leakage_flow": own["return_flow"], **readings}, more_truth()["files"][name]


def valve_and_oil_of(truth: dict) -> tuple[Valve, Oil]:
    """Those behind a file of tests/conformance/more."""
    whole = more_truth()
    return Valve(slot_width=whole["geometry"]["width"], **truth["parameters"]), Oil(
        *walther(whole["oils"][truth["oil"]])
    )


def effects_of(effect: str) -> Effects:
    return Effects(**truth()["effects"][effect])
