"""Rodas5P for many scenarios at once: the same step, arranged so that a processor's vectors fill with scenarios.

XLA would compute a value again in every place that reads it, unless it is hard to compute. What several places read is
therefore passed into the branch of a condition that always holds: what enters a branch is stored.
"""

from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .lanes import over_lanes
from .rosenbrock import DENSE, GAMMA, TABLEAU, Rodas5P


def _stored(always: Array, work: Callable[..., Any], *given: Any) -> Any:
    """work(*given), with what is given stored before."""
    shapes = jax.eval_shape(work, *given)
    nothing = lambda *_: jax.tree.map(lambda shape: jnp.full(shape.shape, jnp.nan, shape.dtype), shapes)
    return jax.lax.cond(always, work, nothing, *given)


def _inverse(entries: tuple[tuple[Array, ...], ...]) -> Array:
    """Gauss-Jordan as in `rosenbrock.inverse`, of (count,) entries; (states, states, count)."""
    n = len(entries)
    matrix = jnp.stack([jnp.stack(row) for row in entries])
    position = jnp.arange(n)

    def eliminate(k: Array, matrix: Array) -> Array:
        at = position == k
        row = jax.lax.dynamic_index_in_dim(matrix, k, 0, keepdims=False)
        column = jax.lax.dynamic_index_in_dim(matrix, k, 1, keepdims=False)
        pivot = 1.0 / jax.lax.dynamic_index_in_dim(row, k, 0, keepdims=False)
        row = jnp.where(at[:, None], 1.0, row) * pivot
        rest = jnp.where(at[None, :, None], 0.0, matrix) - column[:, None] * row[None]
        return jnp.where(at[:, None, None], row[None], rest)

    return jax.lax.fori_loop(0, n, eliminate, matrix)


def _lanes_step(
    field: Callable, count: int, flags: list[bool], leaves: list[Array], t0: Array, h: Array, y0: Array
) -> Any:
    """(y1, error, bends) with scenarios last; y0 (states, count); t0, h (count,); leaves, scenarios last where `flags`."""
    n = y0.shape[0]
    always = t0[0] < jnp.inf
    wide = lambda number: jnp.broadcast_to(jnp.asarray(number, y0.dtype), (count,))

    def slopes(t: Array, y: Array, *leaves: Array) -> tuple[Array, Array]:
        _, push = jax.linearize(lambda t, y: field(leaves, t, y), t, y)
        columns = jax.vmap(lambda unit: push(np.zeros(()), unit), out_axes=1)(np.eye(n))
        return push(np.ones(()), np.zeros(n)), columns

    def derivatives(t0: Array, h: Array, y0: Array, leaves: list[Array]) -> Any:
        slope, columns = over_lanes(slopes, [t0, y0, *leaves], [True, True, *flags], count)
        own = 1.0 / (GAMMA * h)
        entries = tuple(tuple(wide((own if i == j else 0.0) - columns[i, j]) for j in range(n)) for i in range(n))
        return tuple(map(wide, slope)), entries

    slope, entries = _stored(always, derivatives, t0, h, y0, leaves)
    slope, solve = _stored(always, lambda slope, entries: (jnp.stack(slope), _inverse(entries)), slope, entries)

    def rates(t: Array, at: Array, leaves: list[Array]) -> tuple[Array, ...]:
        (found,) = over_lanes(
            lambda t, y, *leaves: (field(leaves, t, y),), [t, at, *leaves], [True, True, *flags], count
        )
        return tuple(map(wide, found))

    def weighted(weights: Array | np.ndarray, ks: Array) -> Array:
        # Term by term: XLA's sum over the first axis would not fill vectors.
        total = weights[0] * ks[0]
        for i in range(1, 8):
            total = total + weights[i] * ks[i]
        return total

    def onward(solve: Array, f: tuple[Array, ...], extra: Array) -> Array:
        right = [f[j] + extra[j] for j in range(n)]
        total = solve[:, 0] * right[0]
        for j in range(1, n):
            total = total + solve[:, j] * right[j]
        return total

    def stage(carry: tuple[Array, Array], coefficients: tuple[Array, ...]) -> tuple[Any, None]:
        ks, _ = carry
        a, c, d, (i, node) = coefficients
        at = y0 + weighted(a, ks)
        extra = h * d * slope + weighted(c, ks) / h
        f = _stored(always, rates, t0 + node * h, at, leaves)
        k = _stored(always, onward, solve, f, extra)
        return (jax.lax.dynamic_update_slice(ks, k[None], (i.astype(int), 0, 0)), at), None

    coefficients = tuple(jnp.asarray(part) for part in TABLEAU)
    (ks, at), _ = jax.lax.scan(stage, (jnp.zeros((8, n, count)), y0), coefficients)
    bends = jnp.stack([weighted(weights, ks) for weights in DENSE])
    return at + ks[-1], ks[-1], bends


class Rodas5PTogether(Rodas5P):
    """Rodas5P that fills vectors with scenarios under `jax.vmap`; not to be differentiated."""

    def step(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: None, made_jump: Any) -> Any:
        # diffrax keeps the direction of time, an array, in the terms.
        leaves, rest = eqx.partition((terms, args), eqx.is_array)
        leaves, tree = jax.tree.flatten(leaves)
        back = lambda leaves: eqx.combine(jax.tree.unflatten(tree, leaves), rest)

        def field(leaves: Any, t: Array, y: Array) -> Array:
            terms, args = back(leaves)
            return terms.vf(t, y, args)

        @jax.custom_batching.custom_vmap
        def alone(leaves: list[Array], t0: Array, t1: Array, y0: Array) -> tuple[Array, Array, Array]:
            terms, args = back(leaves)
            found = Rodas5P.step(self, terms, t0, t1, y0, args, solver_state, None)
            return found[0], found[1], found[2]["bends"]

        @alone.def_vmap
        def _(count: int, batched: Any, leaves: list[Array], t0: Array, t1: Array, y0: Array) -> Any:
            flags = [bool(flag) for flag in batched[0]]
            last = lambda array, flag: jnp.moveaxis(array, 0, -1) if flag else array
            full = lambda array, flag: jnp.moveaxis(array, 0, -1) if flag else jnp.repeat(array[..., None], count, -1)
            t0, t1, y0 = (full(array, flag) for array, flag in zip((t0, t1, y0), batched[1:], strict=True))
            leaves = [last(array, flag) for array, flag in zip(leaves, flags, strict=True)]
            found = _lanes_step(field, count, flags, leaves, t0, t1 - t0, y0)
            return tuple(jnp.moveaxis(array, -1, 0) for array in found), (True, True, True)

        y1, error, bends = alone(leaves, t0, t1, y0)
        return y1, error, {"y0": y0, "y1": y1, "bends": bends}, None, diffrax.RESULTS.successful
