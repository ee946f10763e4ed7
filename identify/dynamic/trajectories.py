"""Step tests with derivatives: the run as the simulator takes it, then its sensitivities along that run.

Sensitivities s = dx/dp obey s' = (df/dx) s + df/dp. Once the run is known they are linear, so df/dx and df/dp are taken at
all points of a grid at once (forward mode), every piece of the grid becomes one small matrix (Lobatto IIIA of order 4:
A-stable, ends and middle of the piece), and a recursion carries s along. Carrying the tangents through the solver itself,
which differentiates its Jacobian, gives the same to a per cent of a parameter's effect at thirty times the cost.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.actuator import Actuator
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.inputs import StepInputs
from thermohyd.dynamics.integrate import NO_EQUILIBRIUM, integrate
from thermohyd.dynamics.plant import Heat, Plant, plant_of, transducer_gain
from thermohyd.dynamics.quick import quickly
from thermohyd.dynamics.state import Scaling, State
from thermohyd.dynamics.vector_field import vector_field
from thermohyd.dynamics.walls import Walls
from thermohyd.valve import Valve

from .machine import machine


READINGS = ("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity")
# A hundred times looser than the simulator's own: a thousandth of what a transducer's noise allows, in a third of the steps.
TOLERANCE = 1e-6
MOST_STEPS = 20_000


class Given(eqx.Module):
    """What a run is made of beside the vector of parameters and amounts."""

    valve: Valve
    actuator: Actuator
    polarity: Float[Array, ""]


class Plan(eqx.Module):
    """Names of the vector's entries, and how the chambers keep heat: all that a compiled program depends on."""

    names: tuple[str, ...] = eqx.field(static=True)
    effects: tuple[str, ...] = eqx.field(static=True)
    heat: Heat = eqx.field(static=True)

    def plant(self, p: Float[Array, " all"], given: Given, inputs: StepInputs) -> Plant:
        valve, actuator = machine(given.valve, given.actuator, self.names, self.effects, p)
        return plant_of(valve, actuator, inputs, heat=self.heat, walls=Walls(), polarity=given.polarity)


def _scaling(plant: Plant) -> Scaling:
    return scaling_of(plant, plant.surroundings(plant.inputs.time[0]))


def _read(state: State, valve: Valve) -> Float[Array, " readings"]:
    return jnp.stack(
        [state.spool / transducer_gain(valve), state.pressure[0], state.pressure[1], state.position, state.velocity]
    )


@quickly
def run_all(
    plan: Plan, p: Float[Array, " all"], given: Given, inputs: StepInputs
) -> tuple[Float[Array, "runs points states"], Array]:
    """(scaled states at the grid's points, failure of each run: an index into `integrate.FAILURES`)."""

    def one(inputs: StepInputs) -> tuple[Array, Array]:
        plant = plan.plant(p, given, inputs)
        scaling = _scaling(plant)
        start, found = equilibrium(plant, scaling, inputs.time[0])
        run = integrate(plant, scaling, start, gradient="forward", rtol=TOLERANCE, atol=TOLERANCE, max_steps=MOST_STEPS)
        return jax.vmap(scaling.pack)(run.states), jnp.where(found, run.failure, NO_EQUILIBRIUM)

    return jax.vmap(one)(inputs)


@quickly
def read_all(
    plan: Plan, p: Float[Array, " all"], given: Given, inputs: StepInputs, states: Float[Array, "runs rows states"]
) -> Float[Array, "runs rows readings"]:
    """Readings of scaled states, in the order of READINGS, SI."""

    def one(inputs: StepInputs, rows: Array) -> Array:
        plant = plan.plant(p, given, inputs)
        scaling = _scaling(plant)
        return jax.vmap(lambda row: _read(scaling.unpack(row), plant.valve))(rows)

    return jax.vmap(one)(inputs, states)


@quickly
def slopes_all(
    plan: Plan,
    p: Float[Array, " all"],
    given: Given,
    inputs: StepInputs,
    states: Float[Array, "runs points states"],
    every: int,
) -> Float[Array, "runs rows readings all"]:
    """Derivatives of the readings at the rows, every `every`-th point of the grid, to the vector."""

    def one(inputs: StepInputs, points: Array) -> Array:
        scaling = _scaling(plan.plant(p, given, inputs))
        times = inputs.time

        def field(x: Array, q: Array, time: Array) -> Array:
            plant = plan.plant(q, given, inputs)
            return scaling.pack_rates(vector_field(plant, time, scaling.unpack(x)))

        def start(q: Array) -> Array:
            return scaling.pack(equilibrium(plan.plant(q, given, inputs), scaling, times[0])[0])

        to_state = jax.vmap(lambda x, time: jax.jacfwd(field)(x, p, time))(points, times)
        to_vector = jax.vmap(lambda x, time: jax.jacfwd(field, 1)(x, p, time))(points, times)
        carried = _carry(times, to_state, to_vector, jax.jacfwd(start)(p))[:: every // 2]

        def reading(x: Array, q: Array) -> Array:
            return _read(scaling.unpack(x), plan.plant(q, given, inputs).valve)

        def row(x: Array, s: Array) -> Array:
            return jax.jacfwd(reading)(x, p) @ s + jax.jacfwd(reading, 1)(x, p)

        return jax.vmap(row)(points[::every], carried)

    return jax.vmap(one)(inputs, states)


def _carry(
    times: Float[Array, " points"],
    a: Float[Array, "points states states"],
    b: Float[Array, "points states all"],
    start: Float[Array, "states all"],
) -> Float[Array, "ends states all"]:
    """s at the ends of the pieces, two steps of the grid each: s' = a s + b by Lobatto IIIA with three stages."""
    h = (times[2::2] - times[:-1:2])[:, None, None]
    a0, am, a1 = a[:-1:2], a[1::2], a[2::2]
    b0, bm, b1 = b[:-1:2], b[1::2], b[2::2]
    n = a.shape[-1]
    eye = jnp.eye(n)
    left = eye - h / 6.0 * a1 - 2.0 * h / 3.0 * (am @ (0.5 * eye - h / 8.0 * a1))
    right = eye + h / 6.0 * a0 + 2.0 * h / 3.0 * (am @ (0.5 * eye + h / 8.0 * a0))
    pushed = h / 6.0 * (b0 + b1) + 2.0 * h / 3.0 * (bm + am @ (h / 8.0 * (b0 - b1)))
    solved = jnp.linalg.solve(left, jnp.concatenate([right, pushed], axis=-1))

    def onward(s: Array, piece: Array) -> tuple[Array, Array]:
        s = piece[:, :n] @ s + piece[:, n:]
        return s, s

    _, ends = jax.lax.scan(onward, start, solved)
    return jnp.concatenate([start[None], ends])
