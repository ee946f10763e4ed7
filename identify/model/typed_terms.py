"""Typed terms of a model: a place of the circuit, shifted by a law of a variable. Places and variables are two tables. No JAX.

A term says where something is missing and with which quantity it goes, in the place's own unit: "a flow into port A in proportion
to dp_A/dt, m3/Pa". It acts inside the model, like an effect, but names no cause. Adding a place or a variable is one entry.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import legendre

from thermohyd.identify.bench.test_record import TestRecord


# {what its rows could read: model's values (rows,), SI} of each test: pressures of the ports, flows.
States = Mapping[str, Mapping[str, np.ndarray]]
FLOW_READINGS = ("leakage_flow", "flow")
PRESSURE_READINGS = ("load_pressure", "pressure_a", "pressure_b")
BLOCKED = ("leakage", "pressure_gain")
EDGES = ("pa", "pb", "at", "bt")
SUPPLY, RETURN = EDGES[:2], EDGES[2:]
REFERENCE_TEMPERATURE = 313.15  # K; where a term that follows the temperature is 0


@dataclass(frozen=True)
class Place:
    """Where a term acts. entries: of `library_program.ENTRIES`, times these signs; readings: {channel: sign} of what is read.

    unit: of a shift, "1" for a share. local: whose pressure is the local one: "a", "b", "a-b", "supply", "return". noun: what enters or
    shifts, as words say it. asked: variables that it is asked with, all where empty: another place says the rest better.
    prior: chi-square by which it must do better than a simpler place: of some edges and not all, of two pressures and not one.
    """

    name: str
    unit: str
    noun: str
    entries: Mapping[str, float] = field(default_factory=dict)
    readings: Mapping[str, float] = field(default_factory=dict)
    local: str = "supply"
    asked: tuple[str, ...] = ()
    prior: float = 0.0


def _of_edges(quantity: str, edges: Iterable[str], sign: float = 1.0) -> dict[str, float]:
    return {f"{quantity}_{edge}": sign for edge in edges}


_PRIOR = {4: 0.0, 2: 1.0, 1: 2.0}


def _edge_places(quantity: str, unit: str, noun: str) -> list[Place]:
    """A quantity of all edges, of a pair of them, and of each alone."""
    parts = {"": (EDGES, "all edges"), ":supply": (SUPPLY, "the supply edges"), ":return": (RETURN, "the return edges")}
    parts |= {f":{edge}": ((edge,), f"the edge {_edge_words(edge)}") for edge in EDGES}
    return [
        Place(f"{quantity}{part}", unit, f"{noun} of {words}", _of_edges(quantity, edges), prior=_PRIOR[len(edges)])
        for part, (edges, words) in parts.items()
    ]


def _edge_words(edge: str) -> str:
    return "-".join(edge.upper())


# What flows beside the valve into the meter's line is read alike, whatever it goes with: a leak goes with these, an instrument with
# those.
_OF_A_LEAK = ("constant", "pressure_drop", "position", "opening", "load")
_OF_AN_INSTRUMENT = ("constant", "flow", "pressure", "reading_rate", "temperature", "direction", "rate", "time")

PLACES: dict[str, Place] = {
    place.name: place
    for place in (
        Place("flow_into_a", "m3/s", "a flow into port A", {"flow_into_a": 1.0}, local="a"),
        Place("flow_into_b", "m3/s", "a flow into port B", {"flow_into_b": 1.0}, local="b"),
        Place("flow_from_a_to_b", "m3/s", "a flow from port A to port B",
              {"flow_into_a": -1.0, "flow_into_b": 1.0}, local="a-b"),
        Place("flow_into_return", "m3/s", "a flow into the return", readings={"leakage_flow": 1.0},
              local="return", asked=_OF_A_LEAK),
        Place("flow_into_supply", "m3/s", "a flow into the supply line", readings={"supply_flow": -1.0}, asked=_OF_A_LEAK),
        Place("position", "m", "a shift of the position", {"position": 1.0}),
        Place("supply_pressure", "Pa", "a shift of the supply pressure inside", {"supply_pressure": 1.0}),
        Place("return_pressure", "Pa", "a shift of the return pressure inside", {"return_pressure": 1.0}),
        Place("pressure_in_passages", "Pa", "a loss of pressure on both sides of the edges",
              {"supply_pressure": -1.0, "return_pressure": 1.0}, prior=1.0),
        Place("viscosity", "1", "a factor on the oil's viscosity", {"viscosity": 1.0}),
        *_edge_places("edge_flow", "1", "a factor on the flow"),
        *_edge_places("clearance", "m", "a change of the clearance"),
        *_edge_places("underlap", "m", "a change of the underlap"),
        *_edge_places("edge_radius", "m", "a change of the edge radius"),
    )
}  # fmt: skip
OF_READING = "reading:"
SEVERAL = {"flows": FLOW_READINGS, "pressures": ("pressure_a", "pressure_b")}


def place_of(name: str) -> Place:
    """The place of a name, those of readings ("reading:leakage_flow", "reading:flows") included. Raises KeyError."""
    if not name.startswith(OF_READING):
        return PLACES[name]
    channel = name.removeprefix(OF_READING)
    channels = SEVERAL.get(channel, (channel,))
    if channel not in SEVERAL and channel not in (*FLOW_READINGS, *PRESSURE_READINGS):
        raise KeyError(name)
    words = {"flows": "every flow that is read", "pressures": "both port pressures that are read"}
    noun = f"a shift of {words.get(channel, f'the reading {channel}')}"
    # What the supply's meter reads is the same channel by another name of the simulator.
    read = {c: 1.0 for c in channels} | ({"supply_flow": 1.0} if "leakage_flow" in channels else {})
    local = {"pressure_a": "a", "pressure_b": "b", "load_pressure": "a-b"}.get(channel, "supply")
    if channels[0] in FLOW_READINGS:
        asked = tuple(name for name in _OF_AN_INSTRUMENT if name != "pressure")
        return Place(name, "m3/s", noun, readings=read, local=local, asked=asked)
    return Place(name, "Pa", noun, readings=read, local=local, asked=_OF_AN_INSTRUMENT)


def places_for(tests: Mapping[str, TestRecord]) -> list[Place]:
    """The places that the readings of these tests can show."""
    channels = list(dict.fromkeys(c.name for test in tests.values() for c in test.channels))
    own = [
        place_of(f"{OF_READING}{channel}") for channel in channels if channel in (*FLOW_READINGS, *PRESSURE_READINGS)
    ]
    own += [place_of(f"{OF_READING}{name}") for name, parts in SEVERAL.items() if set(parts) <= set(channels)]
    read = {read_as(test, c.name) for test in tests.values() for c in test.channels}
    return [
        *own, *(place for place in PLACES.values() if place.entries or read & set(place.readings))
    ]  # fmt: skip


def read_as(test: TestRecord, channel: str) -> str:
    """What of the simulator's readings a channel is: a leakage may be read in the supply line."""
    return "supply_flow" if channel == "leakage_flow" and test.meter == "supply" else channel


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
        }[self.place.local]()

    @property
    def pressure_drop(self) -> np.ndarray:
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
    """What a term follows. words: "{p}" stands for the local pressure's symbol. powers: whether root and square are asked too."""

    name: str
    unit: str
    words: str
    values: Callable[[At], np.ndarray]
    needs: str = ""  # a column
    powers: bool = False
    local: tuple[str, ...] = ()  # of places with this local pressure only
    of_readings: bool = False  # of readings only


