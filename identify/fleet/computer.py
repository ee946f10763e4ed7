"""A process of its own beside each dask worker, which computes one record at a time: whatever a record does to it, the worker lives.

Which record killed a process is then known and not guessed, and so is how: by a signal, by its memory, by its time. The process is
spawned, with its threads set before it starts; it lives for many records, and a new one takes its place before it grows too large.
"""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from typing import Any

from .rows import failure_of
from .store import Store, StoreError
from .work import Outcome, Task, begin, compute, memory_of


# One record, one core: a fleet has more records than cores. XLA takes its number of threads from NPROC.
ONE_THREAD = {
    name: "1"
    for name in (
        "NPROC",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "POLARS_MAX_THREADS",
    )
}
LOOKED_AT = 0.25  # s, between looks at the memory of a process that computes
TOLD_WITHIN = 10.0  # s: how a process ended is known a moment after it has ended, unless the machine is very busy
_environment = threading.Lock()


@dataclass(frozen=True)
class Care:
    """When a process that computes is replaced, and a record given up.

    strikes: processes that a record may kill. seconds, memory [bytes]: of one record, beyond which its process is killed. recycle
    [bytes]: a process that holds more after a record is replaced. prepare: called once in each process, such as one that sets JAX up.
    """

    strikes: int = 3
    seconds: float = 3600.0
    memory: float = 6e9
    recycle: float = 1.5e9
    prepare: Callable[[], None] | None = None


class Computer:
    """Computes tasks in a process that it starts, watches, and replaces. Of one thread at a time."""

    def __init__(self, care: Care) -> None:
        self.care = care
        self._pool: ProcessPoolExecutor | None = None
        self._process = 0
        self._processes: list[BaseProcess] = []
        self.started = 0  # processes so far

    def compute(self, task: Task) -> Outcome:
        """What became of a record. One that kills its process is tried again, up to the number of strikes, then it is a failure."""
        kind, reason = "", ""
        for _ in range(self.care.strikes):
            try:
                self._start()
            except BrokenProcessPool:
                what = f"a process that computes cannot be started: it ended {self._how_it_ended()}"
                return Outcome(task.found.identity(task.settings), "trouble", what, folder=task.found.folder)
            assert self._pool is not None
            future = self._pool.submit(compute, task)
            kind, reason = self._wait(future)
            if not reason:
                outcome = future.result()
                if outcome.memory > self.care.recycle:
                    self.close()
                return outcome
            self.close()
        reason = (
            f"{reason}; {self.care.strikes} processes that computed it ended so" if self.care.strikes > 1 else reason
        )
        failure = failure_of(task.found, task.settings, kind, reason, self.care.strikes)
        try:
            Store(task.store, make=False).write_failure(failure)
        except StoreError as error:
            return Outcome(failure["identity"], "trouble", str(error))
        return Outcome(failure["identity"], "failed", reason, folder=task.found.folder)

    def _wait(self, future: "Future[Any]") -> tuple[str, str]:
        """("", "") once the future holds an outcome, else what ended the process and in which words."""
        deadline = time.monotonic() + self.care.seconds
        while True:
            try:
                future.exception(timeout=LOOKED_AT)
            except TimeoutError:
                if time.monotonic() > deadline:
                    return "too long", f"took longer than {self.care.seconds:g} s"
                if memory_of(self._process) > self.care.memory:
                    return "too much memory", f"needed more than {self.care.memory / 1e9:g} GB of memory"
                continue
            if isinstance(future.exception(), BrokenProcessPool):
                return "crashed", f"its process ended {self._how_it_ended()}"
            return "", ""

    def _how_it_ended(self) -> str:
        # The pool's own thread waits for the process, too. The system tells one of the two how it ended, and the other, which may come
        # first, sees nothing until that one has written it down.
        deadline = time.monotonic() + TOLD_WITHIN
        while True:
            for process in self._processes:
                process.join(LOOKED_AT)
                code = process.exitcode
                if code is not None:
                    return f"by signal {-code}" if code < 0 else f"with status {code}"
            if time.monotonic() > deadline:
                return "for an unknown reason"
            time.sleep(0.01)

    def _start(self) -> None:
        if self._pool is not None:
            return
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, context, begin, (self.care.prepare,))
        with _with_environment(ONE_THREAD):
            first = self._pool.submit(os.getpid)
        self._processes = list((self._pool._processes or {}).values())
        self._process = first.result()
        self.started += 1

    def close(self) -> None:
        """End the process, whatever it is doing."""
        if self._pool is None:
            return
        for process in self._processes:
            with suppress(OSError, ValueError):
                process.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None


@contextmanager
def _with_environment(extra: dict[str, str]) -> Iterator[None]:
    """Within, processes start with these variables, unless the user has set them."""
    with _environment:
        added = {name: value for name, value in extra.items() if name not in os.environ}
        os.environ.update(added)
        try:
            yield
        finally:
            for name in added:
                del os.environ[name]
