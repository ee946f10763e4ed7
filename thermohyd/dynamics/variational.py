"""A run's derivatives in forward mode: the variational equations, solved along the steps that the run took.

With y' = f(t, y, p) known, tangents obey y_p' = (df/dy) y_p + (df/dp) p', which is linear. On every step they are solved by
collocation at the three Radau points (Radau IIA, order 5, stiffly accurate; Hairer and Wanner, Solving ODEs II, section
IV.5), at states of the step's dense output. So no second derivative is taken, all steps of a block are worked on at once, and
what does not depend on the direction is found once for all directions. Where the field has a kink its derivatives jump, and
collocation across would be wrong by the size of the jump: steps are cut at the kinks.

The steps are those that `diffrax.diffeqsolve` takes, walked in blocks and kept with their dense output.
"""

from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from thermohyd.small_systems import inverses

from .circuit import added_at
from .flows import openings
from .machine import Plant, Scaling, State, asked_position, wanted_position
from .rosenbrock import DenseOutput, Rodas5P
from .vector_field import (
    STOP_STIFFNESS,
    stop_depths,
    stop_pushes,
    vector_field,
)


# Steps that are worked on at once: enough to fill vectors with what is asked of them, and few enough for a cache.
BLOCK = 64


def field(time: Float[Array, ""], vector: Float[Array, " states"], args: tuple[Plant, Scaling]) -> Array:
    """The vector field of the scaled state, per second."""
    plant, scaling = args
    return scaling.pack_rates(vector_field(plant, time, scaling.unpack(vector)))


TERM = diffrax.ODETerm(field)  # pyright: ignore[reportArgumentType]


class Steps(eqx.Module):
    """A step, or those of a block, leading axis (BLOCK,): from `begin` to `end` [s], of no length behind the last."""

    begin: Float[Array, "*steps"]
    end: Float[Array, "*steps"]
    path: DenseOutput


class Walk(eqx.Module):
    """Where the solver stands: at `state` and `time`, about to try a step to `aim` [s]; how many it tried."""

    time: Float[Array, ""]
    aim: Float[Array, ""]
    state: Float[Array, " states"]
    control: Any
    jumped: Bool[Array, ""]
    tried: Int[Array, ""]


class Way(eqx.Module):
    """What does not change on the way: step-size controller (of diffrax), end of the run [s], steps tried at most."""

    controller: Any
    last: Float[Array, ""]
    most: int = eqx.field(static=True)

    def going(self, walk: Walk) -> Bool[Array, ""]:
        return (walk.time < self.last) & (walk.tried < self.most)

    def start(
        self, time: Float[Array, ""], first_step: Float[Array, ""], state: Float[Array, " states"], args: Any
    ) -> Walk:
        solver = Rodas5P()
        aim, control = self.controller.init(
            TERM, time, self.last, state, first_step, args, solver.func, solver.error_order(TERM)
        )
        control = jax.tree.map(jnp.asarray, control)
        aim = jnp.minimum(aim, self.last)
        return Walk(time, aim, state, control, jnp.asarray(False), jnp.asarray(0))

    def block(self, walk: Walk, args: tuple[Plant, Scaling]) -> tuple[Walk, Walk, Steps]:
        """The next BLOCK steps that are taken, or as many as there are: (where they lead, where the solver stood before each, the steps).

        What is tried and not taken leaves no gap: derivatives cost three times what the steps cost.
        """
        solver = Rodas5P()
        # A step that would leave this little goes to the end. A loop, as the next number takes two dozen operations to find.
        nearly = jax.lax.fori_loop(0, 100, lambda _, time: eqxi.prevbefore(time), self.last)

        def attempt(carry: tuple[Walk, Array, tuple[Walk, Steps]]) -> tuple[Walk, Array, tuple[Walk, Steps]]:
            walk, count, found = carry
            new, error, path, _, _ = solver.step(TERM, walk.time, walk.aim, walk.state, args, None, walk.jumped)
            error = jnp.where(jnp.isnan(error), jnp.inf, error)
            good, time, further, jumped, control, _ = self.controller.adapt_step_size(
                walk.time, walk.aim, walk.state, new, args, error, solver.error_order(TERM), walk.control
            )
            time = jnp.minimum(time, self.last)
            nearest = jnp.where(good, self.last, time + 0.5 * (self.last - time))
            further = jnp.where(further > nearly, nearest, further)
            state = jnp.where(good, new, walk.state)
            onward = Walk(time, further, state, control, jnp.where(good, jumped, walk.jumped), walk.tried + 1)
            taken = Steps(walk.time, walk.aim, DenseOutput(t0=walk.time, t1=walk.aim, **path))
            place = jnp.where(good, count, BLOCK)
            kept = lambda all_of, one: all_of.at[place].set(one, mode="drop")
            return onward, count + good.astype(int), jax.tree.map(kept, found, (walk, taken))

        def goes_on(carry: tuple[Walk, Array, tuple[Walk, Steps]]) -> Bool[Array, ""]:
            return self.going(carry[0]) & (carry[1] < BLOCK)

        spread = lambda leaf: jnp.broadcast_to(leaf, (BLOCK, *leaf.shape))
        none = jax.tree.map(spread, (walk, self._still(walk)))
        onward, count, found = jax.lax.while_loop(goes_on, attempt, (walk, jnp.asarray(0), none))
        there = jnp.arange(BLOCK) < count
        filled = lambda leaf, last: jnp.where(there.reshape(-1, *(1,) * last.ndim), leaf, last)
        before, steps = jax.tree.map(filled, found, (onward, self._still(onward)))
        return onward, before, steps

    @staticmethod
    def _still(walk: Walk) -> Steps:
        """A step of no length."""
        here = walk.state
        path = DenseOutput(t0=walk.time, t1=walk.time, y0=here, y1=here, bends=jnp.zeros((3, *here.shape)))
        return Steps(walk.time, walk.time, path)