VARIABLES: dict[str, Variable] = {
    variable.name: variable
    for variable in (
        Variable("constant", "1", "at all rows alike", lambda at: np.ones(at.test.rows)),
        Variable("position", "m", "the position", lambda at: at.test.spool_position - at.null_bias, powers=True),
        Variable("opening", "m", "the opening", lambda at: np.abs(at.test.spool_position - at.null_bias), powers=True),
        Variable("pressure", "Pa", "{p}", lambda at: at.pressure, powers=True),
        Variable("pressure_rate", "Pa/s", "d{p}/dt", lambda at: at.pressure_rate, "time", local=("a", "b", "a-b")),
        Variable("pressure_drop", "Pa", "the pressure drop", lambda at: at.pressure_drop, powers=True),
        Variable("flow", "m3/s", "the flow", lambda at: at.flow, powers=True),
        Variable("temperature", "K", "the temperature", lambda at: at.test.temperature - REFERENCE_TEMPERATURE),
        Variable("direction", "1", "the direction of the sweep", lambda at: np.asarray(at.test.direction, dtype=float)),
        Variable("rate", "m/s", "the rate of the sweep", lambda at: np.asarray(at.test.rate, dtype=float), "rate"),
        Variable("time", "s", "the time", lambda at: at.since, "time"),
        Variable("load", "Pa", "p_A - p_B", lambda at: at.load),
        Variable("reading_rate", "1/s", "the rate of what is read", lambda at: at.reading_rate, "time", of_readings=True),
    )
}  # fmt: skip


