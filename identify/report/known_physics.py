"""What physics is known to show as a typed term of a place and a variable, and what would confirm it on the bench. Data, no JAX."""

from dataclasses import dataclass

from thermohyd.identify.model.places import OF_READING


@dataclass(frozen=True)
class Known:
    """What physics is known to show as terms of these places and variables, and what would confirm it on the bench."""

    places: tuple[str, ...]  # without their edges, but of oil that is warmer at some of them ("oil_temperature:")
    variables: tuple[str, ...]
    does: str
    confirm: str
    laws: tuple[str, ...] = ()  # by which it usually goes, empty where none is more usual

    def usual(self, law: str) -> bool:
        """Whether it usually goes by this law."""
        return not self.laws or law in self.laws


# Tests in motion.
_INTO_A_CHAMBER = ("flow_into_chamber_a", "flow_into_chamber_b", "flow_into_chambers")
KNOWN_IN_MOTION = (
    Known(
        ("force_on_piston",),
        ("direction",),
        "what dry friction of seals, guides or the load does",
        "pull the piston by hand at rest, or read both pressures while it creeps both ways",
    ),
    Known(
        ("force_on_piston",),
        ("velocity",),
        "what seals or a load that is dragged through a fluid do",
        "run the same steps at another size: the force goes with the speed",
    ),
    Known(
        ("force_on_piston",),
        ("piston_position",),
        "what a spring, a hose pack or a load on a lever does",
        "hold the piston at three places and read both pressures",
    ),
    Known(
        ("force_on_piston",),
        ("constant",),
        "what a weight, or a load cell's zero, does",
        "read both pressures at rest",
    ),
    Known(
        ("force_on_spool",),
        ("position", "opening", "load"),
        "what the jets' flow force, or a centring spring, does",
        "repeat at another supply pressure: a flow force goes with the pressure drop, a spring does not",
    ),
    Known(
        ("command_lag",),
        ("command_rate",),
        "what a delay of the command does: sampling, a bus, the first stage's transport",
        "log the command where the valve receives it, or read the response to a step at many times a millisecond",
    ),
    Known(
        ("force_on_spool",),
        ("rate",),
        "what a delay on the command or more damping of the spool does",
        "read the spool's frequency response: a delay turns its phase in proportion to the frequency",
    ),
    Known(
        ("force_on_spool",),
        ("direction",),
        "what play, friction of the spool or a magnetic loop does",
        "move the spool slowly both ways with the supply shut",
    ),
    Known(
        ("force_on_spool",),
        ("constant",),
        "what a torque motor or an amplifier that is off its zero does",
        "read the current at the hydraulic null",
    ),
    Known(
        _INTO_A_CHAMBER,
        ("pressure_rate",),
        "what air in the oil, or the gas of an accumulator, does",
        "bleed the chambers, or repeat at another supply pressure: air is softer the lower it is",
        ("gaseous",),
    ),
    Known(
        _INTO_A_CHAMBER,
        ("pressure_rate",),
        "what a hose, or more oil than was stated, at the chamber does",
        "run the same steps with the valve flanged to the cylinder",
        ("proportional",),
    ),
    Known(
        ("flow_from_a_to_b",),
        ("load",),
        "what a leak past the piston, or a bypass between the chambers, does",
        "hold a load with the valve's ports blocked and see how fast the piston creeps",
    ),
    Known(
        _INTO_A_CHAMBER,
        ("pressure", "pressure_drop", "load"),
        "what a leak of that chamber does: a rod seal, a fitting, a relief valve",
        "hold a load with the valve's ports blocked, and look for oil outside",
    ),
    Known(
        ("heat_of_chamber",),
        ("temperature",),
        "what the cylinder's wall does, which takes heat from the oil",
        "put a thermometer on the cylinder, or wait longer between the runs",
    ),
    Known(
        ("viscosity",),
        ("temperature", "constant"),
        "what another oil, or a thermometer that is off, does",
        "measure a sample of the oil at two temperatures",
    ),
    Known(
        ("position",),
        ("direction",),
        "what friction between spool and transducer does",
        "move the spool slowly both ways",
    ),
    Known(
        ("position",),
        ("temperature", "time", "constant"),
        "what a null that wanders does",
        "go back to the first condition: the null comes back, or it does not",
    ),
    Known(
        ("position",),
        ("position",),
        "what slots or laps unlike those of the model, or a transducer's calibration, do",
        "read the flow over the whole stroke, and check the transducer against a dial gauge",
    ),
    Known((OF_READING,), ("constant",), "what an instrument's zero does", "read the instrument with its line shut"),
    Known(
        (OF_READING,),
        ("velocity", "rate"),
        "what an instrument that lags does",
        "repeat with steps of half the size, which halves it",
    ),
    Known(
        (OF_READING,),
        ("position", "piston_position", "pressure"),
        "what an instrument's calibration does",
        "calibrate the instrument, or swap it",
    ),
    Known(
        (OF_READING,),
        ("temperature", "time"),
        "what an instrument that drifts does",
        "read the instrument's zero before and after",
    ),
)


