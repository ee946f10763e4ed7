"""A bench drops folders of records: each appears in the store once nobody writes into it any more.

Folders are looked at again and again, which works on network drives too. A folder is whole when it has a bench.toml, every file
that it names, and when neither names nor sizes nor times have changed since the last look and for `settle` seconds. A name that
begins with a dot or an underscore is somebody's way to say "not yet".
"""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from thermohyd.identify.bench.errors import BenchInputError

from .computer import Care, Computer
from .identity import Settings, find_records, look_at, named_files
from .store import Store, StoreError
from .work import Outcome, Task


Signature = tuple[tuple[str, int, int], ...]
Progress = Callable[[str], None]


@dataclass
class Watched:
    """What is known of the folders so far. waiting: {folder: why it is not taken yet}."""

    settle: float
    signatures: dict[Path, Signature] = field(default_factory=dict)
    taken: dict[Path, Signature] = field(default_factory=dict)
    waiting: dict[Path, str] = field(default_factory=dict)

    def whole(self, top: str | Path, now: float) -> list[Path]:
        """Folders beneath `top` that are new or changed, and whole. now: as `time.time()`."""
        try:
            folders = find_records(top)
        except BenchInputError:  # nothing there yet, or the drive is away
            folders = []
        self.waiting = {}
        ready = []
        for folder in folders:
            seen = signature_of(folder)
            if self.taken.get(folder) == seen:
                continue
            before, self.signatures[folder] = self.signatures.get(folder), seen
            missing = [name for name, path in named_files(folder) if not path.is_file()]
            if missing:
                self.waiting[folder] = f"{missing[0]} is missing"
            elif before != seen or now - max((at for _, _, at in seen), default=0) * 1e-9 < self.settle:
                self.waiting[folder] = "is being written"
            else:
                ready.append(folder)
        return ready


def signature_of(folder: Path) -> Signature:
    """Names, sizes and times [ns] of the files in a folder; empty where it has gone."""
    try:
        found = [(path.name, path.stat()) for path in folder.iterdir()]
    except OSError:
        return ()
    return tuple(sorted((name, stat.st_size, stat.st_mtime_ns) for name, stat in found))


def watch(
    store: Store,
    top: str | Path,
    settings: Settings,
    *,
    care: Care | None = None,
    every: float = 5.0,
    settle: float = 10.0,
    reports: bool = False,
    between: Callable[[], None] | None = None,
    progress: Progress | None = None,
    after: Callable[[], None] | None = None,
    stop: threading.Event | None = None,
) -> list[Outcome]:
    """Take what appears beneath `top` until `stop` is set; what became of each record. One process computes, one at a time.

    every [s]: between looks. after: called when new results are in the store, such as to write its page. Raises BenchInputError
    where a run of this store is under way, StoreError where it cannot be written.
    """
    stop, say = stop or threading.Event(), progress or (lambda words: None)
    watched, outcomes, computer = Watched(settle), [], Computer(care or Care())
    with store.held():
        known = store.done() | {row["identity"] for row in store.failures()}
        try:
            while not stop.is_set():
                new = 0
                for folder in watched.whole(top, time.time()):
                    if stop.is_set():
                        break
                    seen = watched.signatures[folder]
                    found = look_at(folder.absolute())
                    if found.identity(settings) not in known:
                        say(f"computing {folder}")
                        outcome = computer.compute(Task(str(store.folder), found, settings, reports, between))
                        if outcome.state == "trouble":
                            raise StoreError(outcome.reason)
                        if outcome.state == "changed":
                            continue
                        outcomes.append(outcome)
                        known.add(outcome.identity)
                        new += 1
                    watched.taken[folder] = seen
                if new:
                    with contextlib.suppress(StoreError):
                        store.tidy()
                    if after is not None:
                        after()
                say(_in_words(watched, len(outcomes)))
                stop.wait(every)
        finally:
            computer.close()
    return outcomes


def _in_words(watched: Watched, count: int) -> str:
    words = f"watching: {count:,} records taken"
    if watched.waiting:
        folder, why = next(iter(watched.waiting.items()))
        words += f", {len(watched.waiting):,} not whole yet ({folder.name}: {why})"
    return words
