"""How the command line sets JAX up: double precision, quiet, with the user's own compilation cache. Never at import."""

import contextlib
import gc
import os
import sys
import time
import warnings
from pathlib import Path

from platformdirs import user_cache_dir

from thermohyd.identify.interruption import always_when_interrupted


# Compiled programs of old versions pile up; beyond this the oldest go.
LARGEST_CACHE = 512 * 1024**2  # bytes
# An entry this young may still be in the writing when the process is interrupted.
UNFINISHED = 2.0  # s
# A process that holds more drops its compiled programs before the next record. Blocks of rows take 20 to 60 MB for each kind of test
# and reading, and there are three or four of each (plain, usual effects, lines, heat), whatever the records; what ties rows together
# has programs for each of a few lengths, and so have runs in motion. What compiling them took is given back before.
MOST_MEMORY = 1.5e9  # bytes


def set_up_jax() -> None:
    """Import JAX the way every command needs it. Call it before anything else imports JAX or equinox.

    Run-time checks inside compiled code are off: they are host callbacks, and JAX caches no program that holds one.
    Records are checked before, result codes after.
    """
    os.environ.setdefault("EQX_ON_ERROR", "off")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # else a line per cache hit on some processors (jax #38445)
    import jax

    jax.config.update("jax_enable_x64", True)
    if os.environ["EQX_ON_ERROR"] == "off":
        from thermohyd.kept_programs import keep_in

        keep_in(compilation_cache("programs"))
    chosen = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if chosen is not None:  # the user's own choice, and JAX runs what lies there
        if "://" not in chosen and _own(Path(chosen), of_jax=True) is None:
            jax.config.update("jax_compilation_cache_dir", None)
        return
    folder = compilation_cache("jax")
    if folder is not None:
        always_when_interrupted(lambda: drop_unfinished(folder))
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
        warnings.filterwarnings("ignore", message=".*persistent compilation cache.*")


def compilation_cache(kind: str) -> Path | None:
    """The user's own folder for compiled programs, made if need be; None where it cannot be written, and where anybody else can write
    to it (`thermohyd.own_files`), with one warning: what is found there is run.

    kind: "jax", what XLA made of a traced program; "programs", those that need no tracing (`kept_programs`).
    """
    folder = _own(Path(user_cache_dir("thermohyd")) / kind, of_jax=kind == "jax")
    if folder is not None:
        _prune(folder)
    return folder


def _own(folder: Path, *, of_jax: bool) -> Path | None:
    """of_jax: JAX reads and writes there, and asks nobody's file. `kept_programs` looks at each file before it reads it."""
    from thermohyd.own_files import NotOwnError, check_own_entries, make_own_folder, say_not_own

    try:
        make_own_folder(folder)
        if of_jax:
            check_own_entries(folder)
    except NotOwnError as error:
        say_not_own(error)
        return None
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.R_OK | os.W_OK | os.X_OK) else None


def keep_memory_flat() -> None:
    """Between records: let the compiled programs go once they are many, so that records of one shape share theirs.

    What is needed again is on disk (`kept_programs`), and read in a fraction of a second each.
    """
    if "jax" not in sys.modules:
        return
    from thermohyd.kept_programs import give_memory_back

    gc.collect()
    give_memory_back()
    if resident_memory() > MOST_MEMORY:
        drop_programs()


def drop_programs() -> None:
    """Let JAX's compiled programs go, and give their memory back to the system."""
    import jax

    from thermohyd.kept_programs import forget, give_memory_back

    forget()
    jax.clear_caches()
    gc.collect()
    give_memory_back()


def resident_memory() -> float:
    """Bytes of memory that this process holds; infinite where the system does not say."""
    try:
        return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return float("inf")


def drop_unfinished(folder: Path) -> None:
    """Remove the entries that may be cut short: JAX never writes an entry again that exists, nor can it read such a one."""
    for file in folder.iterdir():
        with contextlib.suppress(OSError):
            if time.time() - file.stat().st_mtime < UNFINISHED:
                file.unlink()


def _prune(folder: Path) -> None:
    # JAX's own size limit stops working for good once a process was killed between its two writes per entry
    with contextlib.suppress(OSError):
        files = sorted((file.stat().st_mtime, file.stat().st_size, file) for file in folder.iterdir())
        size = sum(bytes_ for _, bytes_, _ in files)
        for _, bytes_, file in files:
            if size <= LARGEST_CACHE:
                break
            file.unlink(missing_ok=True)
            size -= bytes_
