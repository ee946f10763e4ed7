"""Numerics that every part shares: compiling with XLA options that this release knows, double precision, linear recursions.

Single precision is refused, because it gives wrong fits without any sign of it. A linear recursion along the rows of a sweep is
run in blocks side by side: cheap to compile, cheap to run, differentiable.
"""

import functools
import math
import os
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .kept_programs import KeptProgram


# Without the newer emitter of fused loops, which takes half the time of compiling a program of many small ones. JAX 0.12
# has no other and does not know that option: a run's program with derivatives takes 25 s of a core to compile there, 12 s with 0.10.0,
# and runs as fast.
OPTIONS: dict[str, Any] = {
    "xla_backend_optimization_level": 1,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_use_fusion_emitters": False,
}
# For programs that a search runs thousands of times: with the newer emitter they take 1.7 times as long to compile, and three quarters
# of the time to run: 0.6 ms for 512 rows of a leakage curve with 30 derivatives, where they take 0.8.
OFTEN: dict[str, Any] = OPTIONS | {"xla_cpu_use_fusion_emitters": True}
# For programs that run a few dozen times: unoptimised they take a third of the time to compile and three times as long to run.
SELDOM: dict[str, Any] = OPTIONS | {"xla_backend_optimization_level": 0}


@functools.cache
def _known(name: str, value: Any) -> bool:
    try:
        jax.jit(lambda x: x + 1.0, compiler_options={name: value}).lower(1.0).compile()
    except Exception:  # whatever a release of XLA calls an option that it does not know
        return False
    return True


def known_options(options: dict[str, Any]) -> dict[str, Any]:
    """Those of the options of XLA that this release knows, without those that the user's XLA_FLAGS say."""
    said = os.environ.get("XLA_FLAGS", "")
    return {name: value for name, value in options.items() if f"--{name}=" not in said and _known(name, value)}


def jitted(function: Callable, options: dict[str, Any], stands_on: tuple[Any, ...] = ()) -> KeptProgram:
    """`eqx.filter_jit` with these options of XLA; kept on disk where the command line has named a folder (`KeptProgram`)."""
    return KeptProgram(function, options, stands_on)


def kept[F: Callable](function: F) -> F:
    """`eqx.filter_jit` as it is, but kept on disk."""
    return KeptProgram(function, {})  # pyright: ignore[reportReturnType]  # the same signature


def quickly[F: Callable](function: F) -> F:
    """`eqx.filter_jit`, compiled in half of the time (nine tenths with JAX 0.12); a search then runs a quarter longer, a
    public function of static tests 1.7 times as long. Nothing is asked of XLA before the first call."""

    @functools.cache
    def compiled() -> Any:
        return jitted(function, known_options(OPTIONS))

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        return compiled()(*args)

    return call  # pyright: ignore[reportReturnType]  # the same signature


def require_float64(what: str) -> None:
    """Raise RuntimeError with one sentence unless JAX computes in float64; the library never changes that flag itself."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            f'{what} needs double precision: call jax.config.update("jax_enable_x64", True) before making any array'
        )


def linear_recursion(
    keep: Float[Array, "*#lead rows"], source: Float[Array, "*#lead rows"]
) -> Float[Array, "*#lead rows"]:
    """y with y_i = keep_i y_(i-1) + source_i along the last axis, y = 0 before the first row."""
    return recursion_in_blocks(keep, source, jnp.ones(()), jnp.multiply, jnp.multiply)


def recursion_in_blocks(
    keep: Float[Array, "... rows"],
    source: Float[Array, "... rows"],
    one: Float[Array, "..."],
    follow: Callable[[Array, Array], Array],
    chain: Callable[[Array, Array], Array],
) -> Float[Array, "... rows"]:
    """y of the shape of `source` with y_i = follow(keep_i, y_(i-1)) + source_i along the last axis, y = 0 before the first row.

    follow: keep times y; chain: one keep after another; both also of several rows at once; `one`: the keep that changes nothing.
    Blocks of rows are run through side by side from 0, then the blocks one behind the other, and each row is given what its
    block began with: three passes over the values, however many rows. Recursive doubling takes one per factor of two, 4 to 15
    times as long for 36 columns of 1,000 to 20,000 rows.
    """
    rows = source.shape[-1]
    length = max(math.isqrt(rows), 1)
    blocks = -(-rows // length)

    def in_blocks(values: Array) -> Array:
        filled = jnp.concatenate(
            [values, jnp.zeros((*values.shape[:-1], blocks * length - rows), values.dtype)], axis=-1
        )
        return jnp.moveaxis(filled.reshape(*values.shape[:-1], blocks, length), -1, 0)

    def next_row(
        before: tuple[Array, Array], row: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        reach, own = chain(row[0], before[0]), follow(row[0], before[1]) + row[1]
        return (reach, own), (reach, own)

    def next_block(start: Array, block: tuple[Array, Array]) -> tuple[Array, Array]:
        return follow(block[0], start) + block[1], start

    keeps, sources = in_blocks(keep), in_blocks(source)
    begin = jnp.broadcast_to(one, keeps.shape[1:]).astype(keeps.dtype), jnp.zeros_like(sources[0])
    _, (reach, own) = jax.lax.scan(next_row, begin, (keeps, sources))
    by_block = lambda values: jnp.moveaxis(values[-1], -1, 0)[..., None]
    _, starts = jax.lax.scan(next_block, jnp.zeros_like(by_block(own)[0]), (by_block(reach), by_block(own)))
    begun = jnp.moveaxis(starts[..., 0], 0, -1)
    found = jax.vmap(lambda reach: follow(reach, begun))(reach) + own
    return jnp.moveaxis(found, 0, -1).reshape(*source.shape[:-1], -1)[..., :rows]
