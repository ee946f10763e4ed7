"""Simulate a step test of an actuator, readings at a record's rows (docs/physics.md section 9), and measure rise, settling, overshoot."""

from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int, Real

from thermohyd.actuator import Actuator
from thermohyd.arguments import Heat, heat_of_chambers
from thermohyd.numerics import kept, require_float64
from thermohyd.valve import Valve

from .equilibrium import equilibrium, scaling_of
from .inputs import StepInputs
from .integrate import FAILURES, NO_EQUILIBRIUM, Gradient, integrate
from .machine import Walls, plant_of, transducer_gain


RTOL, ATOL = 3e-9, 3e-9
MAX_STEPS = 100_000


class StepReadings(eqx.Module):
    """What a step test reads, one entry per row, SI units; pressures gauge.

    temperature_a, temperature_b: the oil's in the chambers [K], T_s where the run is isothermal. steps: the solver took.
    failure: an index into `thermohyd.dynamics.integrate.FAILURES`, 0 for none; readings of a failed run are NaN.
    """

    time: Float[Array, " rows"]
    spool_position: Float[Array, " rows"]
    pressure_a: Float[Array, " rows"]
    pressure_b: Float[Array, " rows"]
    piston_position: Float[Array, " rows"]
    piston_velocity: Float[Array, " rows"]
    temperature_a: Float[Array, " rows"]
    temperature_b: Float[Array, " rows"]
    steps: Int[Array, ""]
    failure: Int[Array, ""]


@kept
def simulated(
    valve: Valve,
    actuator: Actuator,
    inputs: StepInputs,
    walls: Walls,
    rtol: Array,
    atol: Array,
    polarity: Array,
    heat: Heat,
    gradient: Gradient,
    max_steps: int,
    solver: Any = None,
) -> StepReadings:
    plant = plant_of(valve, actuator, inputs, heat=heat, walls=walls, polarity=polarity)
    first = inputs.time[0]
    scaling = scaling_of(plant, plant.surroundings(first))
    start, found = equilibrium(plant, scaling, first)
    run = integrate(plant, scaling, start, gradient=gradient, rtol=rtol, atol=atol, max_steps=max_steps, solver=solver)
    failure = jnp.where(found, run.failure, NO_EQUILIBRIUM)
    good = failure == 0
    states = run.states
    if states.temperature is None:
        supplied = jax.vmap(lambda time: plant.surroundings(time).temperature)(inputs.time)
        warm = jnp.stack([supplied, supplied], axis=1)
    else:
        warm = states.temperature
    readings = (
        states.spool / transducer_gain(valve),
        states.pressure[:, 0],
        states.pressure[:, 1],
        states.position,
        states.velocity,
        warm[:, 0],
        warm[:, 1],
    )
    shown = (jnp.where(good, reading, jnp.nan) for reading in readings)
    return StepReadings(inputs.time, *shown, steps=run.steps, failure=failure)


def checked_heat(
    caller: str, *, heat: Heat | float, walls: Walls | None, polarity: int | Array, gradient: Gradient = "forward"
) -> Heat:
    """The word for `heat`. Raises RuntimeError in single precision, ValueError for a choice that does not exist."""
    require_float64(caller)
    heat = heat_of_chambers(heat)
    if gradient not in ("forward", "reverse"):
        raise ValueError(f'gradient must be "forward" or "reverse", not {gradient!r}')
    if not isinstance(polarity, Tracer) and polarity not in (1, -1):
        raise ValueError(f"polarity must be 1 or -1, not {polarity!r}")
    if heat == "isothermal" and walls is not None:
        raise ValueError('walls exchange heat with adiabatic chambers only: leave them out, or set heat = "adiabatic"')
    return heat


