"""Gather valve, oil, jack and loop with their effects into the plant of one run, so that a step of the solver only evaluates it.

With it stand what the plant is made of and what moves: the state in SI units and as a vector of numbers of order 1 for the
solver; heat between the oil of the chambers, the metal around it and the surroundings (docs/physics.md section 9.3); and what a
dynamic effect may add.

A dynamic effect adds to a field of `Motion`, or is a force on the piston. The fields of `Motion` start at the record's own
values, or None where a record has none. Which are None is known while tracing, so that absent physics is not even compiled.
"""

import abc
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.actuator import Actuator
from thermohyd.arguments import Heat
from thermohyd.conditions import Conditions
from thermohyd.edge import MeteringEdge
from thermohyd.effects.effect import AbstractConditionEffect, AbstractEffect, Coupling
from thermohyd.oil import Oil, OilAtTemperature, at_temperature
from thermohyd.valve import Valve, coupling, metering_edges, null_bias, true_oil

from .inputs import Kind, StepInputs


def _optional(value: float | Array | None) -> Array | None:
    return None if value is None else jnp.asarray(value, dtype=jnp.result_type(float))


class Walls(eqx.Module):
    """The metal around each of the two chambers; both are alike. Everything None: the oil keeps its heat (THM).

    conductance h_w A_w [W/K] between oil and wall. capacity C_w [J/K] of one wall: None, it is held at the supply's
    temperature T_s. ambient_conductance G_amb [W/K] and ambient_temperature T_amb [K]: what a wall with a capacity loses;
    None: nothing.
    """

    conductance: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)
    capacity: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)
    ambient_conductance: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)
    ambient_temperature: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)

    def plus(self, conductance: Float[Array, "..."]) -> "Walls":
        """With more conductance between oil and wall (the effect `wall_heat`)."""
        own = self.conductance
        total = conductance if own is None else own + conductance
        return Walls(total, self.capacity, self.ambient_conductance, self.ambient_temperature)

    def into_oil(
        self, oil: Float[Array, "2"], wall: Float[Array, "2"] | None, supply: Float[Array, ""]
    ) -> Float[Array, "2"] | None:
        """Heat [W] into each chamber's oil; None where nothing passes."""
        if self.conductance is None:
            return None
        return self.conductance * ((supply if wall is None else wall) - oil)

    def rate(self, oil: Float[Array, "2"], wall: Float[Array, "2"]) -> Float[Array, "2"]:
        """dT_w/dt [K/s]: C_w dT_w/dt = h_w A_w (T - T_w) + G_amb (T_amb - T_w)."""
        assert self.capacity is not None
        heat = jnp.zeros_like(wall) if self.conductance is None else self.conductance * (oil - wall)
        if self.ambient_conductance is not None and self.ambient_temperature is not None:
            heat = heat + self.ambient_conductance * (self.ambient_temperature - wall)
        return heat / self.capacity

    @property
    def settling(self) -> Float[Array, ""]:
        """C_w/(h_w A_w + G_amb) [s]: the wall's own time constant."""
        assert self.capacity is not None
        parts = [g for g in (self.conductance, self.ambient_conductance) if g is not None]
        return self.capacity / sum(parts, start=jnp.zeros(()))


class Motion(eqx.Module):
    """Optional physics of the actuator, SI units.

    coulomb_friction F_c [N]; stribeck_friction F_s - F_c [N]; jack_leakage a [m3/(s Pa)]; backlash b [m] of spool command;
    entrained_air phi [-]; flow_force k [m/N] of spool command; spool_delay tau [s]; wall_heat h_w A_w [W/K] per chamber.
    """

    coulomb_friction: Float[Array, "..."]
    jack_leakage: Float[Array, "..."]
    stribeck_friction: Float[Array, "..."] | None = None
    backlash: Float[Array, "..."] | None = None
    entrained_air: Float[Array, "..."] | None = None
    flow_force: Float[Array, "..."] | None = None
    spool_delay: Float[Array, "..."] | None = None
    wall_heat: Float[Array, "..."] | None = None

    def plus(self, field: str, amount: Float[Array, "..."]) -> "Motion":
        """The same with an amount added to a field."""
        return self._with_more(lambda motion: getattr(motion, field), amount)

    def later(self, by: Float[Array, "..."]) -> "Motion":
        """The same with a command that acts later by a time [s]."""
        return self._with_more(lambda motion: motion.spool_delay, by)

    def _with_more(self, of: Callable[["Motion"], Array | None], amount: Float[Array, "..."]) -> "Motion":
        own = of(self)
        return eqx.tree_at(of, self, amount if own is None else own + amount, is_leaf=lambda leaf: leaf is None)


