"""Linear systems of a machine's few states, solved without LAPACK.

XLA's calls of LAPACK share a large batch out to the threads of the pool that they run on, and wait there (jaxlib 0.10): two programs that
run at the same time, as in two threads of a user's process, then wait for each other for ever.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact


def solved(matrix: Inexact[Array, "... n n"], right: Inexact[Array, "... n"]) -> Inexact[Array, "... n"]:
    """x with matrix x = right, each of a batch by itself, real or complex; derivatives by the same solve.

    A singular matrix gives no numbers.
    """
    return jax.lax.custom_linear_solve(
        lambda x: jnp.sum(matrix * x[..., None, :], axis=-1),
        right,
        lambda _, b: _eliminated(matrix, b),
        lambda _, b: _eliminated(jnp.swapaxes(matrix, -1, -2), b),
    )


def _eliminated(matrix: Inexact[Array, "... n n"], right: Inexact[Array, "... n"]) -> Inexact[Array, "... n"]:
    """Gauss-Jordan elimination with the largest pivot of each column (Golub and Van Loan, Matrix Computations, section 3.4)."""
    n = matrix.shape[-1]
    batch = jnp.broadcast_shapes(matrix.shape[:-2], right.shape[:-1])
    both = jnp.concatenate(
        [jnp.broadcast_to(matrix, (*batch, n, n)), jnp.broadcast_to(right, (*batch, n))[..., None]], axis=-1
    )
    rows = np.arange(n)

    def without(k: Array, both: Array) -> Array:
        at = lambda values, axis: jax.lax.dynamic_index_in_dim(values, k, axis, keepdims=False)
        size = jnp.where(rows < k, -1.0, jnp.abs(at(both, -1)))
        largest = rows == jnp.argmax(size, axis=-1)[..., None]
        pivot, own = jnp.sum(jnp.where(largest[..., None], both, 0.0), axis=-2), at(both, -2)
        both = jnp.where(largest[..., None], own[..., None, :], both)
        pivot = pivot / at(pivot, -1)[..., None]
        rest = both - at(both, -1)[..., None] * pivot[..., None, :]
        return jnp.where((rows == k)[:, None], pivot[..., None, :], rest)

    # A loop: written out it was one in twenty-five of the equations of a run's program.
    both = jax.lax.fori_loop(0, n, without, both)
    return both[..., n]


def inverses(matrices: Float[Array, "n n count"]) -> Float[Array, "n n count"]:
    """`inverse` of many matrices, side by side along the last axis: a loop over columns, without a derivative of its own."""
    n = matrices.shape[0]
    position = jnp.arange(n)

    def eliminate(k: Array, matrices: Array) -> Array:
        pivotal = position == k
        row = jax.lax.dynamic_index_in_dim(matrices, k, 0, keepdims=False)
        column = jax.lax.dynamic_index_in_dim(matrices, k, 1, keepdims=False)
        pivot = 1.0 / jax.lax.dynamic_index_in_dim(row, k, 0, keepdims=False)
        row = jnp.where(pivotal[:, None], 1.0, row) * pivot
        rest = jnp.where(pivotal[None, :, None], 0.0, matrices) - column[:, None] * row[None]
        return jnp.where(pivotal[:, None, None], row[None], rest)

    return jax.lax.fori_loop(0, n, eliminate, matrices)


@jax.custom_jvp
def inverse(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Gauss-Jordan without pivoting, for matrices that hold their diagonal up: n rank-one updates in place, the same for every batch and
    device."""
    n = matrix.shape[0]
    for k in range(n):
        unit = np.eye(n)[k]
        pivot = 1.0 / matrix[k, k]
        # Row k of the tableau with its pivot column replaced by the unit column of the inverse.
        row = (matrix[k] * (1.0 - unit) + unit) * pivot
        column = matrix[:, k] * (1.0 - unit)
        matrix = (matrix * (1.0 - unit)[None, :]) * (1.0 - unit)[:, None] + unit[:, None] * row - column[:, None] * row
    return matrix


@inverse.defjvp
def _inverse_jvp(primals, tangents):
    found = inverse(primals[0])
    return found, -found @ tangents[0] @ found