CUTS = 16  # kinks that a block has room for; what comes after them is left to the next block
HALVINGS = 30  # of a step, to find a kink in it


def distances(plant: Plant, time: Float[Array, ""], state: State) -> Float[Array, " kinks"]:
    """Signed distances from the kinks, in metres: of the four edges from closing, of the spool's command from its limits, of the
    play from its ends, of the stops from pushing and from the bottom of their cushions.

    Left out is what only bends where flow turns round: there the flow is zero, and its derivatives jump by little.
    """
    around = plant.surroundings(time)
    command = plant.command(time)
    wanted = wanted_position(plant, command, state.position)
    limits = plant.valve.stroke * jnp.array([1.0, -1.0])
    depth, below = stop_depths(plant.actuator.piston_stroke, state.position)
    pushes = stop_pushes(depth, state.velocity) / STOP_STIFFNESS
    signed = [
        jnp.ravel(openings(plant.at(around), state, added_at(plant, around, state))),
        wanted - limits,
        pushes,
        below,
    ]
    if state.play is not None and plant.play_width is not None:
        ahead = asked_position(plant, command, state.position) - state.play
        signed.append(ahead - 0.5 * plant.play_width * jnp.array([1.0, -1.0]))
    return jnp.concatenate(signed)


class Crossings(eqx.Module):
    """Kinks that a block's steps cross: distances at a step's begin, and whether the sign is another at its end."""

    first: Float[Array, "steps kinks"]
    crossed: Bool[Array, "steps kinks"]


def _distance_along(plant: Plant, scaling: Scaling) -> Callable[[DenseOutput, Array], Array]:
    return lambda path, time: distances(plant, time, scaling.unpack(path.evaluate(time)))


def _crossings(steps: Steps, plant: Plant, scaling: Scaling) -> Crossings:
    at_each = jax.vmap(_distance_along(plant, scaling))
    first, second = at_each(steps.path, steps.begin), at_each(steps.path, steps.end)
    # One step alone always fits, so that every block goes on.
    assert first.shape[1] <= CUTS
    return Crossings(first, (first > 0.0) != (second > 0.0))


def _with_room(
    onward: Walk, before: Walk, steps: Steps, plant: Plant, scaling: Scaling
) -> tuple[Walk, Steps, Crossings]:
    """The block's first steps, as many as have room for all their kinks; the others are tried again with the next block."""
    found = _crossings(steps, plant, scaling)
    kept = jnp.cumsum(jnp.sum(found.crossed, axis=1)) <= CUTS
    count = jnp.sum(kept)
    next_one = jax.tree.map(lambda each: each[jnp.minimum(count, BLOCK - 1)], before)
    onward = jax.tree.map(lambda last, here: jnp.where(count == BLOCK, last, here), onward, next_one)
    # Left out: of no length, at the end.
    begin, end = (jnp.where(kept, time, onward.time) for time in (steps.begin, steps.end))
    return onward, Steps(begin, end, steps.path), Crossings(found.first, found.crossed & kept[:, None])


