"""What an effect may add to the circuit of an actuator in motion, place by place, from what it sees of the state.

A stage of its own beside `Motion`'s fields and forces by the velocity alone: a force on the piston or on the spool, oil and heat
into a chamber, a shift of the edges, another viscosity. What nobody adds is not compiled.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.effects.effect import AbstractEffect
from thermohyd.oil import OilAtTemperature

from .machine import Plant, State, Surroundings, asked_position


class Seen(eqx.Module):
    """What an added effect knows at one time, SI. spool: from the hydraulic null; warming (2,): of the chambers' oil above the
    supply's; time: since the run began. Pressures gauge. turned: which way the spool's command went last, -1 to 1, also while it stands;
    0 before it first moves, and without an effect that `remembers`."""

    time: Float[Array, ""]
    spool: Float[Array, ""]
    spool_speed: Float[Array, ""]
    position: Float[Array, ""]
    velocity: Float[Array, ""]
    pressure: Float[Array, "2"]
    warming: Float[Array, "2"]
    supply_pressure: Float[Array, ""]
    return_pressure: Float[Array, ""]
    temperature: Float[Array, ""]
    turned: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.zeros(()))


class Added(eqx.Module):
    """What is added, SI; None: nothing. Chambers A, B along the last axis.

    piston_force [N] along +z. spool_target [m]: a force on the spool, in travel of the command that balances it. inflow (2,)
    [m3/s] into each chamber, of its own oil; inflow_per_rate (2,) [m3/Pa]: the same per dp/dt of that chamber, negative where it
    stores. heat (2,) [W] into each chamber's oil, without part where all oil is at T_s. opening [m]: what the edges see of the
    spool beyond its position. viscosity [-]: share by which all oil is thicker.
    """

    piston_force: Float[Array, ""] | None = None
    spool_target: Float[Array, ""] | None = None
    inflow: Float[Array, "2"] | None = None
    inflow_per_rate: Float[Array, "2"] | None = None
    heat: Float[Array, "2"] | None = None
    opening: Float[Array, ""] | None = None
    viscosity: Float[Array, ""] | None = None

    def plus(self, other: "Added") -> "Added":
        """Both together."""
        total = lambda a, b: b if a is None else a if b is None else a + b
        return Added(*(total(getattr(self, name), getattr(other, name)) for name in Added.__dataclass_fields__))

    def thickened(self, oil: OilAtTemperature) -> OilAtTemperature:
        """An oil with the viscosity that it then has."""
        if self.viscosity is None:
            return oil
        return eqx.tree_at(lambda o: o.viscosity, oil, oil.viscosity * (1.0 + self.viscosity))


class AbstractCircuitEffect(AbstractEffect):
    """An effect of an actuator in motion that no field of `Motion` has: what it adds follows from what it sees."""

    stage: ClassVar[str] = "circuit"
    dynamic: ClassVar[bool] = True

    @abc.abstractmethod
    def added(self, seen: Seen) -> Added:
        """What it adds where a state is seen."""


NOTHING = Added()


def added_at(plant: Plant, around: Surroundings, state: State) -> Added:
    """What all effects of this stage add at a state."""
    effects = [effect for effect in plant.valve.effects if isinstance(effect, AbstractCircuitEffect)]
    if not effects:
        return NOTHING
    seen, total = seen_at(plant, around, state), NOTHING
    for effect in effects:
        total = total.plus(effect.added(seen))
    return total


def seen_at(plant: Plant, around: Surroundings, state: State) -> Seen:
    """What effects of this stage see of a state."""
    warming = jnp.zeros(2) if state.temperature is None else state.temperature - around.temperature
    return Seen(
        time=around.time - plant.inputs.time[0],
        spool=state.spool - plant.at(around).null_bias,
        spool_speed=state.spool_speed,
        position=state.position,
        velocity=state.velocity,
        pressure=state.pressure,
        warming=warming,
        supply_pressure=around.supply_pressure,
        return_pressure=around.return_pressure,
        temperature=around.temperature,
        turned=turned(plant, around, state),
    )


def turned(plant: Plant, around: Surroundings, state: State) -> Float[Array, ""]:
    """Which way the command went last: +-1 from where it has come back by the memory (a play wider than that: by the play), between
    in proportion."""
    if state.play is None or plant.memory is None:
        return jnp.zeros(())
    backlash = plant.motion.backlash
    width = plant.memory if backlash is None else jnp.maximum(backlash, plant.memory)
    ahead = asked_position(plant, plant.command(around.time), state.position) - state.play
    return jnp.clip(ahead / (0.5 * width), -1.0, 1.0)
