"""Which columns each bench test has: its readings, its conditions, and the kind of quantity of every one."""

POSITION = {"spool_position": "length", "current": "current"}
CONDITIONS = {"supply_pressure": "pressure", "return_pressure": "pressure", "temperature": "temperature"}
READINGS = {
    "leakage": {"leakage_flow": "flow"},
    "pressure_gain": {"load_pressure": "pressure", "pressure_a": "pressure", "pressure_b": "pressure"},
    "flow_gain": {"flow": "flow"},
    "load_flow": {"flow": "flow"},
    "step": {
        "spool_position": "length",
        "pressure_a": "pressure",
        "pressure_b": "pressure",
        "piston_position": "length",
        "piston_velocity": "velocity",
    },
    "frequency": {"amplitude_ratio": "plain number", "phase": "angle"},
}
# Columns of the dynamic tests that are no readings.
DRIVES = ("command", "frequency", "external_force")


def columns_of(test: str) -> dict[str, str]:
    """{column: kind} that a static test uses, `run` (a text) excepted."""
    extra = {"load_pressure": "pressure"} if test == "load_flow" else {}
    own_noise = {f"{reading}_std": kind for reading, kind in READINGS[test].items()}
    return {"time": "time", **POSITION, **CONDITIONS, **extra, **READINGS[test], **own_noise}


def standard_columns() -> set[str]:
    """Every column name that BENCH_FORMAT knows, of all tests: a log may hold more than one test needs."""
    names = {"run", "time", *POSITION, *CONDITIONS, *DRIVES}
    for readings in READINGS.values():
        names |= {*readings, *(f"{reading}_std" for reading in readings)}
    return names
