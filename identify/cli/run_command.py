"""What the commands share: the folder of --out, JAX and progress before the work; words, files and JSON after it. No JAX here."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .process import fail, plain_failures


if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rich.console import Console

    from thermohyd.identify.bench.record import BenchRecord
    from thermohyd.identify.diagnosis.result import DiagnosisResult
    from thermohyd.identify.fitting.result import FitResult
    from thermohyd.identify.result import Result

    from .process import Consoles
    from .several_records import Outcome

    Progress = Callable[[str], None]
    # what is done with each record, the table of several results, and what is to be said of those that failed
    Work = tuple[Callable[[BenchRecord, Progress], Any], Callable[[Any, Console], None], Callable[[Any], str]]


def of_each_record(benches: list[Path], out: str | None, json: bool, work: "Callable[[], Work]") -> None:
    """The frame of a command that does one thing with every record. work: called once JAX may be imported."""
    with plain_failures():
        from .jax_setup import set_up_jax
        from .several_records import compute_all, progress_on, read_records

        folder, consoles = begin(out, json)
        with progress_on(consoles.notes) as progress:
            records = read_records(benches, folder, progress)
            progress("starting JAX")
            set_up_jax()
            compute, print_table, unsettled = work()
            outcome = compute_all(records, compute, folder, progress)
        show_records(outcome, len(records), consoles, json, print_table)
        if trouble := unsettled(outcome):
            fail(trouble)


def run_study[Found: "Result"](
    out: str | None,
    json: bool,
    page: str,
    prepare: "Callable[[Progress], Callable[[Progress], Found]]",
    warnings: "Callable[[Found], Iterable[str]]" = lambda study: (),
) -> "Found":
    """The frame of a study, which it returns. prepare: reads what it is about, before JAX starts, and gives what computes it."""
    with plain_failures():
        from .jax_setup import set_up_jax
        from .several_records import progress_on

        folder, consoles = begin(out, json)
        with progress_on(consoles.notes) as progress:
            compute = prepare(progress)
            progress("starting JAX")
            set_up_jax()
            study = compute(progress)
            save(study, folder, progress)
        show(study, folder, consoles, json, page, warnings=warnings(study))
    return study


def load_users_effects(folder: Path | None) -> None:
    """Effects of the user's own, from the folder that was named and from installed packages, and one line on stderr for each."""
    import typer

    from thermohyd.identify.bench.errors import one_line
    from thermohyd.identify.users_effects import load_effects, load_entry_points, loaded_words

    loaded = {f"the package {package}": names for package, names in load_entry_points().items()}
    if folder is not None:
        loaded[str(folder)] = load_effects(folder)
    for source, names in loaded.items():
        typer.echo(f"thermohyd: {one_line(loaded_words(names, source))}", err=True)


def begin(out: str | None, json: bool) -> "tuple[Path | None, Consoles]":
    """(the folder of --out, checked before any work is done for it; where words go)"""
    from thermohyd.identify.report.files import checked_folder

    from .process import consoles

    return checked_folder(out), consoles(json)


def save(result: "Result", folder: Path | None, progress: "Callable[[str], None]") -> None:
    """Draw and write, where --out names a folder."""
    if folder is not None:
        progress("drawing")
        result.save(folder)


def show(
    result: "Result", folder: Path | None, consoles: "Consoles", json: bool, *names: str, warnings: "Iterable[str]" = ()
) -> None:
    """A result in words, where those of its files are that a user opens, and JSON."""
    result.print_on(consoles.results)
    consoles.warn(warnings)
    if folder is not None:
        say_where(consoles.results, folder, *names)
    if json:
        print_json(result.to_dict())


def show_records(
    outcome: "Outcome[FitResult] | Outcome[DiagnosisResult]",
    count: int,
    consoles: "Consoles",
    json: bool,
    print_table: "Callable[[Any, Console], None]",
) -> None:
    """Results of one record or a table of several, where their files are, their warnings, and JSON of all."""
    if count > 1:
        print_table(outcome.results, consoles.results)
    else:
        for result in outcome.results.values():
            result.print_on(consoles.results)
    for folder in outcome.folders.values():
        say_where(consoles.results, folder, "report.html")
    for name, result in outcome.results.items():
        consoles.warn(result.warnings, name if count > 1 else "")
    if json:
        from .several_results import json_of_several

        (only,) = outcome.results.values() if count == 1 else (None,)
        print_json(json_of_several(outcome) if only is None else only.to_dict())


def print_json(content: dict[str, Any]) -> None:
    from thermohyd.identify.report.fit_json import json_text

    sys.stdout.write(json_text(content))
    sys.stdout.flush()  # here a full disk or a closed pipe still gets its sentence


def say_where(console: "Console", folder: Path, *names: str) -> None:
    # plain text, unwrapped: a path must survive copy and paste
    for name in names:
        console.print(f"written: {folder / name}", soft_wrap=True)
