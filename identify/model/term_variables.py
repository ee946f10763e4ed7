"""With which quantity a typed term may go: the variables, and how a static test's rows have them. Data: a variable is one entry. No JAX."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.oil_definition import REFERENCE_TEMPERATURE as STATED_AT, OilDefinition

from .learned_terms import kinematic_viscosity
from .places import EDGES, FLOW_READINGS, SUPPLY, Place, read_as


# {what its rows could read: model's values (rows,), SI} of each test: pressures of the ports, flows.
States = Mapping[str, Mapping[str, np.ndarray]]
BLOCKED = ("leakage", "pressure_gain")
# Beside what a test's rows could read: how much more the oil lets through a gap at a row's temperature than at 40 degC, and by which
# share its viscosity falls for each K there.
THINNING, THINS = "thinning", "thins"
REFERENCE_TEMPERATURE = 313.15  # K; where a term that follows the temperature is 0


def thinning(oil: OilDefinition, temperature: np.ndarray) -> np.ndarray:
    """mu(40 degC)/mu(T) at zero gauge pressure (rows,)."""

    def dynamic(at: np.ndarray) -> np.ndarray:
        return kinematic_viscosity(oil, at) * (1.0 - oil.expansion * (at - STATED_AT))

    return dynamic(np.full(1, REFERENCE_TEMPERATURE)) / dynamic(np.asarray(temperature, dtype=float))


def of_the_oil(oil: OilDefinition, temperature: np.ndarray) -> dict[str, np.ndarray]:
    """{`THINNING`: mu(40 degC)/mu(T), `THINS`: -d ln mu/dT [1/K]} (rows,), at zero gauge pressure."""
    near = [np.log(thinning(oil, temperature + step)) for step in (-0.5, 0.5)]
    return {THINNING: thinning(oil, temperature), THINS: near[1] - near[0]}


@dataclass(frozen=True)
class At:
    """One test beside one place: what a variable may be made of. states: of the test; null_bias: m."""

    test: TestRecord
    place: Place
    states: Mapping[str, np.ndarray]
    null_bias: float

    @property
    def drop(self) -> np.ndarray:
        return self.test.supply_pressure - self.test.return_pressure

    @property
    def load(self) -> np.ndarray:
        """p_A - p_B: imposed, or the model's own."""
        if self.test.load_pressure is not None:
            return self.test.load_pressure
        if "pressure_a" in self.states:
            return self.states["pressure_a"] - self.states["pressure_b"]
        return np.zeros(self.test.rows)

    def port(self, port: str) -> np.ndarray:
        """A port's pressure: the model's own where it is blocked, else half way between supply and return, and its share of the load."""
        if f"pressure_{port}" in self.states:
            return self.states[f"pressure_{port}"]
        sign = 0.5 if port == "a" else -0.5
        return 0.5 * (self.test.supply_pressure + self.test.return_pressure) + sign * self.load

    @property
    def pressure(self) -> np.ndarray:
        return {
            "a": lambda: self.port("a"),
            "b": lambda: self.port("b"),
            "a-b": lambda: self.load,
            "supply": lambda: self.test.supply_pressure,
            "return": lambda: self.test.return_pressure,
            **{edge: lambda: 0.5 * sum(self.ends) for edge in EDGES},
        }[self.place.local]()

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Pressures before and behind the edge that the place is at, from the supply to the return."""
        port = self.port("a" if "a" in self.place.local else "b")
        return (self.test.supply_pressure, port) if self.place.local in SUPPLY else (port, self.test.return_pressure)

    @property
    def pressure_drop(self) -> np.ndarray:
        if self.place.local in EDGES:
            before, behind = self.ends
            return before - behind
        if self.place.local in ("a", "b"):
            return self.test.supply_pressure - self.pressure
        return self.load if self.place.local == "a-b" else self.drop

    @property
    def flow(self) -> np.ndarray:
        """What is read, of a flow; else what flows through the supply."""
        own = next((c for c in self.test.channels if c.name in FLOW_READINGS and c.name in self.place.readings), None)
        if own is not None:
            return self.states[read_as(self.test, own.name)]
        if "supply_flow" in self.states:
            return self.states["supply_flow"]
        return np.abs(self.states["flow"])

    def rate_of(self, values: np.ndarray) -> np.ndarray:
        """d/dt along each run, 0 where there is none."""
        found, time = np.zeros(self.test.rows), self.test.time
        assert time is not None
        for run in np.unique(self.test.run):
            rows = np.flatnonzero(self.test.run == run)
            t = time[rows]
            if len(rows) > 2 and np.all(np.diff(t) > 0.0):
                found[rows] = np.gradient(values[rows], t)
        return found

    @property
    def pressure_rate(self) -> np.ndarray:
        """Of the local pressure, where the ports are blocked: joined or loaded ones follow what is imposed."""
        return self.rate_of(self.pressure) if self.test.name in BLOCKED else np.zeros(self.test.rows)

    @property
    def reading_rate(self) -> np.ndarray:
        own = next((c for c in self.test.channels if c.name in self.place.readings), None)
        return np.zeros(self.test.rows) if own is None else self.rate_of(self.states[read_as(self.test, own.name)])

    @property
    def since(self) -> np.ndarray:
        assert self.test.time is not None
        return self.test.time - float(np.min(self.test.time))


@dataclass(frozen=True)
class Variable:
    """What a term follows. words: "{p}" stands for the local pressure's symbol. powers: whether root and square are asked too.

    moving: the same in a test in motion, in words; empty: only static tests have it. laws: the only ones, all where empty.
    """

    name: str
    unit: str
    words: str
    values: Callable[[At], np.ndarray]
    needs: str = ""  # a column
    powers: bool = False
    local: tuple[str, ...] = ()  # of places with this local pressure only
    of_readings: bool = False  # of readings only
    moving: str = ""
    laws: tuple[str, ...] = ()  # in motion


def _only_in_motion(at: At) -> np.ndarray:
    raise ValueError(f"{at.test.name} is no test in motion")


VARIABLES: dict[str, Variable] = {
    variable.name: variable
    for variable in (
        Variable("constant", "1", "at all rows alike", lambda at: np.ones(at.test.rows), moving="at all times alike"),
        Variable("position", "m", "the position", lambda at: at.test.spool_position - at.null_bias, powers=True,
                 moving="the spool's position"),
        Variable("opening", "m", "the opening", lambda at: np.abs(at.test.spool_position - at.null_bias), powers=True,
                 moving="the opening"),
        Variable("pressure", "Pa", "{p}", lambda at: at.pressure, powers=True, moving="{p}"),
        Variable("pressure_rate", "Pa/s", "d{p}/dt", lambda at: at.pressure_rate, "time",
                 local=("a", "b", "a-b", "each"), moving="d{p}/dt", laws=("proportional", "gaseous")),
        Variable("pressure_drop", "Pa", "the pressure drop", lambda at: at.pressure_drop, powers=True,
                 moving="p_S - {p}"),
        Variable("flow", "m3/s", "the flow", lambda at: at.flow, powers=True),
        Variable("temperature", "K", "the temperature", lambda at: at.test.temperature - REFERENCE_TEMPERATURE,
                 moving="the temperature"),
        Variable("direction", "1", "the direction of the sweep", lambda at: np.asarray(at.test.direction, dtype=float),
                 moving="the direction of motion", laws=("proportional",)),
        Variable("rate", "m/s", "the rate of the sweep", lambda at: np.asarray(at.test.rate, dtype=float), "rate",
                 moving="the spool's speed"),
        Variable("time", "s", "the time", lambda at: at.since, "time", moving="the time since the run began"),
        Variable("load", "Pa", "p_A - p_B", lambda at: at.load, moving="p_A - p_B"),
        Variable("reading_rate", "1/s", "the rate of what is read", lambda at: at.reading_rate, "time", of_readings=True),
        Variable("velocity", "m/s", "the piston's velocity", _only_in_motion, moving="the piston's velocity", powers=True),
        Variable("piston_position", "m", "the piston's position", _only_in_motion, moving="the piston's position"),
        # Of a setpoint or a position, or of the travel that a current asks for. What lags in proportion to it lags by a time.
        Variable("command_rate", "m/s", "the command's own rate", _only_in_motion, moving="its own rate", laws=("proportional",)),
    )
}  # fmt: skip


def asked_with(place: Place, variable: Variable, *, moving: bool = False) -> bool:
    """Whether the pair is an entry of the table, of static tests or in motion."""
    if moving:
        return bool(variable.moving) and variable.name in place.asked_moving
    if not place.static or variable.values is _only_in_motion:
        return False
    if variable.of_readings and not place.readings:
        return False
    if variable.local and place.local not in variable.local:
        return False
    return not place.asked or variable.name in place.asked


def laws_in_motion(variable: Variable) -> tuple[str, ...]:
    """The laws by which a place in motion goes with a variable."""
    if variable.name == "constant":
        return ("constant",)
    return variable.laws or ("proportional", *(("square", "root") if variable.powers else ()), "smooth")


# What of the machine a place in motion shifts, and the signals that variables are made of there (see `signal_of`).
MOVED = ("force_on_piston", "force_on_spool", "flow_a", "flow_b", "heat_a", "heat_b", "position", "viscosity")
SIGNALS = (
    "constant", "position", "opening", "rate", "turn", "turned", "velocity", "direction", "piston_position", "pressure_a", "pressure_b",
    "load", "drop_a", "drop_b", "drop", "warming_a", "warming_b", "temperature", "time",
)  # fmt: skip
# Which way the spool's command went last: a signal that the machine keeps only for who asks for it (`remembers`).
REMEMBERED = "turned"
# A variable that is the derivative of a state: it has no signal, and acts on what a chamber stores.
IMPLICIT = "pressure_rate"
# A variable whose law is a time by which the command acts later: exact however fast that changes, it shifts the machine's input.
DELAYED = "command_rate"
# Speed [m/s] above which the piston, or the spool, counts as going one way.
DIRECTION_SPEED = 1e-3


def signal_of(place: Place, moved: str, variable: str) -> str:
    """Which of `SIGNALS` a variable is for a part of the machine that a place shifts; of a reading `moved` is empty."""
    side = moved[-1] if moved.endswith(("_a", "_b")) else ""
    side = side if place.local == "each" else place.local
    ends = {"a": "_a", "b": "_b"}.get(side)
    if variable == "pressure":
        return f"pressure{ends}" if ends else "load"
    if variable == "pressure_drop":
        return f"drop{ends}" if ends else "load" if side == "a-b" else "drop"
    if variable == "temperature" and moved.startswith("heat"):
        return f"warming{ends}"
    if variable == "direction" and place.name in ("force_on_spool", "position"):
        return REMEMBERED
    if variable == "direction" and place.local == "supply":
        return "turn"
    return variable
