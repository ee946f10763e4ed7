"""Compute what a store does not hold yet, on the workers of a dask cluster, and survive whatever breaks on the way.

A chunk of records is one dask task. Each record's result is in the store before the next begins, so that a chunk that is run again,
because its worker died, computes what is missing and no more; and so does the next run, whatever ended this one.
"""

import contextlib
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .chunks import Deal, in_chunks
from .clusters import addresses, client_of
from .computer import Care, Computer
from .identity import Found, Settings, find_records, look_at
from .store import Store, StoreError
from .work import Outcome, Task


if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 2  # chunks that each worker is given: one that it computes, one that it need not wait for
ROUNDS = 3  # how often records whose task was lost are given out again while nothing gets done
WAIT_FOR_WORKERS = 300.0  # s, until the first worker of a cluster is there
STOPS = ".stop-"
Progress = Callable[[str], None]


@dataclass
class Summary:
    """What a run did. failed: {folder: reason}, of this run. left: records without a result or a failure."""

    records: int = 0
    known: int = 0  # whose result was there before
    doubles: int = 0  # folders whose content another folder has too
    done: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    given_up: int = 0  # that failed in an earlier run, and were not tried again
    left: int = 0
    seconds: float = 0.0
    interrupted: bool = False
    trouble: str = ""  # what ended the run before its end
    notes: list[str] = field(default_factory=list)
    memory: dict[int, list[float]] = field(default_factory=dict)  # {process: bytes after each of its records}


def run_fleet(
    store: Store,
    where: str | Path | Sequence[str | Path],
    settings: Settings,
    *,
    cluster: str = "local",
    workers: int = 1,
    care: Care | None = None,
    reports: bool = False,
    again: bool = False,
    between: Callable[[], None] | None = None,
    progress: Progress | None = None,
    stop: threading.Event | None = None,
) -> Summary:
    """Every record of `where` whose result of these settings is not in the store.

    cluster: `clusters.client_of`. care: of the processes that compute. reports: each record's own report too. again: also records
    that failed before. between: called in a process after each record. stop: once set, what is being computed is finished and
    nothing else begun. Raises BenchInputError where there is no record, no scheduler, or another run of this store is under way.
    """
    say = progress or (lambda words: None)
    began = time.monotonic()
    summary = Summary()
    with store.held():
        store.tidy()
        todo = _to_do(store, where, settings, again, summary, say)
        if todo:
            run = _Run(store, settings, care or Care(), reports, between, say, stop or threading.Event(), summary)
            try:
                with client_of(cluster, workers) as client:
                    run.all_of(todo, client, workers if cluster == "local" else None)
            finally:
                run.clear()
                _close_computers()
            summary.left = len(todo) - summary.done - len(summary.failed)
        with contextlib.suppress(StoreError):
            store.tidy()
    summary.seconds = time.monotonic() - began
    return summary


def _to_do(store: Store, where: Any, settings: Settings, again: bool, summary: Summary, say: Progress) -> list[Found]:
    folders = find_records(where)
    summary.records = len(folders)
    found: dict[str, Found] = {}
    for number, folder in enumerate(folders, 1):
        if number % 1000 == 0:
            say(f"looked at {number:,} of {len(folders):,} records")
        record = look_at(folder.absolute())
        found.setdefault(record.identity(settings), record)
    summary.doubles = len(folders) - len(found)
    done = store.done()
    failures = {row["identity"]: row for row in store.failures()}
    # A record that was repaired has another identity: its earlier failure is past.
    by_folder = {record.folder: identity for identity, record in found.items()}
    store.forget_failures(i for i, row in failures.items() if by_folder.get(row["path"], i) != i)
    summary.known = len(done & set(found))
    before = {i for i in found if i in failures and i not in done}
    summary.given_up = 0 if again else len(before)
    return [record for i, record in found.items() if i not in done and (again or i not in before)]


