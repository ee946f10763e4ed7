"""The plant of one run: valve, oil, jack and loop with their effects, gathered once so that a step only evaluates it."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..actuator import Actuator
from ..conditions import Conditions
from ..edge import MeteringEdge
from ..effect import AbstractConditionEffect, Coupling
from ..oil import Oil, OilAtTemperature, at_temperature
from ..valve import Valve, coupling, metering_edges, true_oil
from .inputs import Kind, StepInputs
from .motion import Motion, motion_of
from .walls import Walls


Heat = Literal["adiabatic", "isothermal"]


class Surroundings(eqx.Module):
    """What acts from outside at one time: P_s, P_t [Pa, gauge], true temperature T_s [K] of the oil supplied, F_e [N]."""

    supply_pressure: Float[Array, ""]
    return_pressure: Float[Array, ""]
    temperature: Float[Array, ""]
    external_force: Float[Array, ""]


class Supplied(eqx.Module):
    """What follows from the temperature of the oil supplied: the oil itself, the edges, the paths between the ports.

    edges: fields of shape (2, 1), the edges from the supply and to the return. crossing: conductance [m3/(s Pa)] or None.
    """

    oil: OilAtTemperature
    edges: MeteringEdge
    crossing: Float[Array, "..."] | None


class Plant(eqx.Module):
    """Everything that the vector field needs beside the state and the time.

    keeps_heat: chambers have temperatures of their own (THM, or walls); else all oil is at T_s (HM).
    supplied: None where the temperature varies, so that it must be found at every time.
    """

    valve: Valve
    actuator: Actuator
    motion: Motion
    oil: Oil
    coupling: Coupling
    walls: Walls
    inputs: StepInputs
    supplied: Supplied | None
    keeps_heat: bool = eqx.field(static=True)
    polarity: Float[Array, ""]

    @property
    def kind(self) -> Kind:
        return self.inputs.kind

    def surroundings(self, time: Float[Array, ""]) -> Surroundings:
        supply, back, temperature, force = self.inputs.surroundings.at(time)
        return Surroundings(supply, back, temperature, force if self.inputs.forced else self.actuator.external_force)

    def at(self, surroundings: Surroundings) -> Supplied:
        return supplied_at(self.valve, self.oil, surroundings) if self.supplied is None else self.supplied

    def command(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return self.inputs.command.at(time)[0]


def _true_temperature(valve: Valve, temperature: Float[Array, ""]) -> Float[Array, ""]:
    """T_s behind what the thermometer reads."""
    return _seen(valve, jnp.zeros(()), temperature).temperature[0]


def _seen(valve: Valve, position: Float[Array, ""], temperature: Float[Array, ""]) -> Conditions:
    zero = jnp.zeros(1)
    # Without direction and rate, the effects of a sweep leave the position alone.
    read = Conditions(position[None], zero, zero, temperature[None], direction=zero, rate=zero)
    true = read
    for effect in valve.effects:
        if isinstance(effect, AbstractConditionEffect):
            true = effect.true_conditions(true, read)
    return true


def transducer_gain(valve: Valve) -> Float[Array, ""]:
    """True motion of the spool per motion that its transducer reads; 1 without an effect on it."""
    room = jnp.asarray(300.0, dtype=jnp.result_type(float))
    one, zero = (_seen(valve, jnp.asarray(x, dtype=jnp.result_type(float)), room).position[0] for x in (1.0, 0.0))
    return one - zero


def supplied_at(valve: Valve, oil: Oil, around: Surroundings) -> Supplied:
    """Oil, edges and paths at the temperature of the oil supplied."""
    zero = jnp.zeros(1)
    conditions = Conditions(zero, around.supply_pressure[None], around.return_pressure[None], around.temperature[None])
    pairs = metering_edges(valve, conditions)
    crossings = [path.conductance(oil, conditions) for path in coupling(valve).crossings]
    return Supplied(
        oil=at_temperature(oil, around.temperature),
        edges=jax.tree.map(_as_pair, pairs.supply, pairs.return_),
        crossing=jnp.sum(sum(crossings, start=jnp.zeros(1))) if crossings else None,
    )


def _as_pair(supply: Float[Array, "..."], return_: Float[Array, "..."]) -> Float[Array, "2 1"]:
    return jnp.stack([jnp.reshape(supply, (1,)), jnp.reshape(return_, (1,))])


def plant_of(
    valve: Valve, actuator: Actuator, inputs: StepInputs, *, heat: Heat, walls: Walls, polarity: int | Array
) -> Plant:
    """The plant of one run; instruments' errors undone, the delay taken up by the command's knots."""
    oil, motion = true_oil(valve), motion_of(actuator, valve.effects)
    shift = (
        jnp.zeros(4).at[2].set(_true_temperature(valve, inputs.surroundings.start[2]) - inputs.surroundings.start[2])
    )
    inputs = eqx.tree_at(lambda i: i.surroundings.start, inputs, inputs.surroundings.start + shift)
    if motion.spool_delay is not None:
        inputs = eqx.tree_at(lambda i: i.command, inputs, inputs.command.shifted(motion.spool_delay))
    if motion.wall_heat is not None:
        walls = walls.plus(motion.wall_heat)
    steady = inputs.surroundings.knots.shape[-1] == 0
    first = Surroundings(*inputs.surroundings.start)
    return Plant(
        valve=valve,
        actuator=actuator,
        motion=motion,
        oil=oil,
        coupling=coupling(valve),
        walls=walls,
        inputs=inputs,
        supplied=supplied_at(valve, oil, first) if steady else None,
        keeps_heat=heat == "adiabatic",
        polarity=jnp.asarray(polarity, dtype=jnp.result_type(float)),
    )
