"""The actuator's equations of motion put together: rates of change of a state at a time."""

import equinox as eqx
from jaxtyping import Array, Float

from .chambers import Sources, chamber_rates, chamber_sources
from .command import against_flow_force, asked_position, spool_acceleration, through_play
from .flows import Flows, flows_at
from .piston import dry_friction, end_stops
from .plant import Plant, Surroundings
from .state import State


def thrust(plant: Plant, around: Surroundings, state: State) -> Float[Array, ""]:
    """Force on the moving mass [N]: S (p_A - p_B) - f v - dry friction - end stops - F_e."""
    j, v = plant.actuator, state.velocity
    force = j.piston_area * (state.pressure[0] - state.pressure[1]) - j.viscous_friction * v
    force = force - dry_friction(plant.motion, v) - end_stops(j.piston_stroke, state.position, v)
    return force - around.external_force


class Instant(eqx.Module):
    """What one state under one command leads to. target: where the spool is driven to [m]."""

    flows: Flows
    sources: Sources
    target: Float[Array, ""]
    play_rate: Float[Array, ""] | None


def instant(plant: Plant, state: State, around: Surroundings, command: Float[Array, ""]) -> Instant:
    """Flows, their sources and the command chain at a state."""
    flows = flows_at(plant, plant.at(around), around, state)
    asked = asked_position(plant, command, state.position)
    passed, play_rate = through_play(plant, asked, state.play)
    sources = chamber_sources(plant, around, state, flows)
    return Instant(flows, sources, against_flow_force(plant, passed, flows), play_rate)


def rates_at(plant: Plant, state: State, around: Surroundings, command: Float[Array, ""]) -> State:
    """Rates of change, per second, of a state under a command."""
    now = instant(plant, state, around, command)
    dp, dt = chamber_rates(plant, state, now.sources)
    wall = None
    if state.wall is not None:
        assert state.temperature is not None
        wall = plant.walls.rate(state.temperature, state.wall)
    return State(
        spool=state.spool_speed,
        spool_speed=spool_acceleration(plant, now.target, state.spool, state.spool_speed),
        pressure=dp,
        temperature=dt,
        position=state.velocity,
        velocity=thrust(plant, around, state) / plant.actuator.moving_mass,
        wall=wall,
        play=now.play_rate,
    )


def vector_field(plant: Plant, time: Float[Array, ""], state: State) -> State:
    """Rates of change of the state at a time [s]."""
    return rates_at(plant, state, plant.surroundings(time), plant.command(time))
