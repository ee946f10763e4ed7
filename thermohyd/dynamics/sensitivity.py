"""A run's derivatives in forward mode: the variational equations, solved along the steps that the run took.

With y' = f(t, y, p) known, tangents obey y_p' = (df/dy) y_p + (df/dp) p', which is linear. On every step they are solved by
collocation at the three Radau points (Radau IIA, order 5, stiffly accurate; Hairer and Wanner, Solving ODEs II, section
IV.5), at states of the step's dense output. So no second derivative is taken, all steps of a block are worked on at once, and
what does not depend on the direction is found once for all directions. Where the field has a kink its derivatives jump, and
collocation across would be wrong by the size of the jump: steps are cut at the kinks.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .kinks import Pieces, pieces_of
from .plant import Plant
from .state import Scaling
from .walk import Walk, Way, field


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
    values, rest = eqx.partition(plant, eqx.is_inexact_array)
    full = lambda value, t: None if value is None else jnp.zeros_like(value) if t is None else t
    along = jax.tree.map(full, values, moved, is_leaf=lambda leaf: leaf is None)

    def at(begin: Array, length: Array, path: Any, node: Array) -> tuple[Array, Array]:
        time = begin + length * (INSIDE + (1.0 - 2.0 * INSIDE) * node)
        state = path.evaluate(time)
        own = lambda state, values: field(time, state, (eqx.combine(values, rest), scaling))
        _, push = jax.linearize(own, state, values)
        still = jax.tree.map(jnp.zeros_like, values)
        columns = jax.vmap(lambda unit: push(unit, still), out_axes=1)(jnp.eye(state.shape[0]))
        return columns, push(jnp.zeros_like(state), along)

    nodes = jax.vmap(at, in_axes=(None, None, None, 0))
    return jax.vmap(nodes, in_axes=(0, 0, 0, None))(pieces.begin, pieces.length, pieces.path, jnp.asarray(NODES))


def _onward(pieces: Pieces, matrix: Array, push: Array, start: Array) -> tuple[Float[Array, " states"], Array, Array]:
    """(tangent at the block's end, (pieces, states) at the pieces' begins, (pieces, 3, states) its rates at the points)."""
    count, _, n = push.shape
    h = pieces.length[:, None, None]
    coupled = jnp.einsum("ij,ciab->ciajb", RADAU, matrix).reshape(count, 3 * n, 3 * n)
    solve = jnp.linalg.inv(jnp.eye(3 * n) - h * coupled)
    # Rates at the points per tangent at the piece's begin, and those that the parameters bring.
    own = solve @ matrix.reshape(count, 3 * n, n)
    brought = jnp.sum(solve * push.reshape(count, 1, 3 * n), axis=-1)
    weights = np.kron(RADAU[2], np.eye(n))
    through = jnp.eye(n) + h * (weights @ own)
    gained = h[:, 0] * jnp.sum(weights * brought[:, None, :], axis=-1)

    def step(tangent: Array, piece: tuple[Array, Array]) -> tuple[Array, Array]:
        matrix, gained = piece
        return jnp.sum(matrix * tangent, axis=1) + gained, tangent

    end, begins = jax.lax.scan(step, start, (through, gained))
    rates = jnp.sum(own * begins[:, None, :], axis=-1) + brought
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
        onward, steps = way.block(walk, args)
        pieces = pieces_of(steps, plant, scaling)
        end, begins, rates = _onward(pieces, *_slopes(pieces, plant, moved, scaling), tangent)
        here = ((times > walk.time) & (times <= onward.time))[:, None]
        found, along = _rows(pieces, times, begins, rates)
        return onward, end, jnp.where(here, found, states), jnp.where(here, along, tangents)

    none = jnp.full((times.shape[0], start.shape[0]), jnp.nan)
    walk = way.start(times[0], first_step, start, args)
    first = (walk, tangent, none.at[0].set(start), none.at[0].set(tangent))
    walk, _, states, tangents = jax.lax.while_loop(lambda carry: way.going(carry[0]), block, first)
    return Run(states, tangents, walk.tried, walk.time >= way.last)