@dataclass
class _Run:
    store: Store
    settings: Settings
    care: Care
    reports: bool
    between: Callable[[], None] | None
    say: Progress
    stop: threading.Event
    summary: Summary
    name: str = field(default_factory=lambda: uuid.uuid4().hex)

    @property
    def flag(self) -> Path:
        """A file that tells workers anywhere to finish their record and begin no other."""
        return self.store.folder / f"{STOPS}{self.name}"

    def clear(self) -> None:
        with contextlib.suppress(OSError):
            self.flag.unlink(missing_ok=True)

    def all_of(self, todo: list[Found], client: "Client", workers: int | None) -> None:
        """Rounds: what a lost scheduler's or worker's task left is given out again, as long as something gets done."""
        left, lost = todo, 0
        while left and lost < ROUNDS and not self._ended:
            here = addresses(client, WAIT_FOR_WORKERS)
            if not here:
                self.summary.trouble = "the scheduler has no workers"
                return
            before = self.summary.done + len(self.summary.failed)
            self._round(left, client, workers or len(here))
            settled = self.summary.done + len(self.summary.failed) - before
            lost = 0 if settled else lost + 1
            done = self.store.done() | {row["identity"] for row in self.store.failures()}
            left = [found for found in left if found.identity(self.settings) not in done]
        if left and not self._ended:
            self.summary.trouble = f"{ROUNDS} times the workers died before they finished a record"

    @property
    def _ended(self) -> bool:
        return self.stop.is_set() or bool(self.summary.trouble)

    def _round(self, todo: list[Found], client: "Client", workers: int) -> None:
        deal = Deal(in_chunks(todo, workers))
        waiting: dict[Future, str] = {}
        began, settled, count = time.monotonic(), 0, len(todo)
        try:
            while True:
                if self.stop.is_set() and not self.flag.exists():
                    self._stop(waiting)
                if not self._ended:
                    self._give_out(deal, waiting, client)
                if not waiting:
                    return
                for future in _settled(waiting):
                    waiting.pop(future)
                    settled += self._take(future)
                    self._say(settled, count, time.monotonic() - began)
                if client.status not in ("running", "connecting"):
                    raise OSError("closed")
        except Exception as error:
            if not _lost_scheduler(error, client):
                raise
            self.summary.trouble = "the connection to the scheduler is lost"

    def _give_out(self, deal: Deal, waiting: "dict[Future, str]", client: "Client") -> None:
        if not len(deal):
            return
        busy = list(waiting.values())
        for worker in addresses(client):
            for _ in range(AHEAD - busy.count(worker)):
                chunk = deal.next_for(worker)
                if chunk is None:
                    return
                tasks = [Task(str(self.store.folder), f, self.settings, self.reports, self.between) for f in chunk]
                future = client.submit(
                    compute_chunk, tasks, self.care, str(self.flag), workers=[worker], allow_other_workers=True, pure=False,
                    key=f"records-{uuid.uuid4().hex}",
                )  # fmt: skip
                waiting[future] = worker

    def _stop(self, waiting: "dict[Future, str]") -> None:
        self.summary.interrupted = True
        try:
            self.flag.touch()
        except OSError:  # a full disk: then chunks go on to their end
            self.stop.clear()
            self.summary.trouble = "interrupted, but the store cannot be written"

    def _take(self, future: "Future") -> int:
        """Count what a chunk's task says. A task that was lost says nothing: the next round asks the store."""
        if future.status != "finished":
            return 0
        outcomes: list[Outcome] = future.result()
        for outcome in outcomes:
            if outcome.state == "done":
                self.summary.done += 1
                if outcome.process:
                    self.summary.memory.setdefault(outcome.process, []).append(outcome.memory)
            elif outcome.state == "failed":
                self.summary.failed[outcome.folder] = outcome.reason
            elif outcome.state == "trouble":
                self.summary.trouble = outcome.reason
            elif outcome.state == "changed":
                self.summary.notes.append(outcome.reason)
        return sum(outcome.state != "stopped" for outcome in outcomes)

    def _say(self, settled: int, count: int, seconds: float) -> None:
        rate = settled / max(seconds, 1e-9)
        left = "" if not settled or settled == count else f", {in_time((count - settled) / rate)} left"
        bad = f", {len(self.summary.failed)} failed" if self.summary.failed else ""
        ending = "finishing what is being computed: " if self.stop.is_set() else ""
        self.say(f"{ending}{settled:,} of {count:,} records{bad}, {3600 * rate:,.0f} an hour{left}")


def _settled(waiting: "dict[Future, str]") -> Iterator["Future"]:
    """Futures that hold something, after a short wait for one."""
    from distributed import wait

    with contextlib.suppress(TimeoutError):
        wait(list(waiting), timeout=0.2, return_when="FIRST_COMPLETED")
    yield from [future for future in waiting if future.status != "pending"]


def _lost_scheduler(error: Exception, client: "Client") -> bool:
    from concurrent.futures import CancelledError

    from distributed.comm.core import CommClosedError

    return isinstance(error, OSError | CancelledError | CommClosedError) or client.status != "running"


def compute_chunk(tasks: Sequence[Task], care: Care, flag: str) -> list[Outcome]:
    """The dask task: records in the process beside this worker. What an earlier try of this chunk wrote is not computed again."""
    computer = _computer(care)
    outcomes: list[Outcome] = []
    for task in tasks:
        # Asked for each record anew: the one before it may have been long, or the last that the disk took.
        stopped = Path(flag).exists() or any(outcome.state == "trouble" for outcome in outcomes)
        state = "stopped" if stopped else "done" if _kept(task) else ""
        identity = task.found.identity(task.settings)
        outcomes.append(Outcome(identity, state, folder=task.found.folder) if state else computer.compute(task))
    return outcomes


def _kept(task: Task) -> bool:
    return Store(task.store, make=False).has(task.found.identity(task.settings))


_computers: list[Computer] = []  # of the workers in this process


def _close_computers() -> None:
    while _computers:
        _computers.pop().close()


def _computer(care: Care) -> Computer:
    """The one of this worker; its process ends when the worker is closed."""
    from distributed import get_worker

    worker: Any = get_worker()
    computer = getattr(worker, "thermohyd_computer", None)
    if computer is None or computer.care != care:
        if computer is not None:
            computer.close()
        computer = worker.thermohyd_computer = Computer(care)
        _computers.append(computer)
    return computer


def in_time(seconds: float) -> str:
    """As people say it: "40 s", "12 min", "3.2 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
