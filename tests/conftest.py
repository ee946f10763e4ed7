"""Double precision and strict promotion for every test; hypothesis without deadlines and with fixed examples."""

import gc
import os
from collections.abc import Iterator
from pathlib import Path


# Nearly all of the suite's time is XLA's, compiling: without its dearer passes it takes less of it, and programs run as fast.
# The algebraic simplifier alone takes half the time of a large derivative. Set before JAX is imported, here and in the
# processes that tests start; the pinned jaxlib knows these flags.
FLAGS = "--xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true --xla_disable_hlo_passes=algsimp"
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


# Each compiled program holds a dozen memory maps, and Linux gives a process 65,530 (vm.max_map_count): a worker that keeps
# all its programs grows to 5 GB and then dies of a segmentation fault while it compiles.
MOST_MAPS = 12_000


@pytest.fixture(scope="module", autouse=True)
def programs_are_let_go() -> Iterator[None]:
    """After a test file the compiled programs go, if they are many; what another file needs again is on disk."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()
        gc.collect()