def _cuts(steps: Steps, found: Crossings, plant: Plant, scaling: Scaling) -> Float[Array, " cuts"]:
    """Times of the block's kinks, ascending, inf where there are fewer."""
    distance, first = _distance_along(plant, scaling), found.first
    kinks = np.arange(first.shape[1])
    of_kink = jax.vmap(jax.vmap(lambda path, time, kink: distance(path, time)[kink], (None, 0, 0)), (0, 0, None))

    def halve(_: Any, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        before = (of_kink(steps.path, middle, kinks) > 0.0) == (first > 0.0)
        return jnp.where(before, middle, low), jnp.where(before, high, middle)

    bracket = tuple(jnp.broadcast_to(end[:, None], first.shape) for end in (steps.begin, steps.end))
    times = jax.lax.fori_loop(0, HALVINGS, halve, bracket)[1]
    return jnp.sort(jnp.ravel(jnp.where(found.crossed, times, jnp.inf)))[:CUTS]


class Pieces(eqx.Module):
    """Parts of a block's steps between kinks, in turn, leading axis (pieces,); `path` of the step that each lies in."""

    begin: Float[Array, " pieces"]
    length: Float[Array, " pieces"]
    path: DenseOutput


def _pieces_of(steps: Steps, found: Crossings, plant: Plant, scaling: Scaling) -> Pieces:
    """The block's steps cut at their kinks; spare pieces have no length."""
    ends = jnp.sort(jnp.concatenate([steps.end, _cuts(steps, found, plant, scaling)]))
    ends = jnp.minimum(ends, steps.end[-1])
    begins = jnp.concatenate([steps.begin[:1], ends[:-1]])
    # The first step that ends behind the piece's middle.
    owner = jnp.minimum(jnp.searchsorted(steps.end, 0.5 * (begins + ends)), BLOCK - 1)
    return Pieces(begins, ends - begins, jax.tree.map(lambda part: part[owner], steps.path))


_R = 6.0**0.5
NODES = np.array([(4.0 - _R) / 10.0, (4.0 + _R) / 10.0, 1.0])
RADAU = np.array([
    [(88.0 - 7.0 * _R) / 360.0, (296.0 - 169.0 * _R) / 1800.0, (-2.0 + 3.0 * _R) / 225.0],
    [(296.0 + 169.0 * _R) / 1800.0, (88.0 + 7.0 * _R) / 360.0, (-2.0 - 3.0 * _R) / 225.0],
    [(16.0 - _R) / 36.0, (16.0 + _R) / 36.0, 1.0 / 9.0],
])  # fmt: skip
# Integral from 0 to s of the parabola through values k at the nodes: sum over m of s^m (PARABOLA k)_m, m = 1, 2, 3.
PARABOLA = np.linalg.inv(np.vander(NODES, 3, increasing=True)) / np.arange(1.0, 4.0)[:, None]
# Points are taken this share of a piece inside it, on the near side of the kink that ends it.
INSIDE = 1e-7


def _slopes(pieces: Pieces, plant: Plant, moved: Plant, scaling: Scaling) -> tuple[Array, Array]:
    """(df/dy (pieces, 3, states, states), df/dp p' (pieces, 3, states)) at the collocation points."""
    # What no direction moves has no slope to be taken: most of a plant.
    moving = jax.tree.map(lambda _, tangent: tangent is not None, plant, moved)
    values, rest = eqx.partition(plant, moving)

    def at_node(begin: Array, length: Array, path: Any, node: Array) -> tuple[Array, Array]:
        time = begin + length * (INSIDE + (1.0 - 2.0 * INSIDE) * node)
        state = path.evaluate(time)
        _, push = jax.linearize(lambda state: field(time, state, (plant, scaling)), state)
        by_values = lambda values: field(time, state, (eqx.combine(values, rest), scaling))
        return jax.vmap(push, out_axes=1)(jnp.eye(state.shape[0])), jax.jvp(by_values, (values,), (moved,))[1]

    nodes = jax.vmap(at_node, in_axes=(None, None, None, 0))
    return jax.vmap(nodes, in_axes=(0, 0, 0, None))(pieces.begin, pieces.length, pieces.path, jnp.asarray(NODES))


def _onward(pieces: Pieces, matrix: Array, push: Array, start: Array) -> tuple[Float[Array, " states"], Array, Array]:
    """(tangent at the block's end, (pieces, states) at the pieces' begins, (pieces, 3, states) its rates at the points)."""
    count, _, n = push.shape
    h = pieces.length[:, None, None]
    coupled = jnp.einsum("ij,ciab->ciajb", RADAU, matrix).reshape(count, 3 * n, 3 * n)
    # As exact without pivoting as LAPACK: residuals up to 1.7e-14 over 11,000 inverses of the conformance records' first machines, with a
    # stop of the piston in reach and without; LAPACK's 1.1e-14.
    solve = jnp.moveaxis(inverses(jnp.moveaxis(jnp.eye(3 * n) - h * coupled, 0, -1)), -1, 0)
    # Rates at the points per tangent at the piece's begin, and those that the parameters bring.
    per_tangent = solve @ matrix.reshape(count, 3 * n, n)
    brought = jnp.sum(solve * push.reshape(count, 1, 3 * n), axis=-1)
    weights = np.kron(RADAU[2], np.eye(n))
    through = jnp.eye(n) + h * (weights @ per_tangent)
    gained = h[:, 0] * jnp.sum(weights * brought[:, None, :], axis=-1)

    def step(tangent: Array, piece: tuple[Array, Array]) -> tuple[Array, Array]:
        matrix, gained = piece
        return jnp.sum(matrix * tangent, axis=1) + gained, tangent

    end, begins = jax.lax.scan(step, start, (through, gained))
    rates = jnp.sum(per_tangent * begins[:, None, :], axis=-1) + brought
    return end, begins, rates.reshape(count, 3, n)


def _rows(pieces: Pieces, times: Array, begins: Array, rates: Array) -> tuple[Array, Array]:
    """(states, tangents) at times within the block, (rows, states)."""
    owner = jnp.searchsorted(pieces.begin + pieces.length, times)
    owner = jnp.minimum(owner, pieces.begin.shape[0] - 1)
    h = pieces.length[owner]
    s = jnp.where(h > 0.0, (times - pieces.begin[owner]) / jnp.where(h > 0.0, h, 1.0), 0.0)
    powers = jnp.stack([s, s**2, s**3], axis=1) @ PARABOLA
    tangents = begins[owner] + h[:, None] * jnp.sum(powers[:, :, None] * rates[owner], axis=1)
    paths = jax.tree.map(lambda part: part[owner], pieces.path)
    return jax.vmap(lambda path, time: path.evaluate(time))(paths, times), tangents


class Run(eqx.Module):
    """States and their tangents at the rows (rows, states), steps tried, and whether the end was reached."""

    states: Float[Array, "rows states"]
    tangents: Float[Array, "rows states"]
    tried: Int[Array, ""]
    finished: Bool[Array, ""]


def run_along(
    args: tuple[Plant, Scaling],
    start: Float[Array, " states"],
    moved: Plant,
    start_moved: Float[Array, " states"] | None,
    way: Way,
    first_step: Float[Array, ""],
) -> Run:
    """A run and its derivative in one direction: `moved` of the plant, None where nothing moves, and of the start."""
    plant, scaling = args
    times = plant.inputs.time
    tangent = jnp.zeros_like(start) if start_moved is None else start_moved

    def block(carry: tuple[Walk, Array, Array, Array]) -> tuple[Walk, Array, Array, Array]:
        walk, tangent, states, tangents = carry
        onward, steps, crossings = _with_room(*way.block(walk, args), plant, scaling)
        pieces = _pieces_of(steps, crossings, plant, scaling)
        end, begins, rates = _onward(pieces, *_slopes(pieces, plant, moved, scaling), tangent)
        here = ((times > walk.time) & (times <= onward.time))[:, None]
        found, along = _rows(pieces, times, begins, rates)
        return onward, end, jnp.where(here, found, states), jnp.where(here, along, tangents)

    none = jnp.full((times.shape[0], start.shape[0]), jnp.nan)
    walk = way.start(times[0], first_step, start, args)
    first = (walk, tangent, none.at[0].set(start), none.at[0].set(tangent))
    walk, _, states, tangents = jax.lax.while_loop(lambda carry: way.going(carry[0]), block, first)
    return Run(states, tangents, walk.tried, walk.time >= way.last)