class AbstractMotionEffect(AbstractEffect):
    """An effect that only an actuator in motion shows; static tests pass it by."""

    stage: ClassVar[str] = "motion"
    dynamic: ClassVar[bool] = True

    @abc.abstractmethod
    def motion(self, so_far: Motion) -> Motion:
        """The motion's physics with one more effect."""


class AbstractForceEffect(AbstractEffect):
    """A force on the moving mass beside friction, end stops and the external force, by the piston's velocity.

    Not by its place: in open loop a run starts with the piston at mid stroke and a steady speed, wherever it goes.
    """

    stage: ClassVar[str] = "force"
    dynamic: ClassVar[bool] = True

    @abc.abstractmethod
    def force(self, velocity: Float[Array, ""]) -> Float[Array, ""]:
        """Force [N] against the positive direction, at the piston's velocity [m/s]."""


def motion_of(actuator: Actuator, effects: tuple[AbstractEffect, ...]) -> Motion:
    """The actuator's own physics and that of its dynamic effects."""
    motion = Motion(
        coulomb_friction=jnp.asarray(actuator.coulomb_friction), jack_leakage=jnp.asarray(actuator.jack_leakage)
    )
    for effect in effects:
        if isinstance(effect, AbstractMotionEffect):
            motion = effect.motion(motion)
    return motion


class Surroundings(eqx.Module):
    """What acts from outside at one time: P_s, P_t [Pa, gauge], true temperature T_s [K] of the oil supplied, F_e [N]; the time [s]."""

    supply_pressure: Float[Array, ""]
    return_pressure: Float[Array, ""]
    temperature: Float[Array, ""]
    external_force: Float[Array, ""]
    time: Float[Array, ""]


class Supplied(eqx.Module):
    """What follows from the temperature of the oil supplied: the oil itself, the edges, the paths between the ports.

    edges: fields of shape (2, 1), the edges from the supply and to the return, or (2, 2) where ports A and B differ.
    null_bias [m]: where the hydraulic null lies. crossing: conductance [m3/(s Pa)] or None.
    """

    oil: OilAtTemperature
    edges: MeteringEdge
    null_bias: Float[Array, ""]
    crossing: Float[Array, "..."] | None


MEMORY = 5e-3  # of the stroke: more than noise of a command, less than any play or magnetic loop that shows


class Plant(eqx.Module):
    """Everything that the vector field needs beside the state and the time.

    keeps_heat: chambers have temperatures of their own (THM, or walls); else all oil is at T_s (HM).
    supplied: None where the temperature varies, so that it must be found at every time.
    memory [m]: how far the command has to come back until an effect that `remembers` sees it go the other way; None without such a one.
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
    memory: Float[Array, ""] | None = None

    @property
    def play_width(self) -> Float[Array, "..."] | None:
        """Width [m] of the play whose state the machine keeps: that of the command's backlash, else of the `memory`."""
        return self.memory if self.motion.backlash is None else self.motion.backlash

    @property
    def kind(self) -> Kind:
        return self.inputs.kind

    def surroundings(self, time: Float[Array, ""]) -> Surroundings:
        supply, back, temperature, force = self.inputs.surroundings.at(time)
        force = force if self.inputs.forced else self.actuator.external_force
        return Surroundings(supply, back, temperature, force, time)

    def at(self, surroundings: Surroundings) -> Supplied:
        return supplied_at(self.valve, self.oil, surroundings) if self.supplied is None else self.supplied

    def command(self, time: Float[Array, ""]) -> Float[Array, ""]:
        return self.inputs.command.at(time)[0]

    @property
    def forces(self) -> tuple[AbstractForceEffect, ...]:
        return tuple(effect for effect in self.valve.effects if isinstance(effect, AbstractForceEffect))


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
        null_bias=jnp.reshape(null_bias(valve, conditions), ()),
        crossing=jnp.sum(sum(crossings, start=jnp.zeros(1))) if crossings else None,
    )


