"""The position loop over oil temperature: step responses and margins, each by one compiled program for all temperatures.

Also how much more a valve passes per opening away from null than at null: what large motions take from a loop's gain margin.
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Real

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import with_heat, without_instruments
from thermohyd.arguments import Heat, heat_of_chambers
from thermohyd.conditions import Conditions
from thermohyd.numerics import kept, quickly, require_float64
from thermohyd.static_tests import control_flow
from thermohyd.valve import Valve

from .inputs import StepInputs, step_inputs
from .integrate import FAILURES, NO_EQUILIBRIUM
from .linear import PULSATION, LoopFigures, broken, linearise, loop_figures, refuse_without_response
from .machine import Walls, plant_of
from .simulate import StepFigures, StepReadings, simulate_step, step_figures


RTOL = 1e-7  # leaves 3e-5 of a reading's range where the piston sticks and slips, 2e-6 elsewhere
ROWS = 1200
RAMP = 1e-3  # s, in which the setpoint steps
SHORTEST, LONGEST, LIFETIMES = 0.2, 60.0, 8.0  # s, s, time constants: how long a run lasts unless it is told
FIRST_SPACING = 2.5e-4  # s, of the rows


class LoopSweep(eqx.Module):
    """The loop linearised at every temperature (temperatures,) [K]; see `LoopFigures`.

    slope: the figures' derivatives per kelvin, exact. opened: z/(z* - z) at `pulsation` [rad/s], the loop broken at the
    position feedback, (temperatures, pulsations), complex. poles of the closed loop [1/s], (temperatures, states), complex.
    stable: whether all of them decay; where they do not, margins say how far from stability the loop is.
    """

    temperature: Float[Array, " temperatures"]
    figures: LoopFigures
    slope: LoopFigures
    opened: Complex[Array, "temperatures pulsations"]
    poles: Complex[np.ndarray, "temperatures states"]
    delay: Float[Array, ""]

    @property
    def pulsation(self) -> np.ndarray:
        return PULSATION

    @property
    def closed(self) -> np.ndarray:
        """z/z*: L/(1 + L), later by the delay of the setpoint where the valve has one."""
        opened = np.asarray(self.opened)
        return opened / (1.0 + opened) * np.exp(-1j * PULSATION * float(self.delay))

    @property
    def stable(self) -> np.ndarray:
        return np.max(np.real(self.poles), axis=1) < 0.0


class StepSweep(NamedTuple):
    """Step responses at every temperature [K]: readings of shape (temperatures, rows) from the start of the step, which is
    `step` [m] large, and figures of shape (temperatures,).

    largest_pressure: in either chamber [Pa]. heating: largest rise of a chamber's oil above the oil supplied [K].
    """

    temperature: np.ndarray
    step: float
    readings: StepReadings
    figures: StepFigures
    largest_pressure: np.ndarray
    heating: np.ndarray


@quickly
def _linear(
    valve: Valve, actuator: Actuator, inputs: StepInputs, temperature: Array, heat: Heat
) -> tuple[LoopFigures, LoopFigures, tuple[Array, Array, Bool[Array, " temperatures"], Array]]:
    """(figures, slopes, (open loop, matrix of the closed one, found, delay)), temperatures leading."""

    def at(kelvin: Array) -> tuple[LoopFigures, tuple[Array, Array, Array, Array]]:
        start = inputs.surroundings.start.at[2].set(kelvin)
        warm = eqx.tree_at(lambda i: i.surroundings.start, inputs, start)
        plant = plant_of(valve, actuator, warm, heat=heat, walls=Walls(), polarity=1)
        closed, found = linearise(plant, "piston_position")
        figures, opened = loop_figures(broken(closed))
        delay = plant.motion.spool_delay
        late = jnp.zeros(()) if delay is None else jnp.asarray(delay)
        return figures, (opened, closed.matrix, found, late)

    def with_slope(kelvin: Array) -> tuple:
        return jax.jvp(at, (kelvin,), (jnp.ones_like(kelvin),), has_aux=True)

    return jax.vmap(with_slope)(temperature)


def loop_sweep(
    valve: Valve,
    actuator: Actuator,
    temperatures: Sequence[float] | Real[np.ndarray, " temperatures"] | Float[Array, " temperatures"],
    *,
    supply_pressure: float,
    return_pressure: float = 0.0,
    heat: Heat | float = "adiabatic",
) -> LoopSweep:
    """Margins, bandwidth and peak of the position loop at rest about mid stroke, at temperatures [K], with d/dT.

    They are those of the very equations that `simulate_step` integrates, linearised: spool, effects, heat in the chambers,
    external force and dry friction with its slope at rest included, unlike in `loop_margins`. A `spool_delay` shifts the
    setpoint (docs/physics.md section 10) and so stays outside the loop. Pressures in Pa, gauge.

    Raises ValueError for an effect without a small-signal response (play), and RuntimeError in single precision and where a
    temperature has no equilibrium.
    """
    require_float64("loop_sweep")
    refuse_without_response(valve.effects)
    warm = jnp.asarray(temperatures, dtype=jnp.result_type(float))
    inputs = step_inputs(
        np.array([0.0, 1.0]), 0.0, "setpoint",
        supply_pressure=supply_pressure, return_pressure=return_pressure, temperature=300.0,
    )  # fmt: skip
    figures, slope, (opened, matrix, found, delay) = cast(
        tuple, _linear(valve, actuator, inputs, warm, heat_of_chambers(heat))
    )
    _require(np.where(np.asarray(found), 0, NO_EQUILIBRIUM), np.asarray(warm))
    return LoopSweep(warm, figures, slope, opened, np.linalg.eigvals(np.asarray(matrix)), delay[0])


@quickly
def _runs(
    valve: Valve, actuator: Actuator, inputs: StepInputs, heat: Heat, rtol: Array, max_steps: int
) -> StepReadings:
    """Readings of stacked inputs, runs leading."""
    one = lambda row: simulate_step(
        valve, actuator, row, heat=heat, rtol=rtol, atol=rtol, max_steps=max_steps, throw=False
    )
    return jax.vmap(one)(inputs)


def step_sweep(
    valve: Valve,
    actuator: Actuator,
    temperatures: Sequence[float] | Real[np.ndarray, " temperatures"] | Float[Array, " temperatures"],
    *,
    supply_pressure: float,
    return_pressure: float = 0.0,
    heat: Heat | float = "adiabatic",
    step: float,
    seconds: float | Real[np.ndarray, " temperatures"],
    rows: int = ROWS,
    rtol: float = RTOL,
    max_steps: int = 100_000,
) -> StepSweep:
    """Step responses of the position loop from rest at mid stroke, at temperatures [K] of the oil supplied.

    step [m]: the setpoint's, within 1 ms. seconds: how long to run, one number or one per temperature; see `run_lengths`.
    rows: of the readings, 0.25 ms apart at first and further apart later where the run is long. Pressures in Pa, gauge.

    Raises ValueError for a step that is nothing, and RuntimeError in single precision and where a run fails.
    """
    if not (np.isfinite(step) and step != 0.0):
        raise ValueError(f"a step must be finite and not zero, not {step!r}")
    warm = np.asarray(temperatures, dtype=float)
    runs = []
    for kelvin, length in zip(warm, np.broadcast_to(np.asarray(seconds, dtype=float), warm.shape), strict=True):
        time = _rows(float(length), rows)
        setpoint = np.interp(time, [0.0, RAMP], [0.0, step])
        own = step_inputs(
            time, setpoint, "setpoint",
            supply_pressure=supply_pressure, return_pressure=return_pressure, temperature=float(kelvin),
        )  # fmt: skip
        runs.append(own)
    stacked = jax.tree.map(lambda *parts: jnp.stack(parts), *runs)
    readings = cast(StepReadings, _runs(valve, actuator, stacked, heat_of_chambers(heat), jnp.asarray(rtol), max_steps))
    _require(np.asarray(readings.failure), warm)
    time, position = np.asarray(readings.time), np.asarray(readings.piston_position)
    figures = [step_figures(*run, step) for run in zip(time, position, strict=True)]
    pressures = np.stack([readings.pressure_a, readings.pressure_b])
    chambers = np.stack([readings.temperature_a, readings.temperature_b])
    return StepSweep(
        temperature=warm,
        step=step,
        readings=readings,
        figures=StepFigures(*np.array(figures).T),
        largest_pressure=np.max(pressures, axis=(0, 2)),
        heating=np.max(chambers, axis=(0, 2)) - warm,
    )


def run_lengths(loop: LoopSweep) -> np.ndarray:
    """Seconds (temperatures,) in which a step settles: eight time constants of the loop, between 0.2 and 60 s."""
    crossover = np.asarray(loop.figures.gain_crossover)
    return np.clip(LIFETIMES / np.where(crossover > 0.0, crossover, LIFETIMES / LONGEST), SHORTEST, LONGEST)


def _rows(seconds: float, rows: int) -> np.ndarray:
    """Times from 0 to `seconds`, the end of the ramp among them: even, or ever further apart where that takes fewer rows."""
    share = np.linspace(0.0, 1.0, rows - 1)
    low, high = 0.0, 40.0
    if seconds > FIRST_SPACING * (rows - 2):
        for _ in range(60):
            rate = 0.5 * (low + high)
            first = seconds * np.expm1(rate * share[1]) / np.expm1(rate)
            low, high = (rate, high) if first > FIRST_SPACING else (low, rate)
        share = np.expm1(high * share) / np.expm1(high)
    return np.unique(np.append(seconds * share, RAMP))


def _require(failure: np.ndarray, temperature: np.ndarray) -> None:
    """Raise RuntimeError for the first temperature that failed."""
    for kelvin, code in zip(temperature, failure, strict=True):
        if code:
            raise RuntimeError(f"{FAILURES[int(code)]} (at {kelvin - 273.15:.4g} degC)")


OPENINGS = np.geomspace(1e-3, 1.0, 48)  # of the stroke


def largest_gain_rise(
    valve: Valve,
    temperatures: Sequence[float] | Real[np.ndarray, " temperatures"] | Float[Array, " temperatures"],
    *,
    supply_pressure: float,
    return_pressure: float = 0.0,
    heat: Heat | float = "adiabatic",
) -> np.ndarray:
    """Largest flow per opening Q(x)/x over the stroke as a factor of that at null, at temperatures [K]; 1 where null is steepest.

    To a motion of amplitude x a symmetric flow curve that bends upwards has a gain (its describing function) between Q'(0)
    and the largest Q(x)/x. The gain margin at null divided by this factor is what is left for any amplitude: below 1 a
    loop that is stable at rest may keep swinging once moved. Without load, spool clipped at its stroke; pressures in Pa.
    """
    require_float64("largest_gain_rise")
    warm = np.asarray(temperatures, dtype=float)
    bare = with_heat(without_instruments(valve), heat)
    opening = np.tile(OPENINGS, warm.size) * float(valve.stroke)
    full = lambda value: jnp.full(opening.size, float(value))
    conditions = Conditions(
        jnp.asarray(opening), full(supply_pressure), full(return_pressure), jnp.asarray(warm.repeat(OPENINGS.size))
    )
    gain = (np.asarray(_flow(bare, conditions)) / opening).reshape(warm.size, OPENINGS.size)
    return np.max(gain, axis=1) / gain[:, 0]


@kept
def _flow(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    return control_flow(valve, conditions)