def simulate_step(
    valve: Valve,
    actuator: Actuator,
    inputs: StepInputs,
    *,
    heat: Heat | float = "adiabatic",
    walls: Walls | None = None,
    polarity: int | Array = 1,
    gradient: Gradient = "forward",
    rtol: float | Array = RTOL,
    atol: float | Array = ATOL,
    max_steps: int = MAX_STEPS,
    throw: bool = True,
) -> StepReadings:
    """Run the actuator on the valve through a step test; readings at the rows of `inputs` (docs/physics.md section 9).

    inputs: from `step_inputs`. heat: "adiabatic" or 1 (THM: chambers keep their heat, but for what `walls` take), "isothermal"
    or 0 (HM: all oil at T_s). polarity: +1 or -1, of an open-loop current. Effects of the valve act where they make sense:
    static ones on edges, oil, lines and paths, a gauge's on the reading of the spool, dynamic ones (`DYNAMIC_EFFECTS`) here only.
    The run starts in equilibrium under the first row; see `equilibrium`.

    It can be jitted, vmapped (inputs stacked, with equal `knots`) and differentiated in every array of valve, actuator,
    walls and inputs but the rows' times: gradient = "forward" for `jax.jvp` and `jax.jacfwd` (few parameters), "reverse" for
    `jax.grad` and `jax.jacrev` (many). The start is differentiated as the root that it is. Forward, the variational equations
    are solved along the run (`sensitivity`): ten parameters cost 2 to 4 runs. Reverse differentiates the steps that were taken.
    Derivatives are less exact than readings where edges open and close slowly: on a position servo at 1e-6 within 1.4e-2 of the
    largest derivative (3e-3 in nine rows of ten), at 1e-7 2e-3, at 1e-8 2e-4, much the same either way.

    rtol, atol: of the state scaled to order 1 (stroke, a tenth of the supply pressure, free speed, 10 K). Largest error of any
    reading as a share of its range, and steps, on the conformance records of 0.4 s (rtol = atol; reference at 1e-11):

        tolerance    closed loop      open loop        stick-slip (Stribeck)
        1e-5         1.0e-4   288     1.7e-4   482     1.9e-3   919
        1e-6         7.5e-6   477     1.5e-5   750     1.4e-4  1310
        1e-7         4.4e-7   740     1.7e-6  1089     2.9e-5  1902
        1e-8         1.2e-7  1087     2.5e-7  1575     3.5e-6  2822
        1e-9         3.8e-9  1635     2.2e-8  2342     2.7e-7  4233

    The default leaves 1e-5 of the range even where the piston sticks and slips; 1e-6 does for smooth motions. Raises RuntimeError with one
    sentence in single precision and, with `throw`, where there is no equilibrium or the integration fails; where the call is
    traced, `failure` says so and the readings are NaN. Raises ValueError for a choice that does not exist.
    """
    heat = checked_heat("simulate_step", heat=heat, walls=walls, polarity=polarity, gradient=gradient)
    # Arrays, not numbers: those would be compiled in.
    as_array = lambda value: jnp.asarray(value, dtype=jnp.result_type(float))
    readings = cast(
        StepReadings,
        simulated(
            valve,
            actuator,
            inputs,
            Walls() if walls is None else walls,
            as_array(rtol),
            as_array(atol),
            as_array(polarity),
            heat,
            gradient,
            max_steps,
        ),
    )
    if throw and not isinstance(readings.failure, Tracer) and jnp.any(readings.failure != 0):
        raise RuntimeError(FAILURES[int(jnp.max(readings.failure))])
    return readings


BAND = 0.02  # of the step: settled within it
STAYS = 0.9  # of the run: what is not settled by then may only be passing through the band


class StepFigures(NamedTuple):
    """What a step response is judged by.

    rise_time: from 10 to 90 % of the step [s]; time_to_90 [s] and settling_time [s], to stay within 2 %, from its start.
    overshoot: beyond the step, as a share of it. swing: from lowest to highest in the last tenth of the run, as a share of the
    step: how much it still moves. NaN for what the run does not reach. Shape (), or that of several runs.
    """

    rise_time: np.ndarray
    time_to_90: np.ndarray
    settling_time: np.ndarray
    overshoot: np.ndarray
    swing: np.ndarray


def step_figures(time: Real[np.ndarray, " rows"], position: Real[np.ndarray, " rows"], step: float) -> StepFigures:
    """Figures of a response that leaves `position[0]` at `time[0]`, when a setpoint step of this size begins; SI units.

    The step counts from where the piston stood: a steady load moves it before and after alike. Between rows, lines.

    >>> time = np.linspace(0.0, 10.0, 10_001)
    >>> [round(float(figure), 3) for figure in step_figures(time, 2.0 - 2.0 * np.exp(-time), 2.0)]
    [2.197, 2.303, 3.912, 0.0, 0.0]
    """
    time, share = np.asarray(time, dtype=float), (np.asarray(position, dtype=float) - position[0]) / step
    began = time - time[0]
    first, last = _first_above(began, share, 0.1), _first_above(began, share, 0.9)
    overshoot = max(float(np.max(share)) - 1.0, 0.0)
    swing = float(np.ptp(share[began > STAYS * began[-1]]))
    figures = (last - first, last, _settled(began, share), overshoot, swing)
    return StepFigures(*(np.asarray(figure) for figure in figures))


def _first_above(time: np.ndarray, share: np.ndarray, level: float) -> float:
    above = np.flatnonzero(share >= level)
    if above.size == 0 or above[0] == 0:
        return float("nan")
    return _between(time, share, int(above[0]), level)


def _settled(time: np.ndarray, share: np.ndarray) -> float:
    """When the share last enters the band around 1."""
    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    if outside.size == 0 or time[outside[-1]] > STAYS * time[-1]:
        return float("nan")
    row = int(outside[-1]) + 1
    return _between(time, share, row, 1.0 + BAND * float(np.sign(share[row - 1] - 1.0)))


def _between(time: np.ndarray, share: np.ndarray, row: int, level: float) -> float:
    """When the line from the row before reaches the level."""
    part = (level - share[row - 1]) / (share[row] - share[row - 1])
    return float(time[row - 1] + part * (time[row] - time[row - 1]))