def _as_pair(supply: Float[Array, "..."], return_: Float[Array, "..."]) -> Float[Array, "2 ports"]:
    return jnp.stack(jnp.broadcast_arrays(jnp.ravel(supply), jnp.ravel(return_)))


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
    remembers = any(type(effect).remembers for effect in valve.effects)
    first = Surroundings(*inputs.surroundings.start, time=inputs.time[0])
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
        memory=jnp.asarray(MEMORY * valve.stroke) if remembers else None,
    )


def loop_gain(plant: Plant) -> Float[Array, ""]:
    """Spool command per position error X_n K_A K_p/I_rated [-]."""
    j = plant.actuator
    return plant.valve.stroke * j.amplifier_gain * j.sensor_gain / j.rated_current


def wanted_position(plant: Plant, command: Float[Array, ""], position: Float[Array, ""]) -> Float[Array, ""]:
    """The spool position [m] that the controller or the command asks for, however far."""
    if plant.kind == "setpoint":
        return loop_gain(plant) * (command - position)
    if plant.kind == "current":
        return plant.polarity * plant.valve.stroke * command / plant.actuator.rated_current
    return command


def asked_position(plant: Plant, command: Float[Array, ""], position: Float[Array, ""]) -> Float[Array, ""]:
    """The same before the chain: x_c clipped to +-X_n."""
    return jnp.clip(wanted_position(plant, command, position), -plant.valve.stroke, plant.valve.stroke)


POSITION = 3  # of the piston, in the vector


class State(eqx.Module):
    """Spool x [m] and its speed [m/s]; p_A, p_B [Pa, gauge]; T_A, T_B [K]; piston z [m] and v [m/s].

    temperature is None where the oil stays at the supply's (HM); wall [K], the metal around each chamber, where it has a
    capacity of its own; play y [m] where the command has backlash or its last turn is remembered. Rates of change are held in
    the same Module, per second.
    """

    spool: Float[Array, "..."]
    spool_speed: Float[Array, "..."]
    pressure: Float[Array, "... 2"]
    temperature: Float[Array, "... 2"] | None
    position: Float[Array, "..."]
    velocity: Float[Array, "..."]
    wall: Float[Array, "... 2"] | None = None
    play: Float[Array, "..."] | None = None


class Scaling(eqx.Module):
    """What a state is counted from and in: vector = (state - origin)/size, in the order of `pack`."""

    origin: State
    size: State

    def pack(self, state: State) -> Float[Array, " states"]:
        return (_flat(state) - _flat(self.origin)) / _flat(self.size)

    def pack_rates(self, rates: State) -> Float[Array, " states"]:
        return _flat(rates) / _flat(self.size)

    def unpack(self, vector: Float[Array, "*lead states"]) -> State:
        """The state, or the states of several times."""
        return _unflat(_flat(self.origin) + _flat(self.size) * vector, self.origin)


def _flat(state: State) -> Float[Array, " states"]:
    # Speeds first, pressures last: eliminated in this order, no pivot of a step's matrix is small (see `rosenbrock`).
    parts = [state.spool_speed, state.spool, state.velocity, state.position, state.play, state.wall]
    parts += [state.temperature, state.pressure]
    return jnp.concatenate([jnp.atleast_1d(part) for part in parts if part is not None])


def _unflat(vector: Float[Array, "*lead states"], like: State) -> State:
    place = 4
    play = wall = temperature = None
    if like.play is not None:
        play, place = vector[..., place], place + 1
    if like.wall is not None:
        wall, place = vector[..., place : place + 2], place + 2
    if like.temperature is not None:
        temperature, place = vector[..., place : place + 2], place + 2
    return State(
        spool_speed=vector[..., 0],
        spool=vector[..., 1],
        velocity=vector[..., 2],
        position=vector[..., 3],
        play=play,
        wall=wall,
        temperature=temperature,
        pressure=vector[..., place : place + 2],
    )
