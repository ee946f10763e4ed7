"""Double precision and strict promotion for every test; hypothesis without deadlines and with fixed examples."""

import gc
import importlib
import os
from collections import defaultdict
from collections.abc import Callable
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any


# Nearly all of the suite's time is XLA's, compiling: without its dearer passes it takes less of it, and programs run as fast.
# The algebraic simplifier alone takes two fifths of the time of a large derivative. Set before JAX is imported, here and in the
# processes that tests start; the pinned jaxlib knows these flags.
FLAGS = "--xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true --xla_disable_hlo_passes=algsimp"
if version("jaxlib").startswith("0.10."):  # a flag that XLA does not know ends the process
    FLAGS += " --xla_cpu_use_fusion_emitters=false"
os.environ["XLA_FLAGS"] = f"{FLAGS} {os.environ.get('XLA_FLAGS', '')}"

# Workers share the cores. Threads of a linear algebra library that wait for each other do so at full speed: two workers on two cores
# took twice as long as with one thread each. NPROC is what XLA takes its number of threads from.
for threads in ("OPENBLAS_NUM_THREADS", "NPROC"):
    os.environ.setdefault(threads, "1")

import jax  # noqa: E402
import pytest  # noqa: E402
from beartype import BeartypeConf  # noqa: E402
from beartype.claw import beartype_package  # noqa: E402
from hypothesis import settings  # noqa: E402
from jaxtyping import install_import_hook  # noqa: E402


# Every call is checked: for shapes where a module writes any, which takes ten times as long, for types alone elsewhere. Names that
# only a type checker imports do not stop the first of the two.
package = Path(str(find_spec("thermohyd").origin)).parent  # pyright: ignore[reportOptionalMemberAccess]
with_shapes = [
    "thermohyd." + ".".join(file.relative_to(package).with_suffix("").parts)
    for file in package.rglob("*.py")
    if any(words in file.read_text(encoding="utf-8") for words in ("from jaxtyping import", "if TYPE_CHECKING"))
]
install_import_hook(with_shapes, "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))")
beartype_package("thermohyd", conf=BeartypeConf(is_pep484_tower=True, claw_is_pep526=False, violation_type=TypeError))

from thermohyd.identify.cli.jax_setup import compilation_cache, drop_programs  # noqa: E402
from thermohyd.kept_programs import keep_in  # noqa: E402


jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
# What one worker compiled the other need not, nor the next run of the suite. Programs are written whole, and what decides one is in its
# name: they serve other checkouts, too. JAX's own entries may be cut short by a killed run, and none is written again: each checkout has
# its own.
jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parents[1] / "build" / "compiled-for-tests"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
keep_in(compilation_cache("programs-of-tests"))

# Tracing makes millions of objects that live: at the usual threshold a twentieth of the time goes into looking for garbage.
gc.set_threshold(100_000, 20, 20)

settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")


# Each compiled program holds a dozen memory maps, and Linux gives a process 65,530 (vm.max_map_count): a worker that keeps
# all its programs grows to 5 GB and then dies of a segmentation fault while it compiles.
MOST_MAPS = 8_000  # after a test file
MOST_WITHIN = 20_000  # between the tests of a file


# These take half of the suite's time. A worker that met one of them last would keep all others waiting.
LONGEST_FIRST = (
    "test_end_to_end.py", "test_whole_servo.py", "test_named_motion_effect.py", "test_other_law.py", "test_stored_oil.py",
    "test_users_effects.py", "test_small_diagnoses.py", "test_recovery.py", "test_unequal_jack.py", "test_readme.py",
    "test_dynamics_gradients.py", "test_sensitivities.py", "test_fit.py", "test_stored_ports.py", "test_controller_output.py",
    "test_sensitivity_command.py", "test_bench_faults.py", "test_sensors_in_motion.py", "test_port_storage.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first; the others in the order of their names."""
    place = {name: i for i, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


@pytest.fixture
def of_benchmarks(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Any]:
    """A module of benchmarks/ by its name."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
    return importlib.import_module


compiled_since = 0  # the list of maps was read, which takes milliseconds once they are many
compiling: defaultdict[str, float] = defaultdict(float)  # seconds that XLA took, by test file
running = ""
DEAREST = 20


def count_compiled(event: str, duration_secs: float, **kwargs: str | int) -> None:
    global compiled_since
    if event == "/jax/core/compile/backend_compile_duration":
        compiled_since += 1
        compiling[running] += duration_secs


jax.monitoring.register_event_duration_secs_listener(count_compiled)


def pytest_runtest_logstart(nodeid: str) -> None:
    global running
    running = nodeid.partition("::")[0]


def pytest_sessionfinish(session: pytest.Session) -> None:
    output = getattr(session.config, "workeroutput", None)  # None in the process that hands tests out
    if output is not None:
        output["compiling"] = dict(compiling)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    for file, seconds in getattr(node, "workeroutput", {}).get("compiling", {}).items():
        compiling[file] += seconds


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Files whose programs took XLA longest: what to look at when the suite grows slow. Processes that tests start are not counted."""
    terminalreporter.section(f"compiled for {sum(compiling.values()):.0f} s, most of it for")
    for file, seconds in sorted(compiling.items(), key=lambda one: -one[1])[:DEAREST]:
        terminalreporter.line(f"{seconds:7.1f} s  {file}")


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """The compiled programs go once they are many; what is needed again is on disk."""
    global compiled_since
    within = nextitem is not None and nextitem.path == item.path
    if within and compiled_since < 100:  # a hundred programs hold some thousand maps
        return
    compiled_since = 0
    maps = Path("/proc/self/maps")
    most = MOST_WITHIN if within else MOST_MAPS
    if maps.exists() and maps.read_bytes().count(b"\n") > most:
        drop_programs()
