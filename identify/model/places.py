"""Where a typed term may act: the places of the circuit, of static tests and in motion. Data: a place is one entry. No JAX."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from thermohyd.identify.bench.test_record import TestRecord


FLOW_READINGS = ("leakage_flow", "flow")
PRESSURE_READINGS = ("load_pressure", "pressure_a", "pressure_b")
EDGES = ("pa", "pb", "at", "bt")
SUPPLY, RETURN = EDGES[:2], EDGES[2:]
AT_PORT = {"a": ("pa", "at"), "b": ("pb", "bt")}


@dataclass(frozen=True)
class Place:
    """Where a term acts. entries: of `library_rows.ENTRIES`, times these signs; readings: {channel: sign} of what is read.

    unit: of a shift, "1" for a share. local: whose pressure is the local one: "a", "b", "a-b", "supply", "return", of what lies at both
    ports "each" its own, of edges "edges" each one's mean pressure, or of one edge that one's. noun: what enters or shifts, as
    words say it. asked: variables that it is asked with, all where empty: another place says the rest better. followed:
    variables that it may go with from place to place (law "local"), in static tests. prior: chi-square by which it must do better
    than a simpler place: of some edges and not all, of two pressures and not one. warms: its shift is of a temperature [K],
    whose entries are factors on the viscosity.
    moving: of `term_variables.MOVED`, times these signs, or the "command", in tests in motion; asked_moving: the variables it is asked with
    there.
    """

    name: str
    unit: str
    noun: str
    entries: Mapping[str, float] = field(default_factory=dict)
    readings: Mapping[str, float] = field(default_factory=dict)
    local: str = "supply"
    asked: tuple[str, ...] = ()
    followed: tuple[str, ...] = ()
    prior: float = 0.0
    moving: Mapping[str, float] = field(default_factory=dict)
    asked_moving: tuple[str, ...] = ()
    warms: bool = False

    @property
    def leaks(self) -> bool:
        """Whether what it lets in or out may pass a gap."""
        return self.name.startswith("flow_")

    @property
    def parts(self) -> tuple["Place", ...]:
        """Of static tests: what it shifts at each port, or at each edge, where these go with their own pressure; else itself."""
        apart = {"each": AT_PORT, "edges": {edge: (edge,) for edge in EDGES}}.get(self.local)
        if apart is None:
            return (self,)
        at = lambda shifted, ends: {name: sign for name, sign in shifted.items() if name.split("_")[-1] in ends}
        found = [
            replace(self, local=local, entries=at(self.entries, edges), readings=at(self.readings, (local,)))
            for local, edges in apart.items()
        ]
        return tuple(part for part in found if part.static) or (self,)

    @property
    def static(self) -> bool:
        """Whether static tests can show it."""
        return bool(self.entries or self.readings)


def _of_edges(quantity: str, edges: Iterable[str], sign: float = 1.0) -> dict[str, float]:
    return {f"{quantity}_{edge}": sign for edge in edges}


_PRIOR = {4: 0.0, 2: 1.0, 1: 2.0}


def _edge_places(quantity: str, unit: str, noun: str) -> list[Place]:
    """A quantity of all edges, of a pair of them, and of each alone."""
    parts = {"": (EDGES, "all edges"), ":supply": (SUPPLY, "the supply edges"), ":return": (RETURN, "the return edges")}
    parts |= {f":{edge}": ((edge,), f"the edge {_edge_words(edge)}") for edge in EDGES}
    return [
        Place(f"{quantity}{part}", unit, f"{noun} {words}", _of_edges(quantity, edges), prior=_PRIOR[len(edges)])
        for part, (edges, words) in parts.items()
    ]


def _edge_flows() -> list[Place]:
    """A factor on what an edge lets through: of all edges also from spot to spot, as a slot that is not as wide everywhere does."""
    whole, *parts = _edge_places("edge_flow", "1", "a factor on the flow of")
    return [replace(whole, followed=("opening",)), *parts]


def _clearances() -> list[Place]:
    """The clearance, which a sleeve's own pressure widens: that of each edge."""
    places = _edge_places("clearance", "m", "a change of the clearance of")
    part = lambda place: place.name.partition(":")[2]
    return [replace(place, local=part(place) if part(place) in EDGES else "edges") for place in places]