def asked_with(place: Place, variable: Variable) -> bool:
    """Whether the pair is an entry of the table."""
    if variable.of_readings and not place.readings:
        return False
    if variable.local and place.local not in variable.local:
        return False
    return not place.asked or variable.name in place.asked


POWERS = {"proportional": 1.0, "square": 2.0, "root": 0.5}
LAWS = ("constant", *POWERS, "smooth")
DEGREE = 3


@dataclass(frozen=True)
class TypedTerm:
    """place += law(variable), or times 1 + law of a place in shares; SI throughout.

    law: "constant", or coefficients[0] |v|^n sign(v) with n of `POWERS`, or "smooth": coefficients[i] P_i(s) (Legendre),
    s = clip((v - centre)/reach, -1, 1). v is held at what was seen, from low to high. null_bias [m]: position and opening count from it.
    """

    place: str
    variable: str
    law: str
    coefficients: tuple[float, ...]
    low: float
    high: float
    null_bias: float = 0.0
    # Of the coefficients (k, k), and of each with parameters and amounts by name: what a prediction's error bar needs.
    covariance: tuple[tuple[float, ...], ...] = ()
    with_parameters: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def centre(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def reach(self) -> float:
        return 0.5 * (self.high - self.low)

    @property
    def unit(self) -> str:
        """Of the first coefficient."""
        return unit_of(self.place, self.variable, self.law)


def unit_of(place: str, variable: str, law: str) -> str:
    """SI, of a law's coefficient: what the place is shifted by per unit of the variable."""
    own, of = place_of(place).unit, VARIABLES[variable].unit
    if law in ("constant", "smooth") or of == "1":
        return own
    if variable == "flow" and own == "m3/s":
        own, of = "1", "1"
    if variable == "reading_rate":
        return "s"
    if own == of and law == "proportional":
        return "1"
    whole = f"({of})" if "/" in of else of
    power = {"proportional": whole, "square": f"{whole}^2", "root": f"sqrt({of})"}[law]
    if (own, variable, law) == ("m3/s", "pressure_rate", "proportional"):
        return "m3/Pa"
    return f"m3/(s {power})" if own == "m3/s" and law != "root" else f"{own}/{power}"


def with_covariance(term: TypedTerm, free: tuple[str, ...], matrix: np.ndarray) -> TypedTerm:
    """The term with the joint covariance of `free` and its coefficients, which stand last."""
    count = len(term.coefficients)
    own = tuple(tuple(float(v) for v in row) for row in matrix[-count:, -count:])
    cross = {name: tuple(float(v) for v in matrix[i, -count:]) for i, name in enumerate(free)}
    return replace(term, covariance=own, with_parameters=cross)


def coefficients_of(law: str) -> int:
    """How many coefficients a law has."""
    return DEGREE + 1 if law == "smooth" else 1


def basis(law: str, values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(rows, coefficients): what each coefficient of a law multiplies; beyond low and high it is held."""
    values = np.clip(values, low, high)
    if law == "constant":
        return np.ones((len(values), 1))
    if law == "smooth":
        reach = 0.5 * (high - low)
        return legendre.legvander((values - 0.5 * (low + high)) / reach if reach > 0.0 else 0.0 * values, DEGREE)
    return (np.sign(values) * np.abs(values) ** POWERS[law])[:, None]


def values_of(variable: str, place: Place, test: TestRecord, states: States, null_bias: float) -> np.ndarray:
    """A variable at each row (rows,), SI. Raises ValueError where the test lacks a column."""
    needed = VARIABLES[variable].needs
    if needed and getattr(test, needed) is None:
        raise ValueError(f"the record has no {needed}")
    return VARIABLES[variable].values(At(test, place, states[test.name], null_bias))


def shift_of(term: TypedTerm, test: TestRecord, states: States) -> np.ndarray:
    """What the term shifts its place by at each row of a test (rows,), SI."""
    values = values_of(term.variable, place_of(term.place), test, states, term.null_bias)
    return basis(term.law, values, term.low, term.high) @ np.asarray(term.coefficients)
