"""Linear recursions along the rows of a sweep, as a few doublings: cheap to compile, cheap to run, differentiable."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def linear_recursion(
    keep: Float[Array, "*#lead rows"], source: Float[Array, "*#lead rows"]
) -> Float[Array, "*#lead rows"]:
    """y with y_i = keep_i y_(i-1) + source_i along the last axis, y = 0 before the first row.

    Recursive doubling in one loop (Hillis and Steele, Communications of the ACM 29, 1986): of logarithmic depth like
    `jax.lax.associative_scan`, but one loop body to compile instead of one tree for every call.
    """
    keep = jnp.broadcast_to(keep, source.shape)
    rows = jnp.arange(source.shape[-1])

    def double(i: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        reach, so_far = carry
        step = 2**i
        before = lambda values: jnp.where(rows >= step, jnp.roll(values, step, axis=-1), 0.0)
        return reach * before(reach), so_far + reach * before(so_far)

    doublings = max(source.shape[-1] - 1, 1).bit_length()
    return jax.lax.fori_loop(0, doublings, double, (keep, source))[1]