# What warms oil on its way: what it has passed before, and what it flows beside.
_WARMS_OIL = ("constant", "pressure", "pressure_drop", "flow", "temperature", "time")


def _oil_temperatures() -> list[Place]:
    """The temperature of the oil in the valve; and at some edges, where it shows in the viscosity, with the pressure of each one's port."""
    alone = {edge: port for port, edges in AT_PORT.items() for edge in edges}
    whole, *parts = _edge_places("oil_temperature", "K", "a warming of the oil at")
    found = [replace(whole, noun="a warming of the oil in the valve", entries={"temperature": 1.0}, asked=_WARMS_OIL)]
    for place in parts:
        part = place.name.partition(":")[2]
        entries = {entry.replace("oil_temperature", "viscosity"): sign for entry, sign in place.entries.items()}
        found.append(replace(place, local=alone.get(part, "each"), entries=entries, asked=_WARMS_OIL, warms=True))
    return found


def _edge_words(edge: str) -> str:
    return "-".join(edge.upper())


# What flows beside the valve into the meter's line is read alike, whatever it goes with: a leak goes with these, an instrument with
# those.
_OF_A_LEAK = ("constant", "pressure_drop", "position", "opening", "load")
_OF_AN_INSTRUMENT = ("constant", "flow", "pressure", "reading_rate", "temperature", "direction", "rate", "time")

_OF_A_CHAMBER = (
    "constant",
    "pressure",
    "pressure_drop",
    "pressure_rate",
    "load",
    "velocity",
    "piston_position",
    "time",
)
_MOVING = (
    Place("force_on_piston", "N", "a force on the piston", moving={"force_on_piston": 1.0}, local="a-b",
          asked_moving=("constant", "velocity", "direction", "piston_position", "load", "temperature", "time")),
    # The spool's mass is not known: its force counts in the travel of the command that balances it.
    Place("force_on_spool", "m", "a force on the spool, as travel of its command,", moving={"force_on_spool": 1.0}, local="a-b",
          asked_moving=("constant", "position", "opening", "rate", "direction", "load", "velocity", "temperature", "time")),
    Place("command_lag", "m", "a lag of the command", moving={"command": 1.0}, asked_moving=("command_rate",)),
    Place("flow_into_chamber_a", "m3/s", "a flow into chamber A", moving={"flow_a": 1.0}, local="a",
          asked_moving=_OF_A_CHAMBER),
    Place("flow_into_chamber_b", "m3/s", "a flow into chamber B", moving={"flow_b": 1.0}, local="b",
          asked_moving=_OF_A_CHAMBER),
    Place("flow_into_chambers", "m3/s", "a flow into both chambers", moving={"flow_a": 1.0, "flow_b": 1.0}, local="each",
          asked_moving=("constant", "pressure", "pressure_drop", "pressure_rate", "time")),
    Place("heat_of_chamber", "W", "a flow of heat into each chamber's oil", moving={"heat_a": 1.0, "heat_b": 1.0}, local="each",
          asked_moving=("constant", "temperature", "pressure", "time")),
)  # fmt: skip


