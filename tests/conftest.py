"""Double precision and strict promotion for every test; hypothesis without deadlines and with fixed examples."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path


# Nearly all of the suite's time is XLA's, compiling: without its dearer passes it takes less of it, and programs run as fast.
# Set before JAX is imported, here and in the processes that tests start; the pinned jaxlib knows these flags.
FLAGS = "--xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true"
os.environ["XLA_FLAGS"] = f"{FLAGS} {os.environ.get('XLA_FLAGS', '')}"

import jax  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
# What one worker compiled the other need not, nor the next run of the suite.
jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parents[1] / "build" / "compiled-for-tests"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")


@pytest.fixture(scope="module", autouse=True)
def programs_are_let_go() -> Iterator[None]:
    """Compiled programs end with the file that needed them: a worker that keeps them all grows to 5 GB and then dies.

    Each holds a dozen memory maps, and Linux gives a process 65,530 of them (vm.max_map_count): beyond that, compiling ends
    in a segmentation fault. What another file needs again is read from the cache on disk.
    """
    yield
    jax.clear_caches()
    gc.collect()
