"""The position loop broken at its feedback: margins, bandwidth and peak, differentiable, from the linearised vector field."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from .small_signal import Linearised


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
    before, at, after = height[top - 1], height[top], height[top + 1]
    bend = before - 2.0 * at + after
    moved = jnp.clip(0.5 * (before - after) / jnp.where(bend < 0.0, bend, -1.0), -0.5, 0.5)
    spacing = float(np.log(PULSATION[1] / PULSATION[0]))
    # Far below the loop's own dynamics, rounding alone lifts the magnitude above 1.
    return jnp.asarray(PULSATION)[top] * jnp.exp(moved * spacing), at > 1e-6
