"""Frequency response and loop margins of small motions, from the vector field linearised about the first row's equilibrium.

The position loop is broken at its feedback: margins, bandwidth and peak are differentiable.
"""

import re
from dataclasses import replace
from typing import Literal, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Complex, Float

from thermohyd.actuator import Actuator
from thermohyd.arguments import Heat, heat_of_chambers
from thermohyd.effects.effect import AbstractEffect
from thermohyd.numerics import kept, require_float64
from thermohyd.small_systems import solved
from thermohyd.valve import Valve

from .equilibrium import equilibrium, scaling_of
from .inputs import StepInputs
from .integrate import FAILURES, NO_EQUILIBRIUM
from .machine import POSITION, Plant, State, Walls, plant_of, transducer_gain
from .vector_field import rates_at


Output = Literal["spool_position", "piston_velocity", "piston_position"]
OUTPUTS = ("spool_position", "piston_velocity", "piston_position")
# Frequencies that carry the phase from where it is 0 or 180 degrees up to the wanted ones; 0.3 % apart over six decades,
# so that even a resonance of damping 0.002 turns it by less than half a turn from one to the next.
LADDER = np.geomspace(1e-6, 1.0, 4096)


class FrequencyResponse(eqx.Module):
    """Response of small motions, arrays of shape (frequencies,).

    amplitude_ratio: of output to command, or relative to its low-frequency asymptote [-].
    phase [degrees], unwrapped from the lowest frequencies on. found: whether there is an equilibrium to linearise about.
    """

    amplitude_ratio: Float[Array, " frequencies"]
    phase: Float[Array, " frequencies"]
    found: Bool[Array, ""]


class Linearised(eqx.Module):
    """The linearised vector field x' = A x + b u, y = c x about an equilibrium, in the scaled state; u the command, without its delay."""

    matrix: Float[Array, "states states"]
    drive: Float[Array, " states"]
    read: Float[Array, " states"]

    def gain(self, pulsation: Float[Array, " frequencies"]) -> Array:
        """y/u at s = i omega, complex."""
        matrix, drive, read = (part.astype(complex) for part in (self.matrix, self.drive, self.read))
        s = 1j * pulsation.astype(complex)
        resolvent = s[:, None, None] * jnp.eye(matrix.shape[0], dtype=complex) - matrix
        moved = solved(resolvent, jnp.broadcast_to(drive, (*pulsation.shape, *drive.shape)))
        return jnp.sum(moved * read, axis=-1)


def refuse_without_response(effects: tuple[AbstractEffect, ...]) -> None:
    """Raise ValueError for an effect that passes no small motion at all, such as play."""
    for effect in effects:
        if not type(effect).small_signal:
            words = re.sub(r"(?<!^)(?=[A-Z])", "_", type(effect).__name__).lower()
            raise ValueError(f"{words} has no small-signal response: take it out, or use a step test")


def linearise(plant: Plant, output: Output) -> tuple[Linearised, Bool[Array, ""]]:
    """(the vector field linearised about the equilibrium of the first row, whether there is one)."""
    # About the operating point the command's last turn is no small motion: what goes with it stands still.
    plant = replace(plant, memory=None)
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


def _response(plant: Plant, frequency: Array, output: Output, absolute: bool) -> FrequencyResponse:
    linear, found = linearise(plant, output)
    wanted = 2.0 * jnp.pi * frequency
    gain = linear.gain(wanted)
    amplitude = jnp.abs(gain)
    if not absolute:
        amplitude = amplitude / jnp.abs(jnp.sum(linear.read * solved(linear.matrix, linear.drive)))
    wrapped = jnp.angle(gain)
    ladder = jax.lax.stop_gradient(jnp.max(wanted)) * LADDER
    climbed = jnp.unwrap(jnp.angle(jax.lax.stop_gradient(linear.gain(ladder))))
    near = jnp.interp(jax.lax.stop_gradient(jnp.log(wanted)), jnp.log(ladder), climbed)
    phase = wrapped + 2.0 * jnp.pi * jax.lax.stop_gradient(jnp.round((near - wrapped) / (2.0 * jnp.pi)))
    if plant.motion.spool_delay is not None:
        phase = phase - wanted * plant.motion.spool_delay
    return FrequencyResponse(amplitude, jnp.rad2deg(phase), found)


