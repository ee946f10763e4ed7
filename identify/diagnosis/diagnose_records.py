"""Diagnose the records of one command: all are read before any is computed, and one that fails does not lose the others."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import BenchInputError, quoted
from ..exit_status import in_words, interrupted, wants_the_whole_story
from ..read_record import read_record
from ..record import BenchRecord
from ..write_files import write_all
from .result import DiagnosisResult


Progress = Callable[[str], None]


@dataclass
class Outcome:
    """What became of each record, by the name of its folder."""

    results: dict[str, DiagnosisResult] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)  # {name: reason}
    folders: dict[str, Path] = field(default_factory=dict)  # {name: where its files were written}


def read_records(benches: Sequence[Path], out: Path | None, progress: Progress) -> dict[str, BenchRecord]:
    """{name of the folder: record}. Raises BenchInputError for the first bad one, and where two would share a folder
    of results."""
    names = _names(benches, out)
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
                    f"would go to {out / name}. Rename one, or diagnose them apart",
                    file=bench,
                )
            name = str(bench) if str(bench) not in first else f"{bench} ({len(names) + 1})"
        first[name] = bench
        names.append(name)
    return names


def diagnose_all(
    records: dict[str, BenchRecord],
    diagnose: Callable[[BenchRecord, Progress], DiagnosisResult],
    files: Callable[[DiagnosisResult], dict[str, bytes | str]],
    out: Path | None,
    progress: Progress,
) -> Outcome:
    """Compute each record, and write its files as soon as it is done: DIR itself for one record, DIR/<name> for several.

    What a single record raises passes through; of several, a failure is kept in words and the others go on.
    """
    outcome = Outcome()
    for number, (name, record) in enumerate(records.items(), 1):
        before = f"record {number} of {len(records)}, {name}: " if len(records) > 1 else ""
        try:
            result = diagnose(record, _said(progress, before))
            if out is not None:
                progress(f"{before}drawing")
                folder = out / name if len(records) > 1 else out
                write_all(folder, files(result))
                outcome.folders[name] = folder
            outcome.results[name] = result
        except KeyboardInterrupt:
            if not outcome.folders:
                raise
            interrupted(f"interrupted; complete are only: {', '.join(outcome.folders)}")
        except Exception as error:
            if len(records) == 1 or wants_the_whole_story():
                raise
            outcome.failed[name] = in_words(error)
    return outcome


def _said(progress: Progress, before: str) -> Progress:
    return lambda words: progress(before + words)


def unsettled(outcome: Outcome) -> str:
    """What the command has to confess at its end, in one sentence; empty where all went well."""
    missed = {
        name: f"the fit did not converge: {result.after.message}"
        for name, result in outcome.results.items()
        if not result.after.converged
    }
    reasons = {**outcome.failed, **missed}
    if len(outcome.results) == 1 and not outcome.failed:
        return next(iter(reasons.values()), "")
    if not reasons:
        return ""
    words = "; ".join(f"{name}: {reason}" for name, reason in reasons.items())
    return f"{len(reasons)} of {len(outcome.results) + len(outcome.failed)} records failed: {words}"
