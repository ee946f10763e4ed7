"""How programs are compiled: with options of XLA that this release knows, and large ones quickly."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax


F = TypeVar("F", bound=Callable)
# Without the newer emitter of fused loops, which takes half the time of compiling a program of many small ones.
OPTIONS: dict[str, Any] = {
    "xla_backend_optimization_level": 1,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_use_fusion_emitters": False,
}


@functools.cache
def _known(options: tuple[tuple[str, Any], ...]) -> bool:
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=dict(options)).lower(1.0).compile()
    except Exception:  # whatever a release of XLA calls an option that it does not know
        return False
    return True


def known_options(options: dict[str, Any]) -> dict[str, Any]:
    """The options of XLA where this release knows them all, else none."""
    return options if _known(tuple(options.items())) else {}


def jitted(function: Callable, options: dict[str, Any]) -> Any:
    """`eqx.filter_jit` with these options of XLA."""
    filter_jit: Any = eqx.filter_jit  # its types do not know the keywords that it hands on to jax.jit
    return filter_jit(function, compiler_options=options)


def quickly(function: F) -> F:
    """`eqx.filter_jit`, compiled in half of the time; runs as fast. Nothing is asked of XLA before the first call."""

    @functools.cache
    def compiled() -> Any:
        return jitted(function, known_options(OPTIONS))

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        return compiled()(*args)

    return call  # pyright: ignore[reportReturnType]  # the same signature
