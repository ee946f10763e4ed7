"""The noise-free rows of tests/conformance/dynamic: one run per dynamic effect, of a separately written model."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from reference.actuator import Dynamic, Jack, Machine, Run
from reference.oil import seed_oil
from reference.valve import Valve


FOLDER = Path(__file__).parents[1] / "conformance" / "dynamic"


@cache
def truth() -> dict:
    return json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))


def machine_of(name: str) -> Machine:
    """The machine behind a record, in the reference's own terms."""
    t = truth()
    a, record = t["actuator_SI"], t["records"][name]
    jack = Jack(
        a["S"], a["Vt"], a["stroke"], a["m"], a["viscous_friction"], a["spool_frequency"], a["spool_damping"],
        a["bulk_modulus_factor"], a["KAKp"] / 100.0, 100.0, a["Irated"], a["Xn"], a["polarity"],
    )  # fmt: skip
    kind = "setpoint" if record["mode"] == "closed" else "current"
    valve = Valve(slot_width=a["width"], **t["parameters"])
    return Machine(
        valve,
        seed_oil(),
        jack,
        Run(kind, *table(name)[:, :6].T),
        record["heat"] == "adiabatic",
        Dynamic(**record["effects"]),
    )


def table(name: str) -> np.ndarray:
    """All columns of a record (SI): time, command, P_s, P_t, T, F_e, then the five readings."""
    return np.loadtxt(FOLDER / f"{name}.csv", delimiter=",", skiprows=1)


def readings_of(name: str) -> np.ndarray:
    return table(name)[:, 6:]