_compiled_response = kept(_response)


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
    heat: Heat | float = "adiabatic",
    walls: Walls | None = None,
    polarity: int = 1,
    throw: bool = True,
) -> FrequencyResponse:
    """Small-signal response of an output to the command, about the equilibrium of the first row of `inputs`.

    frequency [Hz]: (frequencies,), positive. output: "spool_position" [m], "piston_velocity" [m/s] or "piston_position" [m], per
    setpoint [m], current [A] or spool position [m]. absolute: the plain ratio, instead of that to the low-frequency asymptote.
    The linearisation is that of the very vector field that `simulate_step` integrates; a delay adds its phase. Friction acts
    with its slope at the equilibrium. It can be jitted, vmapped and differentiated like `simulate_step`.

    Raises ValueError with one sentence for an effect without a small-signal response (play), and for the ratio of a piston
    position in open loop, which has no asymptote; RuntimeError in single precision and, with `throw`, where there is no
    equilibrium. See docs/physics.md section 10.
    """
    require_float64("frequency_response")
    if output not in OUTPUTS:
        raise ValueError(f"output must be one of {', '.join(OUTPUTS)}, not {output!r}")
    if output == "piston_position" and inputs.kind != "setpoint" and not absolute:
        raise ValueError("a piston position in open loop has no low-frequency asymptote: ask for the absolute ratio")
    built = Walls() if walls is None else walls
    plant = plant_of(valve, actuator, inputs, heat=heat_of_chambers(heat), walls=built, polarity=polarity)
    refuse_without_response(valve.effects)
    frequency = jnp.asarray(frequency, dtype=jnp.result_type(float))
    # Within another program a program of its own would be differentiated by computing everything twice.
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((plant, frequency)))
    respond = _response if traced else _compiled_response
    response = cast(FrequencyResponse, respond(plant, frequency, output, absolute))
    if throw and not isinstance(response.found, Tracer) and not jnp.all(response.found):
        raise RuntimeError(FAILURES[NO_EQUILIBRIUM])
    return response


# rad/s, 0.45 % apart: a resonance of damping 0.003 still shows its crossings.
PULSATION = np.geomspace(1e-3, 1e5, 4096)
HALF_POWER = float(np.log(np.sqrt(0.5)))
HALVINGS = 40  # of an interval of 0.45 %


class LoopFigures(eqx.Module):
    """Small-signal figures of a position loop. gain_margin: the factor on the loop gain that brings it to its limit [-].

    phase_margin [deg], the smallest over all crossings of gain 1. phase_crossover, gain_crossover [rad/s]: where the two are
    read. bandwidth [rad/s]: where the closed loop has first fallen by 3 dB. peak: the largest magnitude of the closed loop [-],
    at peak_pulsation [rad/s] (0: it has no resonance above 1). What does not exist is NaN, a gain margin infinite.
    """

    gain_margin: Float[Array, "..."]
    phase_margin: Float[Array, "..."]
    phase_crossover: Float[Array, "..."]
    gain_crossover: Float[Array, "..."]
    bandwidth: Float[Array, "..."]
    peak: Float[Array, "..."]
    peak_pulsation: Float[Array, "..."]


class _Near(NamedTuple):
    """Where to look, in the order phase crossing, gain crossing, half power: interval of PULSATION, and whether there is one."""

    place: Array
    there: Array


def broken(closed: Linearised) -> Linearised:
    """From position error to position: the closed loop x' = A x + b z*, z = c x without its feedback, A + b c.

    What acts on the command ahead of the comparison, such as a delay of the setpoint column, is not in the loop.
    """
    return Linearised(closed.matrix + jnp.outer(closed.drive, closed.read), closed.drive, closed.read)