PLACES: dict[str, Place] = {
    place.name: place
    for place in (
        Place("flow_into_a", "m3/s", "a flow into port A", {"flow_into_a": 1.0}, local="a"),
        Place("flow_into_b", "m3/s", "a flow into port B", {"flow_into_b": 1.0}, local="b"),
        Place("flow_from_a_to_b", "m3/s", "a flow from port A to port B",
              {"flow_into_a": -1.0, "flow_into_b": 1.0}, local="a-b",
              moving={"flow_a": -1.0, "flow_b": 1.0},
              asked_moving=("constant", "load", "velocity", "direction", "position", "time")),
        Place("flow_into_return", "m3/s", "a flow into the return", readings={"leakage_flow": 1.0},
              local="return", asked=_OF_A_LEAK),
        Place("flow_into_supply", "m3/s", "a flow into the supply line", readings={"supply_flow": -1.0}, asked=_OF_A_LEAK),
        Place("position", "m", "a shift of the position", {"position": 1.0}, followed=("position",), moving={"position": 1.0},
              asked_moving=("constant", "position", "opening", "rate", "direction", "load", "temperature", "time")),
        Place("supply_pressure", "Pa", "a shift of the supply pressure inside", {"supply_pressure": 1.0}),
        Place("return_pressure", "Pa", "a shift of the return pressure inside", {"return_pressure": 1.0}),
        Place("pressure_in_passages", "Pa", "a loss of pressure on both sides of the edges",
              {"supply_pressure": -1.0, "return_pressure": 1.0}, prior=1.0),
        Place("viscosity", "1", "a factor on the oil's viscosity", {"viscosity": 1.0}, moving={"viscosity": 1.0},
              asked_moving=("constant", "temperature", "load", "time")),
        *_oil_temperatures(),
        *_edge_flows(),
        *_clearances(),
        *_edge_places("underlap", "m", "a change of the underlap of"),
        *_edge_places("edge_radius", "m", "a change of the edge radius of"),
        *_MOVING,
    )
}  # fmt: skip
OF_READING = "reading:"
SEVERAL = {"flows": FLOW_READINGS, "pressures": ("pressure_a", "pressure_b")}


def place_of(name: str, *, moving: bool = False) -> Place:
    """The place of a name, those of readings ("reading:leakage_flow", "reading:flows") included. Raises KeyError.

    moving: of a test in motion, where a reading goes with other quantities.
    """
    if not name.startswith(OF_READING):
        return PLACES[name]
    channel = name.removeprefix(OF_READING)
    if channel in READ_IN_MOTION and (moving or channel not in PRESSURE_READINGS):
        unit, local, asked = READ_IN_MOTION[channel]
        noun = f"a shift of the reading {channel}"
        return Place(name, unit, noun, local=local, readings={channel: 1.0}, asked=("",), asked_moving=asked)
    channels = SEVERAL.get(channel, (channel,))
    if channel not in SEVERAL and channel not in (*FLOW_READINGS, *PRESSURE_READINGS):
        raise KeyError(name)
    words = {"flows": "every flow that is read", "pressures": "both port pressures that are read"}
    noun = f"a shift of {words.get(channel, f'the reading {channel}')}"
    # What the supply's meter reads is the same channel by another name of the simulator.
    read = {c: 1.0 for c in channels} | ({"supply_flow": 1.0} if "leakage_flow" in channels else {})
    local = {"pressure_a": "a", "pressure_b": "b", "pressures": "each", "load_pressure": "a-b"}.get(channel, "supply")
    if channels[0] in FLOW_READINGS:
        asked = tuple(name for name in _OF_AN_INSTRUMENT if name != "pressure")
        return Place(name, "m3/s", noun, readings=read, local=local, asked=asked)
    return Place(name, "Pa", noun, readings=read, local=local, asked=_OF_AN_INSTRUMENT)


# {channel that a step test reads: its unit, whose pressure is the local one, the variables that its shift goes with}.
READ_IN_MOTION = {
    "spool_position": ("m", "supply", ("constant", "position", "rate", "direction", "temperature", "time")),
    "pressure_a": ("Pa", "a", ("constant", "pressure", "direction", "temperature", "time")),
    "pressure_b": ("Pa", "b", ("constant", "pressure", "direction", "temperature", "time")),
    "piston_position": ("m", "a-b", ("constant", "piston_position", "velocity", "direction", "temperature", "time")),
    "piston_velocity": ("m/s", "a-b", ("constant", "velocity", "direction", "temperature", "time")),
}


def places_in_motion(channels: Iterable[str]) -> list[Place]:
    """The places that step and frequency tests with these channels can show."""
    own = dict.fromkeys(channel for channel in channels if channel in READ_IN_MOTION)
    return [
        *(place_of(f"{OF_READING}{channel}", moving=True) for channel in own),
        *(place for place in PLACES.values() if place.moving),
    ]


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
