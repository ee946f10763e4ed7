"""What an FMU takes and gives, of whatever version: inputs, outputs, states, parameters, and what of its sources is compiled in. No JAX."""

from dataclasses import dataclass, field

from .servo_numbers import COMMANDS, ServoNumbers
from .valve_numbers import Number, ValveNumbers


# name: (unit, start, description); the start values of pressures and temperature are the bench's where the model says them
INPUTS = {
    "spool_position": ("m", 0.0, "Position of the spool, true; opens P to A where positive"),
    "spool_direction": ("1", 0.0, "Way that the spool last moved: +1, -1; 0: the middle of its loop"),
    "supply_pressure": ("Pa", 70e5, "Supply pressure, gauge"),
    "return_pressure": ("Pa", 0.0, "Return pressure, gauge"),
    "temperature": ("K", 313.15, "Temperature of the oil supplied"),
    "pressure_a": ("Pa", 35e5, "Pressure in port A, gauge"),
    "pressure_b": ("Pa", 35e5, "Pressure in port B, gauge"),
}
OUTPUTS = {
    "flow_a": ("m3/s", "Flow out of port A into the load, volume at the port"),
    "flow_b": ("m3/s", "Flow out of the load into port B, volume at the port"),
    "supply_flow": ("m3/s", "Flow from the supply, volume at supply conditions; leakage beside the spool included"),
    "return_flow": ("m3/s", "Flow to the return, volume at return conditions; leakage beside the spool included"),
    "mass_flow_a": ("kg/s", "Mass flow out of port A into the load"),
    "mass_flow_b": ("kg/s", "Mass flow out of the load into port B"),
    "load_flow": ("m3/s", "Flow through a load that takes pressure_a - pressure_b, the mean as the edges balance it"),
    "blocked_pressure_a": ("Pa", "Pressure in port A with both ports closed"),
    "blocked_pressure_b": ("Pa", "Pressure in port B with both ports closed"),
    "leakage_flow": ("m3/s", "Flow to the return with both ports closed, volume at return conditions"),
}
# Which inputs an output follows: all but those named.
_OF_CLOSED_PORTS = ("blocked_pressure_a", "blocked_pressure_b", "leakage_flow")
INDEPENDENT: dict[str, tuple[str, ...]] = dict.fromkeys(_OF_CLOSED_PORTS, ("pressure_a", "pressure_b"))
COMMAND_INPUTS = {
    "setpoint": ("m", "Setpoint of the piston's position"),
    "current": ("A", "Current; its full value drives the spool to its stroke"),
    "spool_position": ("m", "Position that the spool is driven to; opens P to A where positive"),
}
STATES = {
    "spool_position": ("m", "Position of the spool, true"),
    "spool_speed": ("m/s", "Speed of the spool"),
    "piston_position": ("m", "Position of the piston, from mid stroke"),
    "piston_velocity": ("m/s", "Velocity of the piston"),
    "pressure_a": ("Pa", "Pressure in chamber A, gauge"),
    "pressure_b": ("Pa", "Pressure in chamber B, gauge"),
}
WARM_STATES = {
    "temperature_a": ("K", "Temperature of the oil in chamber A"),
    "temperature_b": ("K", "Temperature of the oil in chamber B"),
}
PLAY_STATE = {"play": ("m", "Where the play between the command and the spool stands")}
CONSUMPTION = {name: OUTPUTS[name] for name in ("supply_flow", "return_flow")}
OF_INPUTS, OF_OUTPUTS, OF_RATES = 1000, 2000, 3000  # first value references; parameters have those from 0
SHARED_SOURCES = ("model.c", "model.h", "numbers.h", "hydraulics.h")


@dataclass(frozen=True)
class Interface:
    """What goes in and out. inputs: {name: (unit, start, description)}; outputs: {name: (unit, description)}, the states first.

    states: how many of the outputs are states. independent: {output: inputs that it does not follow}. sources: file names of the
    physics. choices: {macro: number} of what is compiled in. words: what it is, without the valve's name.
    """

    numbers: tuple[Number, ...]
    left_out: tuple[str, ...]
    inputs: dict[str, tuple[str, float, str]]
    outputs: dict[str, tuple[str, str]]
    sources: tuple[str, ...]
    choices: dict[str, int]
    words: str
    states: int = 0
    independent: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def followed(self, output: str) -> list[int]:
        """Which inputs, by their places, an output of a model without states follows."""
        return [i for i, name in enumerate(self.inputs) if name not in self.independent.get(output, ())]

    @property
    def units(self) -> tuple[str, ...]:
        """Every unit once."""
        of_ends = (unit for unit, *_ in (*self.inputs.values(), *self.outputs.values()))
        of_rates = (rate_unit(unit) for unit, _ in list(self.outputs.values())[: self.states])
        return tuple(dict.fromkeys((*(number.unit for number in self.numbers), *of_ends, *of_rates, "s")))


def rate_unit(unit: str) -> str:
    """The unit of what changes per second."""
    return {"m/s": "m/s2"}.get(unit, f"{unit}/s")


def valve_interface(numbers: ValveNumbers) -> Interface:
    """Of the static valve; a current takes the place of the position."""
    inputs = dict(INPUTS)
    if numbers.driven_by_current:
        inputs = {"current": ("A", 0.0, "Current; its full value moves the spool by its stroke"), **INPUTS}
        del inputs["spool_position"]
    return Interface(
        numbers.numbers,
        numbers.left_out,
        inputs,
        OUTPUTS,
        (*SHARED_SOURCES, "valve.c", "valve.h"),
        {"SERVO": 0},
        "Static flows of the servovalve",
        independent=INDEPENDENT,
    )


def servo_interface(numbers: ServoNumbers) -> Interface:
    """Of the valve with its actuator."""
    unit, words = COMMAND_INPUTS[numbers.command]
    # An output has the spool's true position under that name.
    name = "spool_command" if numbers.command == "spool_position" else numbers.command
    around = {
        "supply_pressure": (*INPUTS["supply_pressure"][:1], 210e5, INPUTS["supply_pressure"][2]),
        **{same: INPUTS[same] for same in ("return_pressure", "temperature")},
        "external_force": ("N", numbers.external_force, "Force on the load against the piston's positive direction"),
    }
    states = STATES | (WARM_STATES if numbers.keeps_heat else {}) | (PLAY_STATE if numbers.play else {})
    chosen = {
        "SERVO": 1,
        "KEEPS_HEAT": int(numbers.keeps_heat),
        "PLAY": int(numbers.play),
        "COMMAND": COMMANDS.index(numbers.command),
    }
    return Interface(
        numbers.numbers,
        numbers.left_out,
        {name: (unit, 0.0, words), **around},
        states | CONSUMPTION,
        (*SHARED_SOURCES, "servo.c", "servo.h", "equilibrium.c", "rodas5p.c"),
        chosen,
        "Actuator in motion on the servovalve",
        len(states),
    )
