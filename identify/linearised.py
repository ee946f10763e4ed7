"""One linearisation of a least-squares problem, and the steps it offers: damped, inside a box, full Gauss-Newton.

Björck, "Solving linear least squares problems by Gram-Schmidt orthogonalization", BIT 7, 1967: of [J r] it is stable.
Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978, for the damping.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Linearisation(NamedTuple):
    """The problem at an accepted point: R of J = Q R, c = Q'r, and what they say. Cost is r'r."""

    residual: Float[Array, " m"]
    columns: Float[Array, "n m"]  # J transposed: its columns lie contiguous in memory
    triangle: Float[Array, "n n"]
    projection: Float[Array, " n"]
    cost: Float[Array, ""]


def triangular(columns: Float[Array, "n m"], residual: Float[Array, " m"]) -> tuple[Array, Array]:
    """R (n, n) and Q'r (n,) by modified Gram-Schmidt of [J r].

    Not LAPACK: its threads take 0.1 to 15 ms for 3000 rows where other threads run, this 0.09 ms. Not the normal
    equations: they square the condition number, and a valve's weak directions stand at 1e3 to 1e6.
    """
    n = columns.shape[0]

    def sweep(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        rest, triangle = carry
        length = jnp.sqrt(jnp.sum(rest[k] ** 2))
        unit = rest[k] / jnp.where(length > 0.0, length, 1.0)
        row = jnp.where(jnp.arange(n + 1) >= k, jnp.sum(rest * unit, axis=1), 0.0)
        return rest - row[:, None] * unit, triangle.at[k].set(row)

    start = jnp.concatenate([columns, residual[None, :]]), jnp.zeros((n, n + 1), columns.dtype)
    _, triangle = jax.lax.fori_loop(0, n, sweep, start)
    return triangle[:, :n], triangle[:, n]


def damped_step(triangle: Array, projection: Array, size: Array, radius: Array) -> Array:
    """s minimising |R s + c| under |D s| <= radius, D = diag(size), by Moré's iteration on the singular values."""
    left, values, right = jnp.linalg.svd(triangle / size)
    alive = values > len(size) * jnp.finfo(values.dtype).eps * values[0]
    values, loads = jnp.where(alive, values, 0.0), jnp.where(alive, left.T @ projection, 0.0)
    squares = jnp.where(alive, values**2, 1.0)

    def improve(_: Array, damping: Array) -> Array:
        # Newton on 1/|s|, concave in the damping: from the left it never overshoots the root.
        length = jnp.sqrt(jnp.sum((values * loads / (squares + damping)) ** 2))
        decline = jnp.sum((values * loads) ** 2 / (squares + damping) ** 3)
        more = length**2 / jnp.where(decline > 0.0, decline, 1.0) * (length - radius) / radius
        return damping + jnp.where(length > 1.1 * radius, more, 0.0)

    damping = jax.lax.fori_loop(0, 12, improve, jnp.zeros((), values.dtype))
    return -(right.T @ (values * loads / (squares + damping))) / size


def boxed_step(
    z: Array, at: Linearisation, size: Array, radius: Array, lower: Array, upper: Array, held: Array
) -> Array:
    """A damped step; a variable that would leave the box stops on its wall and the others are solved again."""
    fixed = jnp.where(held, 0.0, jnp.nan)

    def solve(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        fixed, _, _ = state
        still = ~jnp.isnan(fixed)
        known = jnp.where(still, fixed, 0.0)
        step = damped_step(jnp.where(still, 0.0, at.triangle), at.projection + at.triangle @ known, size, radius)
        step = jnp.where(still, known, step)
        wall = jnp.clip(z + step, lower, upper) - z
        out = ~still & ((z + step < lower) | (z + step > upper))
        return jnp.where(out, wall, fixed), step, jnp.any(out)

    _, step, _ = jax.lax.while_loop(lambda state: state[2], solve, (fixed, jnp.zeros_like(z), jnp.array(True)))
    return step


def offset_and_step(at: Linearisation, held: Array, size: Array) -> tuple[Array, Array]:
    """Bates and Watts' relative offset of the free variables, and their full Gauss-Newton step."""
    triangle = jnp.where(held, 0.0, at.triangle)
    # Held columns leave a triangle of lower rank in which only part of c belongs to the free ones: that part is U'c.
    left, values, right = jnp.linalg.svd(triangle / size)
    alive = values > len(size) * jnp.finfo(values.dtype).eps * values[0]
    loads = jnp.where(alive, left.T @ at.projection, 0.0)
    step = -(right.T @ (loads / jnp.where(alive, values, 1.0))) / size
    count = jnp.maximum(jnp.sum(alive.astype(values.dtype)), 1.0)
    explained = jnp.sum(loads**2)
    rest = jnp.maximum(at.cost - explained, 0.0) / jnp.maximum(at.residual.size - count, 1.0)
    tiny = jnp.finfo(values.dtype).tiny
    return jnp.sqrt(explained / count / jnp.maximum(rest, tiny)), step


def linearise(fn: Any, z: Array, args: Any) -> tuple[Array, Array, Any]:
    """Residual (m,), the Jacobian's columns (n, m) by forward mode, and aux, with one evaluation of the primal."""
    push = lambda direction: jax.jvp(lambda y: fn(y, args), (z,), (direction,), has_aux=True)
    return jax.vmap(push, out_axes=(None, 0, None))(jnp.eye(z.size, dtype=z.dtype))