def loop_figures(opened: Linearised) -> tuple[LoopFigures, Complex[Array, " pulsations"]]:
    """(figures, open-loop response at PULSATION); the figures are differentiable, forward and reverse.

    Crossings are bracketed on the grid, halved down, and left by one Newton step: that step carries their derivatives.
    """
    still = jax.lax.stop_gradient(opened)
    curve = still.gain(jnp.asarray(PULSATION))
    near = _crossings(curve)
    found = _halved(still, near)
    peak_at, rises = _peak_place(curve)

    def measures(pulsation: Array) -> Array:
        return _measures(opened.gain(pulsation))

    held, ones = jax.lax.stop_gradient(found), jnp.ones_like(found)
    value, slope = jax.jvp(measures, (held,), (ones,))
    exact = held - value / jax.lax.stop_gradient(slope)
    # The peak moves along a flat top: its height changes as if it stayed in place.
    gain = opened.gain(jnp.append(exact, peak_at))
    there = lambda figure, i: jnp.where(near.there[i], figure, jnp.nan)
    figures = LoopFigures(
        gain_margin=jnp.where(near.there[0], 1.0 / jnp.abs(gain[0]), jnp.inf),
        phase_margin=there(jnp.rad2deg(jnp.angle(-gain[1])), 1),
        phase_crossover=there(exact[0], 0),
        gain_crossover=there(exact[1], 1),
        bandwidth=there(exact[2], 2),
        peak=jnp.where(rises, jnp.abs(gain[3] / (1.0 + gain[3])), 1.0),
        peak_pulsation=jnp.where(rises, peak_at, 0.0),
    )
    return figures, curve


def _measures(gain: Complex[Array, "3"]) -> Float[Array, "3"]:
    """What is 0 at a phase crossing, at gain 1 and at the closed loop's half power, each for its own pulsation."""
    closed = gain[2] / (1.0 + gain[2])
    return jnp.stack(
        [jnp.imag(gain[0]) / jnp.abs(gain[0]), jnp.log(jnp.abs(gain[1])), jnp.log(jnp.abs(closed)) - HALF_POWER]
    )


def _crossings(curve: Complex[Array, " pulsations"]) -> _Near:
    """Of several crossings, the phase crossing nearest to gain 1, the gain crossing nearest to -180 degrees, the first half power."""
    size, closed = jnp.log(jnp.abs(curve)), jnp.log(jnp.abs(curve / (1.0 + curve)))
    turned, real = jnp.imag(curve), jnp.real(curve)
    changes = lambda s: s[:-1] * s[1:] < 0.0
    opposed = changes(turned) & (real[:-1] + real[1:] < 0.0)
    unity, half = changes(size), (closed[:-1] >= HALF_POWER) & (closed[1:] < HALF_POWER)
    far = lambda there, distance: jnp.where(there, distance[:-1], jnp.inf)
    places = [
        jnp.argmin(far(opposed, jnp.abs(size))),
        jnp.argmin(far(unity, jnp.abs(jnp.angle(-curve)))),
        jnp.argmax(half),
    ]
    return _Near(jnp.stack(places), jnp.stack([jnp.any(opposed), jnp.any(unity), jnp.any(half)]))


def _halved(opened: Linearised, near: _Near) -> Float[Array, "3"]:
    """The three pulsations, each between its neighbours on the grid."""
    grid = jnp.asarray(PULSATION)
    low, high = grid[near.place], grid[near.place + 1]
    sign = jnp.sign(_measures(opened.gain(low)))

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        before = jnp.sign(_measures(opened.gain(middle))) == sign
        return jnp.where(before, middle, low), jnp.where(before, high, middle)

    low, high = jax.lax.fori_loop(0, HALVINGS, halve, (low, high))
    return 0.5 * (low + high)


def _peak_place(curve: Complex[Array, " pulsations"]) -> tuple[Float[Array, ""], Array]:
    """(pulsation of the closed loop's peak by a parabola through three points, whether it rises above 1 at all)."""
    height = jnp.log(jnp.abs(curve / (1.0 + curve)))
    top = jnp.clip(jnp.argmax(height), 1, PULSATION.size - 2)
    before, highest, after = height[top - 1], height[top], height[top + 1]
    bend = before - 2.0 * highest + after
    moved = jnp.clip(0.5 * (before - after) / jnp.where(bend < 0.0, bend, -1.0), -0.5, 0.5)
    spacing = float(np.log(PULSATION[1] / PULSATION[0]))
    # Far below the loop's own dynamics, rounding alone lifts the magnitude above 1.
    return jnp.asarray(PULSATION)[top] * jnp.exp(moved * spacing), highest > 1e-6
