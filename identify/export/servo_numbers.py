"""A valve with its actuator as the numbers that the C sources of a servo know; which of its physics is compiled in; what is refused.

No JAX: a model.json becomes C without it.
"""

from dataclasses import dataclass
from typing import Literal

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, whole_library
from thermohyd.identify.bench.errors import BenchInputError, quoted
from thermohyd.identify.bench.record import OF_BOTH_SIDES
from thermohyd.identify.model.model import Model

from .valve_numbers import (
    COMMAND,
    PARAMETERS,
    PLAY,
    SOURCES,
    VALVE,
    Number,
    all_finite,
    edge_law_number,
    effect_number,
    expressible,
    left_on_the_bench,
    oil_numbers,
)


Command = Literal["setpoint", "current", "spool_position"]
COMMANDS: tuple[Command, ...] = ("setpoint", "current", "spool_position")
STROKE = ("m", "Greatest position of the spool, either way")
JACK = {
    "piston_area_a": ("m2", "Area of the piston towards chamber A"),
    "piston_area_b": ("m2", "Area of the piston towards chamber B"),
    "chamber_volume_a": ("m3", "Volume of chamber A at mid stroke, lines included"),
    "chamber_volume_b": ("m3", "Volume of chamber B at mid stroke, lines included"),
    "piston_stroke": ("m", "Of the piston from one end stop to the other"),
    "moving_mass": ("kg", "Piston and load"),
    "viscous_friction": ("N.s/m", "Viscous friction of piston and load"),
    "coulomb_friction": ("N", "Dry friction of piston and load"),
    "jack_leakage": ("m3/(s Pa)", "Leakage past the piston"),
    "spool_frequency": ("Hz", "Natural frequency of the spool behind its command"),
    "spool_damping": ("1", "Damping of the spool"),
    "bulk_modulus_factor": ("1", "Of the oil in the chambers"),
    "rated_current": ("A", "Current that moves the spool by its stroke"),
    "polarity": ("1", "1 or -1: which way a positive current moves the spool"),
    "amplifier_gain": ("A/V", "Of the controller; without part where a current or a position is commanded"),
    "sensor_gain": ("V/m", "Of the position sensor in the loop; likewise"),
}
RATED_CURRENT = 25e-3  # of `thermohyd.actuator.Actuator`, where a loop says nothing of it


@dataclass(frozen=True)
class ServoNumbers:
    """numbers: in the order of the C struct. left_out: effects that stay on the bench, or that no motion shows. command: what drives
    the servo. keeps_heat: chambers have temperatures. play: the command has a play as a further state. external_force: at the start."""

    numbers: tuple[Number, ...]
    left_out: tuple[str, ...]
    command: Command
    keeps_heat: bool
    play: bool
    external_force: float


def servo_numbers(model: Model, command: str) -> ServoNumbers:
    """The numbers of a model with an actuator. command: one of `COMMANDS`.

    Raises BenchInputError, in one sentence, where the model holds what the C sources cannot express.
    """
    known: dict[str, Command] = {kind: kind for kind in COMMANDS}
    chosen = known.get(command)
    if chosen is None:
        raise BenchInputError(f"a servo is driven by one of {', '.join(COMMANDS)}, not by {quoted(command)}")
    if model.actuator is None:
        raise BenchInputError("the model has no actuator, so that there is no servo; export the valve alone")
    library = whole_library()
    before = [n for n, amount in model.effects.items() if amount and n in library and library[n].elsewhere == COMMAND]
    if before:
        raise BenchInputError(
            f"the model holds the effect {before[0]}, which lies before the loop, where C sources have no memory for it; take it out of "
            "model.json, and delay the command in the other program"
        )
    acting = expressible(model, {name: info for name, info in library.items() if info.elsewhere})
    given = {
        **model.parameters,
        "slot_width": model.valve.slot_width,
        "null_pressure": model.valve.null_pressure or 0.0,
    }
    used = {name: entry for name, entry in PARAMETERS.items() if name != "heat_retention"}
    numbers = [Number(name, float(given.get(name, 0.0)), unit, words) for name, (unit, words) in used.items()]
    numbers.append(Number("stroke", model.valve.stroke, *STROKE))
    numbers += oil_numbers(model)
    static = [name for name, info in EFFECTS.items() if info.elsewhere == SOURCES]
    numbers += [effect_number(name, acting.get(name, 0.0)) for name in static]
    numbers.append(edge_law_number(model))
    jack = _jack(model, chosen)
    # What the record states of friction and leakage, and what was found beside it, are one number.
    numbers += [Number(name, jack[name] + acting.get(name, 0.0), *entry) for name, entry in JACK.items()]
    play = any(library[name].elsewhere == PLAY for name in acting)
    kept = (SOURCES, PLAY) if play else (SOURCES,)
    moving = [name for name, info in DYNAMIC_EFFECTS.items() if info.elsewhere in kept and name not in JACK]
    numbers += [effect_number(name, acting.get(name, 0.0)) for name in moving]
    unseen = tuple(name for name in acting if library[name].elsewhere == VALVE)
    return ServoNumbers(
        all_finite(numbers),
        left_on_the_bench(acting) + unseen,
        chosen,
        model.actuator.heat == "adiabatic",
        play,
        model.actuator.external_force,
    )


def _jack(model: Model, command: Command) -> dict[str, float]:
    """Of the actuator as it was fitted, by its names in C: both sides apart, gains."""
    data, valve = model.actuator, model.valve
    assert data is not None
    if command == "setpoint" and not data.closed_loop:
        raise BenchInputError(
            "the actuator has no controller; write amplifier_gain and sensor_gain into the actuator of model.json, or drive the servo "
            "by its current or its spool_position"
        )
    if command == "current" and valve.rated_current is None:
        raise BenchInputError(
            "the valve has no rated_current; write it into the valve of model.json, or drive the servo by its spool_position"
        )
    found = {name: value for name in JACK if (value := getattr(data, name, None)) is not None}
    for shared in OF_BOTH_SIDES:
        both = getattr(data, shared)
        found |= {} if both is None else {f"{shared}_a": both, f"{shared}_b": both}
    rated = RATED_CURRENT if valve.rated_current is None else valve.rated_current
    loop = {
        "amplifier_gain": data.amplifier_gain or 0.0,
        "sensor_gain": data.sensor_gain or 0.0,
        "rated_current": rated,
    }
    return {"bulk_modulus_factor": 1.0, **found, **loop, "polarity": float(valve.polarity), **model.dynamics}
