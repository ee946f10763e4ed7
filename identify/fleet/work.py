"""What happens in a process that computes: one record after another is read, computed and written to the store.

The process lives long and keeps its compiled programs. Whoever started it (`computer.py`) has set its threads before; it ends when
that one ends. Nothing heavy is imported before the first record.
"""

import os
import resource
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from thermohyd.identify.bench.errors import BenchInputError, one_line

from .identity import Found, Settings


LONGEST_REASON = 600


@dataclass(frozen=True)
class Task:
    """One record, and where its result goes. between: called after each record, to keep memory flat; reports: draw them too."""

    store: str
    found: Found
    settings: Settings
    reports: bool = False
    between: Callable[[], None] | None = None


@dataclass(frozen=True)
class Outcome:
    """state: done, failed (the store says why), stopped (nobody began it), changed (somebody wrote into its folder), or trouble:
    the run cannot go on."""

    identity: str
    state: str
    reason: str = ""
    seconds: float = 0.0
    memory: float = 0.0  # bytes that the process holds after it
    process: int = 0
    folder: str = ""


def begin(prepare: Callable[[], None] | None) -> None:
    """Called once in each process that computes: Ctrl-C is its parent's affair, and it outlives no parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a crash leaves a line in the store, no file of gigabytes
    import thermohyd.identify.bench.read
    import thermohyd.identify.fleet.store  # noqa: F401

    if prepare is not None:
        prepare()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def compute(task: Task) -> Outcome:
    """Read, compute, write. A record that cannot be used is a failure in the store, and no exception."""
    from thermohyd.identify.bench.read import read_record

    from .jobs import job_of

    began = time.monotonic()
    job = job_of(task.settings.job)
    record = _attempt(lambda: read_record(task.found.folder))
    result = _attempt(lambda: job(record, **task.settings.options)) if _sound(record) else None
    outcome = _settle(task, record, result, time.monotonic() - began)
    if task.between is not None and outcome.state in ("done", "failed"):
        task.between()
    return replace(outcome, memory=memory_of(os.getpid()), process=os.getpid())


def _attempt(work: Callable[[], Any]) -> Any:
    """What it returns, or the exception that it raised."""
    try:
        return work()
    except Exception as error:
        return error


def _sound(what: Any) -> bool:
    return not isinstance(what, Exception)


def _settle(task: Task, record: Any, result: Any, seconds: float) -> Outcome:
    """Write what became of a record: what was read and what was made of it, or the exception that stood in the way."""
    from .store import Store, StoreError

    identity = task.found.identity(task.settings)
    try:
        store = Store(task.store, make=False)
        row, report = _row(task, record, result, seconds)
        if row is None:
            what = f"{task.found.folder} changed while it was read; the next run takes it"
            return Outcome(identity, "changed", what, folder=task.found.folder)
        if report is not None:
            report.save(store.folder / "reports" / identity)
        row = _keep(task, store, row)
    except StoreError as error:
        return Outcome(identity, "trouble", str(error), folder=task.found.folder)
    except OSError as error:  # of the report's files
        what = f"the store cannot be written ({error.strerror or error})"
        return Outcome(identity, "trouble", what, folder=task.found.folder)
    state, reason = ("failed", row["reason"]) if "kind" in row else ("done", "")
    return Outcome(identity, state, reason, seconds, folder=task.found.folder)


def _keep(task: Task, store: Any, row: dict[str, Any]) -> dict[str, Any]:
    """What is now in the store: the row, or why it could not become one."""
    if "kind" not in row:
        try:
            store.write_result(row)
            return row
        except (
            TypeError,
            ValueError,
            ArithmeticError,
        ) as error:  # Arrow's are of these: a value of another kind than its column
            row = _failure(task, "failed", error)
    store.write_failure(row)
    return row


def _failure(task: Task, kind: str, error: Exception) -> dict[str, Any]:
    from .rows import failure_of

    return failure_of(task.found, task.settings, kind, in_words(error))


def _row(task: Task, record: Any, result: Any, seconds: float) -> tuple[dict[str, Any] | None, Any]:
    """(a row of results or of failures, the result where its report is wanted); (None, None) where the record is not what it was."""
    from .identity import look_at
    from .rows import row_of

    found, settings = task.found, task.settings
    report = result if task.reports and result is not None else None
    where = f"reports/{found.identity(settings)}" if report is not None else None
    if isinstance(record, Exception):
        row: Any = _failure(task, "unreadable", record)
    elif isinstance(result, Exception):
        row = _failure(task, "failed", result)
    else:
        row = _attempt(
            lambda: row_of(found, settings, record, {} if result is None else result.to_dict(), seconds, where)
        )
        row = row if _sound(row) else _failure(task, "failed", row)
    if look_at(Path(found.folder)).content != found.content:
        return None, None
    return row, None if "kind" in row else report


def in_words(error: Exception) -> str:
    """Why a record has no result, in one line."""
    if isinstance(error, BenchInputError):
        return str(error)
    if isinstance(error, MemoryError):
        return "not enough memory for this record"
    lines = str(error).strip().splitlines() or [""]
    return one_line(f"{type(error).__name__}: {lines[0]}".rstrip(": "))[:LONGEST_REASON]


def memory_of(process: int) -> float:
    """Bytes that a process holds; 0 where it is gone."""
    import psutil

    try:
        return float(psutil.Process(process).memory_info().rss)
    except psutil.Error:
        return 0.0
