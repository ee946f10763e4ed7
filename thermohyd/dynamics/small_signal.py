"""Frequency response of small motions: the vector field itself, linearised about the first row's equilibrium."""

from typing import Literal, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ..actuator import Actuator
from ..precision import require_float64
from ..valve import Valve
from .equilibrium import equilibrium, scaling_of
from .inputs import StepInputs
from .integrate import FAILURES, NO_EQUILIBRIUM
from .motion import Motion
from .plant import Heat, Plant, plant_of, transducer_gain
from .state import POSITION, State
from .vector_field import rates_at
from .walls import Walls


Output = Literal["spool_position", "piston_velocity", "piston_position"]
OUTPUTS = ("spool_position", "piston_velocity", "piston_position")
# Frequencies that carry the phase from where it is 0 or 180 degrees up to the wanted ones; 0.3 % apart over six decades,
# so that even a resonance of damping 0.002 turns it by less than half a turn from one to the next.
LADDER = np.geomspace(1e-6, 1.0, 4096)


class FrequencyResponse(eqx.Module):
    """Arrays of shape (frequencies,). amplitude_ratio: of output to command, or relative to its low-frequency asymptote [-].

    phase [degrees], unwrapped from the lowest frequencies on. found: whether there is an equilibrium to linearise about.
    """

    amplitude_ratio: Float[Array, " frequencies"]
    phase: Float[Array, " frequencies"]
    found: Bool[Array, ""]


class Linearised(eqx.Module):
    """x' = A x + b u, y = c x about an equilibrium, in the scaled state; u the command, without its delay."""

    matrix: Float[Array, "states states"]
    drive: Float[Array, " states"]
    read: Float[Array, " states"]

    def gain(self, pulsation: Float[Array, " frequencies"]) -> Array:
        """y/u at s = i omega, complex."""
        matrix, drive, read = (part.astype(complex) for part in (self.matrix, self.drive, self.read))
        s = 1j * pulsation.astype(complex)
        resolvent = s[:, None, None] * jnp.eye(matrix.shape[0], dtype=complex) - matrix
        moved = jnp.linalg.solve(resolvent, jnp.broadcast_to(drive[:, None], (*pulsation.shape, *drive.shape, 1)))
        return jnp.sum(moved[..., 0] * read, axis=-1)


def refuse_backlash(motion: Motion) -> None:
    """Raise ValueError where there is play: it passes no small motion at all."""
    if motion.backlash is not None:
        raise ValueError("backlash has no small-signal response: take it out, or use a step test")


def linearise(plant: Plant, output: Output) -> tuple[Linearised, Bool[Array, ""]]:
    """(the vector field linearised about the equilibrium of the first row, whether there is one)."""
    time = plant.inputs.time[0]
    around = plant.surroundings(time)
    scaling = scaling_of(plant, around)
    start, found = equilibrium(plant, scaling, time)

    def field(vector: Array, command: Array) -> Array:
        return scaling.pack_rates(rates_at(plant, scaling.unpack(vector), around, command))

    vector, command = scaling.pack(start), plant.inputs.command.start[0]
    matrix, drive = jax.jacfwd(field, argnums=(0, 1))(vector, command)
    read = jax.jacfwd(lambda v: _reading(scaling.unpack(v), output, plant.valve))(vector)
    keep = np.arange(vector.shape[0])
    if plant.kind != "setpoint" and output != "piston_position":
        # In open loop the position only integrates, and nothing else depends on it: without it there is a lowest frequency.
        keep = np.delete(keep, POSITION)
    return Linearised(matrix[keep][:, keep], drive[keep], read[keep]), found


@eqx.filter_jit
def _response(plant: Plant, frequency: Array, output: Output, absolute: bool) -> FrequencyResponse:
    linear, found = linearise(plant, output)
    wanted = 2.0 * jnp.pi * frequency
    gain = linear.gain(wanted)
    amplitude = jnp.abs(gain)
    if not absolute:
        amplitude = amplitude / jnp.abs(jnp.sum(linear.read * jnp.linalg.solve(linear.matrix, linear.drive)))
    own = jnp.angle(gain)
    ladder = jax.lax.stop_gradient(jnp.max(wanted)) * LADDER
    climbed = jnp.unwrap(jnp.angle(jax.lax.stop_gradient(linear.gain(ladder))))
    near = jnp.interp(jax.lax.stop_gradient(jnp.log(wanted)), jnp.log(ladder), climbed)
    phase = own + 2.0 * jnp.pi * jax.lax.stop_gradient(jnp.round((near - own) / (2.0 * jnp.pi)))
    if plant.motion.spool_delay is not None:
        phase = phase - wanted * plant.motion.spool_delay
    return FrequencyResponse(amplitude, jnp.rad2deg(phase), found)


def _reading(state: State, output: Output, valve: Valve) -> Array:
    if output == "spool_position":
        return state.spool / transducer_gain(valve)
    return state.velocity if output == "piston_velocity" else state.position


def frequency_response(
    valve: Valve,
    actuator: Actuator,
    inputs: StepInputs,
    frequency: Float[Array, " frequencies"],
    *,
    output: Output = "spool_position",
    absolute: bool = False,
    heat: Heat = "adiabatic",
    walls: Walls | None = None,
    polarity: int = 1,
    throw: bool = True,
) -> FrequencyResponse:
    """Small-signal response of an output to the command, about the equilibrium of the first row of `inputs`.

    frequency [Hz]: (frequencies,), positive. output: "spool_position" [m], "piston_velocity" [m/s] or "piston_position" [m], per
    setpoint [m], current [A] or spool position [m]. absolute: the plain ratio, instead of that to the low-frequency asymptote.
    The linearisation is that of the very vector field that `simulate_step` integrates; a delay adds its phase. Friction acts
    with its slope at the equilibrium. It can be jitted, vmapped and differentiated like `simulate_step`.

    Raises ValueError with one sentence for backlash, which has no small-signal response, and for the ratio of a piston
    position in open loop, which has no asymptote; RuntimeError in single precision and, with `throw`, where there is no
    equilibrium. Source: MODEL section 7.
    """
    require_float64("frequency_response")
    if output not in OUTPUTS:
        raise ValueError(f"output must be one of {', '.join(OUTPUTS)}, not {output!r}")
    if output == "piston_position" and inputs.kind != "setpoint" and not absolute:
        raise ValueError("a piston position in open loop has no low-frequency asymptote: ask for the absolute ratio")
    built = Walls() if walls is None else walls
    plant = plant_of(valve, actuator, inputs, heat=heat, walls=built, polarity=polarity)
    refuse_backlash(plant.motion)
    frequency = jnp.asarray(frequency, dtype=jnp.result_type(float))
    response = cast(FrequencyResponse, _response(plant, frequency, output, absolute))
    if throw and not isinstance(response.found, Tracer) and not jnp.all(response.found):
        raise RuntimeError(FAILURES[NO_EQUILIBRIUM])
    return response
