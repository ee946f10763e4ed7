"""Step tests with derivatives: the runs of a record in one program, its readings and their slopes in a vector of names."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from thermohyd.actuator import Actuator
from thermohyd.compiling import quickly
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.inputs import StepInputs
from thermohyd.dynamics.integrate import NO_EQUILIBRIUM, integrate
from thermohyd.dynamics.plant import Heat, Plant, plant_of, transducer_gain
from thermohyd.dynamics.state import State
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
    tolerance: float = eqx.field(static=True, default=TOLERANCE)

    def plant(self, p: Float[Array, " all"], given: Given, inputs: StepInputs) -> Plant:
        valve, actuator = machine(given.valve, given.actuator, self.names, self.effects, p)
        return plant_of(valve, actuator, inputs, heat=self.heat, walls=Walls(), polarity=given.polarity)


def _read(state: State, valve: Valve) -> Float[Array, " readings"]:
    return jnp.stack(
        [state.spool / transducer_gain(valve), state.pressure[0], state.pressure[1], state.position, state.velocity]
    )


@quickly
def readings_and_slopes(
    plan: Plan, p: Float[Array, " all"], given: Given, inputs: StepInputs
) -> tuple[Float[Array, "runs rows readings"], Float[Array, "runs rows readings all"], Int[Array, " runs"]]:
    """(readings in the order of READINGS, SI; their derivatives to the vector; an index into `integrate.FAILURES`)."""

    def read(q: Array, inputs: StepInputs) -> tuple[Array, tuple[Array, Array]]:
        plant = plan.plant(q, given, inputs)
        scaling = scaling_of(plant, plant.surroundings(inputs.time[0]))
        start, found = equilibrium(plant, scaling, inputs.time[0])
        rtol = atol = plan.tolerance
        run = integrate(plant, scaling, start, gradient="forward", rtol=rtol, atol=atol, max_steps=MOST_STEPS)
        readings = jax.vmap(lambda state: _read(state, plant.valve))(run.states)
        return readings, (readings, jnp.where(found, run.failure, NO_EQUILIBRIUM))

    def one(inputs: StepInputs) -> tuple[Array, Array, Array]:
        slopes, (readings, failure) = jax.jacfwd(lambda q: read(q, inputs), has_aux=True)(p)
        return readings, slopes, failure

    return jax.vmap(one)(inputs)
