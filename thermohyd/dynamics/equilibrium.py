"""Where a run starts: the steady state under the first row's command, as a root of the same equations (docs/physics.md section 9.5).

Closed loop: everything at rest, the spool where the closed ports carry the external force, the piston where the loop asks
for that spool. Open loop: the spool where the command puts it, the piston at mid stroke and at its steady speed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.oil import density
from thermohyd.small_systems import solved

from .circuit import added_at
from .flows import flows_at
from .machine import Plant, Scaling, State, Surroundings, asked_position, loop_gain
from .vector_field import instant, thrust


# Newton converges in 5 to 10 turns; the limit only ends a search that has no root (a force beyond what the supply holds).
MOST_TURNS = 200
KELVINS = 10.0
UNRENEWED = 1e-18  # 1/s: nothing beside the slowest renewal, and not zero beside none
# Of the scaled imbalances: rounding leaves less than 1e-14.
BALANCED, ROUNDING = 1e-11, 1e-15
SHORTEST = 1e-3  # of a Newton step


def scaling_of(plant: Plant, around: Surroundings) -> Scaling:
    """What is large for this plant: strokes, a tenth of the supply pressure (about its middle), free speed, kelvins.

    A tenth, as both ports stay near the middle: so the solver's tolerance costs every reading alike.
    """
    v, j = plant.valve, plant.actuator
    span = around.supply_pressure - around.return_pressure
    rho = density(plant.oil, around.supply_pressure, around.temperature)
    speed = v.discharge_coefficient * v.slot_width * v.stroke * jnp.sqrt(span / rho) / j.mean_area
    omega = 2.0 * jnp.pi * j.spool_frequency
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    warm = plant.keeps_heat
    walled = warm and plant.walls.capacity is not None
    play = plant.play_width is not None
    kelvins = jnp.full(2, KELVINS)
    origin = State(
        spool=zero, spool_speed=zero, pressure=pair + 0.5 * (around.supply_pressure + around.return_pressure), position=zero, velocity=zero,
        temperature=pair + around.temperature if warm else None, wall=pair + around.temperature if walled else None,
        play=zero if play else None,
    )  # fmt: skip
    size = State(
        spool=v.stroke, spool_speed=v.stroke * omega, pressure=pair + 0.1 * span, position=speed / omega, velocity=speed,
        temperature=kelvins if warm else None, wall=kelvins if walled else None, play=v.stroke if play else None,
    )  # fmt: skip
    # Sizes say nothing about the answer, and so nothing about its derivatives.
    return jax.lax.stop_gradient(Scaling(origin, size))


def equilibrium(plant: Plant, scaling: Scaling, time: Float[Array, ""]) -> tuple[State, Bool[Array, ""]]:
    """The steady state at a time, and whether it was found; differentiable, forward and reverse, as the root that it is."""
    around, command = plant.surroundings(time), plant.command(time)
    closed = plant.kind == "setpoint"
    base = _first_guess(plant, scaling, around, command)
    fixed = scaling.pack(base)
    free = _unknowns(base, fixed.shape[0], closed)

    def state_of(unknown: Float[Array, " unknowns"]) -> State:
        return scaling.unpack(fixed.at[free].set(unknown))

    def imbalance(unknown: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        state = state_of(unknown)
        now = instant(plant, state, around, command)
        force = plant.actuator.mean_area * (around.supply_pressure - around.return_pressure)
        rows = [thrust(plant, around, state, now.added) / force]
        if not closed:
            rows.append((now.target - state.spool) / plant.valve.stroke)
        if state.wall is not None:
            assert state.temperature is not None
            rows.append(plant.walls.rate(state.temperature, state.wall) * plant.walls.settling / KELVINS)
        if now.sources.heating is not None:
            # Not the rate, but how far the temperature is from where its inflow takes it: nearly linear in everything.
            assert now.sources.renewal is not None
            assert state.temperature is not None
            # A chamber that a load empties towards supply and return alike keeps any temperature for ever: it starts at T_s.
            kept = UNRENEWED * (around.temperature - state.temperature)
            rows.append((now.sources.heating + kept) / (now.sources.renewal + UNRENEWED) / KELVINS)
        # A tenth of the flow at full opening.
        turnover = 0.1 * scaling.size.velocity * plant.actuator.areas / plant.actuator.volumes
        return jnp.concatenate([jnp.atleast_1d(row) for row in (*rows, now.sources.squeeze / turnover)])

    unknown, left = _root(imbalance, fixed[free])
    found = left < BALANCED
    state = state_of(unknown)
    if closed:
        state, reachable = _in_the_loop(plant, around, state, command)
        found = found & reachable
    return state, found & jnp.all(jnp.isfinite(scaling.pack(state)))


def _in_the_loop(
    plant: Plant, around: Surroundings, state: State, setpoint: Float[Array, ""]
) -> tuple[State, Bool[Array, ""]]:
    """The same with the piston where the loop asks for its spool, and whether the clipped command reaches that far."""
    asked, more = state.spool, added_at(plant, around, state)
    if plant.motion.flow_force is not None:
        force = flows_at(plant, plant.at(around), around, state, more).force
        assert force is not None
        asked = asked + plant.motion.flow_force * force
    if more.spool_target is not None:
        asked = asked - more.spool_target
    position = setpoint - asked / loop_gain(plant)
    state = eqx.tree_at(lambda s: s.position, state, position)
    if state.play is not None:
        state = eqx.tree_at(lambda s: s.play, state, asked)
    return state, jnp.abs(asked) <= plant.valve.stroke


def _first_guess(plant: Plant, scaling: Scaling, around: Surroundings, command: Float[Array, ""]) -> State:
    """Both ports about the middle, apart by what carries the external force; the spool at null or at its command."""
    middle = 0.5 * (around.supply_pressure + around.return_pressure)
    limit = 0.49 * (around.supply_pressure - around.return_pressure)
    missing = around.external_force - plant.actuator.push(jnp.stack([middle, middle]))
    half = jnp.clip(0.5 * missing / plant.actuator.mean_area, -limit, limit)
    zero = jnp.zeros(())
    asked = asked_position(plant, command, zero)
    closed = plant.kind == "setpoint"
    return State(
        spool=plant.at(around).null_bias if closed else asked, spool_speed=zero, position=zero, velocity=zero,
        pressure=jnp.stack([middle + half, middle - half]), temperature=scaling.origin.temperature,
        wall=scaling.origin.wall, play=None if scaling.origin.play is None else asked,
    )  # fmt: skip


def _unknowns(base: State, count: int, closed: bool) -> np.ndarray:
    """Which entries of the vector are unknown: spool (and speed in open loop), walls, temperatures, pressures."""
    after_play = 4 + (base.play is not None)
    return np.array([*([1] if closed else [2, 1]), *range(after_play, count)])


def _root(fn, start: Float[Array, " unknowns"]) -> tuple[Float[Array, " unknowns"], Float[Array, ""]]:
    """(root by damped Newton from `start`, largest imbalance left); derivatives by the implicit function theorem.

    One evaluation, value and Jacobian together, per turn: a point that is no better than the best one shortens the step. Where
    even a short one is none better, the search stands before a kink, such as a chamber at the return's pressure, behind which the
    slopes are others: it goes on with the whole step.
    """

    def newton(fn, start: Array) -> tuple[Array, Array]:
        columns = jnp.eye(start.shape[0])

        def going(carry: tuple[Array, ...]) -> Array:
            _, size, _, _, turn = carry
            return (size > ROUNDING) & (turn < MOST_TURNS)

        def step(carry: tuple[Array, ...]) -> tuple[Array, ...]:
            best, size, move, length, turn = carry
            stuck = (length < SHORTEST) & (size >= BALANCED)
            tried = best - jnp.where(stuck, 1.0, length) * move
            value, push = jax.linearize(fn, tried)
            jacobian = jax.vmap(push, out_axes=1)(columns)
            norm = jnp.max(jnp.abs(value))
            better = (norm < size) | (stuck & jnp.isfinite(norm))  # never where a value is NaN
            newton_step = solved(jacobian, value)
            return (
                jnp.where(better, tried, best),
                jnp.where(better, norm, size),
                jnp.where(better, newton_step, move),
                jnp.where(better, 1.0, 0.4 * length),
                # A found root is left once no step improves on it.
                jnp.where(~better & (size < BALANCED), MOST_TURNS, turn + 1),
            )

        first = (start, jnp.asarray(jnp.inf), jnp.zeros_like(start), jnp.ones(()), jnp.asarray(0))
        best, size, *_ = jax.lax.while_loop(going, step, first)
        return best, size

    def tangent_solve(linear, y: Array) -> Array:
        return solved(jax.jacfwd(linear)(y), y)

    return jax.lax.custom_root(fn, start, newton, tangent_solve, has_aux=True)
