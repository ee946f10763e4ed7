"""The noise-free rows of tests/conformance/lubrication: valves of the second edge law, of a separately written model."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from reference.conformance import static_file
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
def _file(name: str) -> tuple[dict[str, Rows], dict[str, dict[str, np.ndarray]]]:
    return static_file(FOLDER / f"{name}.csv")


def rows_and_readings(name: str, test: str) -> tuple[Rows, dict[str, np.ndarray]]:
    """Operating points of one test, and its readings [SI]: "reading", and for pressure_gain "pressure_a", "pressure_b"."""
    rows, readings = _file(name)
    rate = rows[test].rate
    assert rate is not None
    return replace(rows[test], direction=np.sign(rate)), readings[test]


def valve_of(name: str) -> tuple[Valve, Oil, Effects]:
    t, file = truth(), truth()["files"][name]
    valve = Valve(slot_width=t["geometry"]["width"], edge_law="lubrication", **file["parameters"])
    return valve, Oil(*walther(t["oil"]["viscosity_points_degC_cSt"])), Effects(**file["effects"])
