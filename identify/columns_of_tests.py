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
# What an absolute amplitude ratio is, by its output and by whether the command is a current.
ABSOLUTE_RATIO = {
    ("spool_position", False): "plain number",
    ("piston_position", False): "plain number",
    ("piston_velocity", False): "frequency",
    ("spool_position", True): "length per current",
    ("piston_position", True): "length per current",
    ("piston_velocity", True): "velocity per current",
}


def columns_of_step(closed_loop: bool) -> dict[str, tuple[str, ...]]:
    """{column: kinds that it may have} of a step test. In open loop a command is a spool position or a current."""
    own_noise = {f"{reading}_std": (kind,) for reading, kind in READINGS["step"].items()}
    readings = {reading: (kind,) for reading, kind in READINGS["step"].items()}
    conditions = {name: (kind,) for name, kind in CONDITIONS.items()}
    return {
        "time": ("time",),
        **_command(closed_loop),
        "external_force": ("force",),
        **conditions,
        **readings,
        **own_noise,
    }


def columns_of_frequency(closed_loop: bool, ratio: str) -> dict[str, tuple[str, ...]]:
    """{column: kinds that it may have} of a frequency test whose amplitude ratio is of the kind `ratio`."""
    readings = {"amplitude_ratio": (ratio,), "phase": ("angle",)}
    own_noise = {f"{reading}_std": kind for reading, kind in readings.items()}
    conditions = {name: (kind,) for name, kind in CONDITIONS.items()}
    return {
        "frequency": ("frequency",), **_command(closed_loop), "external_force": ("force",), **conditions, **readings,
        **own_noise,
    }  # fmt: skip


def _command(closed_loop: bool) -> dict[str, tuple[str, ...]]:
    return {"command": ("length",) if closed_loop else ("length", "current")}


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