_PORTS = ("flow_into_a", "flow_into_b")
_LENGTHS = ("edge_radius", "clearance", "underlap", "edge_flow")
KNOWN = (
    Known(
        _PORTS,
        ("pressure_rate",),
        "what a trapped volume does: hose, gauge or air at a blocked port",
        "sweep at half the rate, which halves it; a shorter hose or a bled gauge takes it away",
    ),
    Known(
        ("flow_from_a_to_b",),
        ("pressure_rate",),
        "what volumes trapped at both blocked ports do, twice as much at each: hoses, gauges or air",
        "sweep at half the rate, which halves it; shorter hoses or bled gauges take it away",
    ),
    Known(
        _PORTS,
        ("pressure", "pressure_drop", "constant"),
        "what a leak at that port does: a fitting, a shuttle valve, the gauge's line",
        "close the port at the valve itself",
    ),
    Known(
        (*_PORTS, "flow_from_a_to_b"),
        ("load", "pressure_drop", "pressure"),
        "what a leak between the ports does",
        "blank the ports at the valve, without the manifold",
    ),
    Known(
        ("flow_into_return",),
        ("pressure_drop",),
        "what a first stage, a bushing or a seal lets past the edges",
        "close the pilot supply, or read the leakage with the spool taken out",
    ),
    Known(
        ("flow_into_return", "flow_into_supply"),
        ("position", "opening", "load"),
        "what a flow beside the edges that follows the spool does",
        "read supply and return flow at once: what enters in between is their difference",
    ),
    Known(
        ("position",),
        ("direction",),
        "what play, friction or a magnetic loop does",
        "sweep again at another rate: the width stays",
    ),
    Known(
        ("position",), ("rate",), "what a lag between spool and reading does", "sweep at half the rate, which halves it"
    ),
    Known(
        ("position",),
        ("temperature", "pressure", "pressure_drop", "time"),
        "what a null that wanders does",
        "go back to the first condition: the null comes back, or it does not",
    ),
    Known(
        ("position",),
        ("position", "opening"),
        "what a transducer's calibration, or its winding, does",
        "check the transducer against a dial gauge",
    ),
    Known(
        ("supply_pressure",),
        ("flow",),
        "what a pressure control that droops, or the line between gauge and valve, loses",
        "put the gauge at the valve, or read again at another flow",
        ("proportional",),
    ),
    Known(
        ("return_pressure",),
        ("flow",),
        "what a filter, a cooler or a hose in the return line builds up",
        "put the return's gauge at the valve, or read again at another flow",
        ("square",),
    ),
    Known(
        ("pressure_in_passages",),
        ("flow",),
        "what drillings and bends between the gauges and the edges lose",
        "read both port pressures at a large flow, or read again at another one",
        ("square",),
    ),
    Known(
        ("viscosity",),
        ("temperature", "constant"),
        "what another oil, or a thermometer that is off, does",
        "measure a sample of the oil at two temperatures",
    ),
    Known(
        ("oil_temperature",),
        ("constant", "temperature", "time"),
        "what a thermometer that is off or sits far from the valve, or a body that has not warmed through, does",
        "put a thermometer into the valve's return port, and wait at one temperature",
    ),
    Known(
        ("oil_temperature",),
        ("pressure", "pressure_drop", "flow"),
        "what oil that keeps its throttling heat does",
        "put a thermometer into the return port, and repeat with colder oil",
    ),
    Known(
        ("viscosity",),
        ("pressure", "pressure_drop", "flow"),
        "what oil that thickens under pressure, or keeps its throttling heat, does",
        "repeat at another supply pressure",
    ),
    Known(
        ("oil_temperature:",),
        ("pressure_drop",),
        "what oil that keeps the heat of the edge before it does",
        "repeat with colder oil and at another supply pressure: the heat goes with the pressure drop",
    ),
    Known(
        ("clearance",),
        ("time",),
        "what silt that settles in the gap does",
        "hold the spool still and watch the leakage fall, then move it to and fro",
    ),
    Known(
        ("clearance",),
        ("temperature",),
        "what spool and sleeve that expand unequally do",
        "repeat at a third temperature",
    ),
    Known(
        ("clearance",),
        ("pressure", "pressure_drop"),
        "what a sleeve that widens under pressure does",
        "repeat at another supply pressure",
    ),
    Known(
        _LENGTHS,
        ("constant",),
        "what wear of an edge, or a grinding error, does",
        "read both port pressures, or inspect the edge",
    ),
    Known(
        ("clearance", "edge_flow"),
        ("position", "opening"),
        "what an eccentric spool, a slot that narrows or an edge that is no longer straight does",
        "inspect the lands",
    ),
    Known((OF_READING,), ("constant",), "what an instrument's zero does", "read the instrument with its line shut"),
    Known(
        (OF_READING,),
        ("flow", "pressure", "load"),
        "what an instrument's calibration does",
        "calibrate the instrument, or swap it",
    ),
    Known(
        (OF_READING,),
        ("reading_rate", "rate", "direction"),
        "what an instrument that lags does",
        "sweep at half the rate, which halves it",
    ),
    Known(
        (OF_READING,),
        ("temperature", "time"),
        "what an instrument that drifts does",
        "read the instrument's zero before and after",
    ),
)


def known_physics(place: str, variable: str, law: str = "", *, moving: bool = False) -> Known | None:
    """The entry of `KNOWN` for a pair of place and variable, or of `KNOWN_IN_MOTION`: the first that usually goes by the law, else the
    first."""
    apart = (OF_READING, "oil_temperature:")
    family = next((start for start in apart if place.startswith(start)), place.split(":")[0])
    found = [k for k in (KNOWN_IN_MOTION if moving else KNOWN) if family in k.places and variable in k.variables]
    return next((k for k in found if k.usual(law)), found[0] if found else None)
