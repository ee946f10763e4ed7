"""The noise-free rows of tests/conformance/dynamic and /unequal: runs of a jack, of a separately written model."""

import json
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from reference.actuator import Dynamic, Jack, Machine, Run
from reference.oil import seed_oil
from reference.valve import Valve


FOLDER = Path(__file__).parents[1] / "conformance"
DYNAMIC, UNEQUAL = "dynamic", "unequal"  # one run per dynamic effect; a jack of unequal areas on an overlapped valve
KINDS: dict[str, Literal["setpoint", "current", "spool_position"]] = {
    "closed": "setpoint",
    "current": "current",
    "spool": "spool_position",
}


@cache
def truth(of: str = DYNAMIC) -> dict:
    return json.loads((FOLDER / of / "truth.json").read_text(encoding="utf-8"))


def jack_of(of: str) -> Jack:
    a = truth(of)["actuator_SI"]
    if of == UNEQUAL:
        sides = {"piston_area": None, "chamber_volume": None, "piston_area_a": a["Sa"], "piston_area_b": a["Sb"]}
        sides |= {"chamber_volume_a": a["Vta"], "chamber_volume_b": a["Vtb"]}
    else:
        sides = {"piston_area": a["S"], "chamber_volume": a["Vt"]}
    return Jack(
        **sides,
        piston_stroke=a["stroke"],
        moving_mass=a["m"],
        viscous_friction=a["viscous_friction"],
        spool_frequency=a["spool_frequency"],
        spool_damping=a["spool_damping"],
        bulk_modulus_factor=a["bulk_modulus_factor"],
        amplifier_gain=a["KAKp"] / 100.0,
        sensor_gain=100.0,
        rated_current=a["Irated"],
        stroke=a["Xn"],
        polarity=a["polarity"],
    )


def machine_of(name: str, of: str = DYNAMIC) -> Machine:
    """The machine behind a record, in the reference's own terms."""
    t = truth(of)
    record = t["records"][name]
    return Machine(
        Valve(slot_width=t["actuator_SI"]["width"], **t["parameters"]),
        seed_oil(),
        jack_of(of),
        Run(KINDS[record["mode"]], *table(name, of)[:, :6].T),
        record["heat"] == "adiabatic",
        Dynamic(**record["effects"]),
    )


def table(name: str, of: str = DYNAMIC) -> np.ndarray:
    """All columns of a record (SI): time, command, P_s, P_t, T, F_e, then the five readings."""
    return np.loadtxt(FOLDER / of / f"{name}.csv", delimiter=",", skiprows=1)


def readings_of(name: str, of: str = DYNAMIC) -> np.ndarray:
    return table(name, of)[:, 6:]
