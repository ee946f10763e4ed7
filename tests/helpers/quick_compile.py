"""Compile quickly rather than well: for tests that run a large program once, or a few times briefly."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import jax


QUICKEST = {
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
    "xla_cpu_parallel_codegen_split_count": 1,
    "xla_disable_hlo_passes": "algsimp",
}
# jax.jit for functions of arrays and Modules of arrays. A step test's program takes a quarter of the time to compile and
# runs half as long again.
quick_jit: Callable[..., Callable] = partial(jax.jit, compiler_options=QUICKEST)


@contextmanager
def quick_compile() -> Iterator[None]:
    """Programs compiled inside are not optimised: a fifth of the time to compile, several times as long to run."""
    jax.config.update("jax_disable_most_optimizations", True)
    try:
        yield
    finally:
        jax.config.update("jax_disable_most_optimizations", False)
