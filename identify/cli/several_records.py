"""Run one command on several records: all are read before any is computed, and one that fails does not lose the others.

While it works the command shows a live line on a terminal, a few plain lines elsewhere.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.errors import BenchInputError, quoted
from thermohyd.identify.bench.read import read_record, record_folder
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.interruption import when_interrupted
from thermohyd.identify.report.files import checked_folder
from thermohyd.identify.result import Result

from .jax_setup import keep_memory_flat
from .loudness import Loudness, loudness
from .process import in_words, wants_the_whole_story


Progress = Callable[[str], None]


@dataclass
class Outcome[Found: Result]:
    """What became of each record, by the name of its folder."""

    results: dict[str, Found] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)  # {name: reason}
    folders: dict[str, Path] = field(default_factory=dict)  # {name: where its files were written}


def read_records(benches: Sequence[Path], out: Path | None, progress: Progress) -> dict[str, BenchRecord]:
    """{name of the folder: record}. Raises BenchInputError for the first bad one, where two would share a folder of
    results, and where one's folder of results cannot be written."""
    names = _names([record_folder(bench) for bench in benches], out)
    if out is not None and len(names) > 1:
        for name in names:
            checked_folder(str(out / name))
    records = {}
    for name, bench in zip(names, benches, strict=True):
        progress(f"reading {bench}")
        records[name] = read_record(bench)
    return records


def _names(benches: Sequence[Path], out: Path | None) -> list[str]:
    first: dict[str, Path] = {}
    names = []
    for bench in benches:
        name = bench.resolve().name or "record"
        if name in first:
            if out is not None:
                raise BenchInputError(
                    f"has the folder name {quoted(name)} of another record of this command, {first[name]}: the results of both "
                    f"would go to {out / name}. Rename one, or give each a command of its own",
                    file=bench,
                )
            name = str(bench) if str(bench) not in first else f"{bench} ({len(names) + 1})"
        first[name] = bench
        names.append(name)
    return names


def compute_all[Found: Result](
    records: Mapping[str, BenchRecord],
    compute: Callable[[BenchRecord, Progress], Found],
    out: Path | None,
    progress: Progress,
) -> Outcome[Found]:
    """Compute each record, and write its files as soon as it is done: DIR itself for one record, DIR/<name> for several.

    What a single record raises passes through; of several, a failure is kept in words and the others go on.
    """
    outcome: Outcome[Found] = Outcome()
    took: list[float] = []
    for number, (name, record) in enumerate(records.items(), 1):
        began = time.monotonic()
        left = time_left(took, len(records) - number + 1)
        before = f"record {number} of {len(records)}, {name}{left}: " if len(records) > 1 else ""
        try:
            result = compute(record, _said(progress, before))
            if out is not None:
                progress(f"{before}drawing")
                folder = out / name if len(records) > 1 else out
                result.save(folder)
                outcome.folders[name] = folder
            outcome.results[name] = result
        except Exception as error:
            if len(records) == 1 or wants_the_whole_story():
                raise
            outcome.failed[name] = in_words(error)
        took.append(time.monotonic() - began)
        if number < len(records):
            keep_memory_flat()
    return outcome


def time_left(took: Sequence[float], left: int) -> str:
    """ ", about 4 min left": of so many records, by the seconds that those before took; empty before the first is done.

    The first one compiles what the others share, so it counts only while it is alone.
    """
    if not took:
        return ""
    each = took[0] if len(took) == 1 else sum(took[1:]) / (len(took) - 1)
    seconds = each * left
    words = f"{max(round(seconds), 1)} s" if seconds < 90 else f"{round(seconds / 60)} min"
    return f", about {words} left"


def _said(progress: Progress, before: str) -> Progress:
    return lambda words: progress(before + words)


def confession[Found: Result](outcome: Outcome[Found], missed: Iterable[tuple[str, str]]) -> str:
    """What the command has to confess at its end, in one sentence; empty where all went well.

    missed: (name, reason) of the records that gave a result, but not a good one.
    """
    reasons = {**outcome.failed, **dict(missed)}
    if len(outcome.results) == 1 and not outcome.failed:
        return next(iter(reasons.values()), "")
    if not reasons:
        return ""
    words = "; ".join(f"{name}: {reason}" for name, reason in reasons.items())
    return f"{len(reasons)} of {len(outcome.results) + len(outcome.failed)} records failed: {words}"


# Where stderr is a file, only a run that takes long says that it is alive.
SILENT_SECONDS = 10.0


@contextmanager
def progress_on(console: Console, every: float | None = None) -> Iterator[Callable[[str], None]]:
    """A function that takes a sentence about what is going on now; the live line vanishes at the end. --quiet: nothing;
    --verbose: every sentence on a line that stays, with the seconds since the start.

    every [s]: of work that speaks all the time: how often it is heard where stderr is a file, from the first second on.
    """
    if loudness() is Loudness.QUIET:
        yield lambda words: None
        return
    began = time.monotonic()
    if loudness() is Loudness.VERBOSE:
        yield lambda words: console.print(Text(f"{time.monotonic() - began:7.1f} s  {words}"), soft_wrap=True)
        return
    if console.is_terminal:
        with console.status(Text("starting")) as status, when_interrupted(status.stop):
            yield lambda words: status.update(Text(words))
        return

    silent_until = began + (SILENT_SECONDS if every is None else 1.0)

    def say(words: str) -> None:
        nonlocal silent_until
        if time.monotonic() > silent_until:
            console.print(Text(f"{words} ..." if every is None else words), soft_wrap=every is not None)
            silent_until = silent_until if every is None else time.monotonic() + every

    yield say
