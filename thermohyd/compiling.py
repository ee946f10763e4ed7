"""How programs are compiled: with options of XLA that this release knows, and large ones quickly."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax


# Without the newer emitter of fused loops, which takes half the time of compiling a program of many small ones. JAX 0.12
# has no other and does not know that option: the programs that fit data/seed_actuator take 37 s of a core to compile
# there, 24 s with 0.10, and a fit with programs compiled before takes 0.8 s of a core instead of 1.3 s.
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
