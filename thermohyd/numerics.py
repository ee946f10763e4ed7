"""Numerics that every part shares: compiling with XLA options that this release knows, double precision, linear recursions.

Single precision is refused, because it gives wrong fits without any sign of it. A linear recursion along the rows of a sweep is
done in a few doublings: cheap to compile, cheap to run, differentiable.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


# Without the newer emitter of fused loops, which takes half the time of compiling a program of many small ones. JAX 0.12
# has no other and does not know that option: a run's program with derivatives takes 25 s of a core to compile there, 12 s with 0.10.0,
# and runs as fast.
OPTIONS: dict[str, Any] = {
    "xla_backend_optimization_level": 1,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_use_fusion_emitters": False,
}


@functools.cache
def _known(name: str, value: Any) -> bool:
    try:
        jax.jit(lambda x: x + 1.0, compiler_options={name: value}).lower(1.0).compile()
    except Exception:  # whatever a release of XLA calls an option that it does not know
        return False
    return True


def known_options(options: dict[str, Any]) -> dict[str, Any]:
    """Those of the options of XLA that this release knows."""
    return {name: value for name, value in options.items() if _known(name, value)}


def jitted(function: Callable, options: dict[str, Any]) -> Any:
    """`eqx.filter_jit` with these options of XLA."""
    filter_jit: Any = eqx.filter_jit  # its types do not know the keywords that it hands on to jax.jit
    return filter_jit(function, compiler_options=options)


def quickly[F: Callable](function: F) -> F:
    """`eqx.filter_jit`, compiled in half of the time (nine tenths with JAX 0.12); runs as fast. Nothing is asked of XLA
    before the first call."""

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
