"""The `thermohyd fleet` commands: many records on many workers, one store, what becomes of each valve. Needs the part `fleet`."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermohyd.identify.optional_parts import PARTS, install
from thermohyd.side_by_side import cores

from .loudness import Commands, Loudness, loudness
from .process import fail, plain_failures


if TYPE_CHECKING:
    from thermohyd.identify.fleet.run import Summary


app = typer.Typer(
    cls=Commands,
    help="Thousands of records: computed once each, kept in a store, looked at together.",
    no_args_is_help=True,
)

StoreFolder = Annotated[Path, typer.Argument(metavar="STORE", help="Folder of the store; `run` and `watch` make it.")]
Records = Annotated[
    list[str],
    typer.Option(
        "--records",
        metavar="DIR|GLOB",
        help="Folder with records at any depth, or a pattern in quotes; may be repeated.",
    ),
]
Job = Annotated[
    str, typer.Option("--job", metavar="WORD", help="What is done with each record: read, fit or diagnose.")
]
Cluster = Annotated[
    str,
    typer.Option(
        "--cluster", metavar="WHERE", help="local, the address of a dask scheduler, or the file that it wrote."
    ),
]
Workers = Annotated[int, typer.Option("--workers", min=0, help="Of a local cluster.", show_default="one per core")]
Reports = Annotated[bool, typer.Option("--reports", help="Also draw and keep each record's own report.")]
Seconds = Annotated[float, typer.Option("--time-limit", min=1.0, metavar="SECONDS", help="Of one record.")]
Memory = Annotated[
    float, typer.Option("--memory-limit", min=0.1, metavar="GB", help="Of the process that computes one record.")
]
Without = Annotated[
    str, typer.Option("--without", metavar="NAMES", help="Of a diagnosis: effects to leave out, with commas.")
]
Limits = Annotated[
    Path | None,
    typer.Option(
        "--limits", metavar="FILE", help='TOML: ["TYPE"] clearance = { max = "6 um" }; a type "*" holds for all.'
    ),
]
SAID_EVERY = 10.0  # s, where stderr is no terminal


@contextmanager
def _extra() -> Iterator[None]:
    """Say which packages are missing, instead of which module."""
    from thermohyd.identify.bench.errors import BenchInputError

    try:
        yield
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] in (*PARTS["fleet"], "dask"):
            raise BenchInputError(f"fleets need the package {error.name}: {install('fleet')}") from None
        raise


@app.command("run")
def run_command(
    store: StoreFolder,
    records: Records,
    job: Job = "fit",
    cluster: Cluster = "local",
    workers: Workers = 0,
    reports: Reports = False,
    again: Annotated[bool, typer.Option("--again", help="Also try records that failed before.")] = False,
    without: Without = "",
    time_limit: Seconds = 3600.0,
    memory_limit: Memory = 6.0,
) -> None:
    """Compute every record that the store does not hold yet. Whatever ends it, the same command goes on.

    Ctrl-C finishes what is being computed; a second one leaves at once, and no result is lost or half written either.
    """
    with plain_failures(), _extra():
        from thermohyd.identify.fleet.run import run_fleet

        summary: Summary = _with_store(
            store,
            lambda opened, progress, stop: run_fleet(
                opened,
                records,
                _settings(job, without),
                cluster=cluster,
                workers=workers or cores(),
                care=_care(job, time_limit, memory_limit),
                reports=reports,
                again=again,
                between=_between(job),
                progress=progress,
                stop=stop,
            ),
        )
        _say_summary(summary)
        _end(summary, store)


@app.command("watch")
def watch_command(
    store: StoreFolder,
    records: Annotated[Path, typer.Option("--records", metavar="DIR", help="Folder into which benches put records.")],
    job: Job = "fit",
    every: Annotated[float, typer.Option("--every", min=0.1, metavar="SECONDS", help="Between two looks.")] = 5.0,
    settle: Annotated[
        float, typer.Option("--settle", min=0.0, metavar="SECONDS", help="A folder must rest for so long to be taken.")
    ] = 10.0,
    reports: Reports = False,
    without: Without = "",
    out: Annotated[
        str | None, typer.Option("--out", "-o", metavar="DIR", help="Also keep the pages of `report` up to date.")
    ] = None,
    limits: Limits = None,
    time_limit: Seconds = 3600.0,
    memory_limit: Memory = 6.0,
) -> None:
    """Take each record that appears in a folder, once nobody writes into it any more. Ctrl-C ends it."""
    with plain_failures(), _extra():
        from thermohyd.identify.bench.errors import BenchInputError
        from thermohyd.identify.fleet.page import fleet_page
        from thermohyd.identify.fleet.remaining import read_limits
        from thermohyd.identify.fleet.store import Store
        from thermohyd.identify.fleet.watch import watch
        from thermohyd.identify.interruption import INTERRUPTED

        from .run_command import begin

        if not records.is_dir():
            raise BenchInputError("no such folder; --records takes one that is there, empty or not", file=records)
        folder, given = begin(out, False)[0], {} if limits is None else read_limits(limits)

        def show_page(opened: Store) -> None:
            if folder is not None:
                fleet_page(opened, folder, given)

        outcomes = _with_store(
            store,
            lambda opened, progress, stop: watch(
                opened,
                records,
                _settings(job, without),
                care=_care(job, time_limit, memory_limit),
                every=every,
                settle=settle,
                reports=reports,
                between=_between(job),
                progress=progress,
                after=None if folder is None else lambda: show_page(opened),
                stop=stop,
            ),
        )
        bad = sum(outcome.state == "failed" for outcome in outcomes)
        typer.echo(f"thermohyd: interrupted; {len(outcomes):,} records taken, {bad:,} of them failed", err=True)
        raise typer.Exit(INTERRUPTED)


@app.command("query")
def query_command(
    store: StoreFolder,
    sql: Annotated[str, typer.Argument(metavar="SQL", help='Such as "FROM records LIMIT 5"; views: docs/fleet.md.')],
    json: Annotated[bool, typer.Option("--json", help="Print rows as JSON on stdout.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print rows as CSV on stdout.")] = False,
) -> None:
    """Ask the store by SQL: views records, results, parameters, effects, faults, failures."""
    with plain_failures(), _extra():
        from thermohyd.identify.fleet.query import plain_rows, query
        from thermohyd.identify.fleet.store import Store

        opened = Store(store, make=False)
        answer = query(opened, sql)
        _say_set_aside(opened)
        if json:
            from json import dumps

            sys.stdout.write(dumps(plain_rows(answer), indent=2, allow_nan=False) + "\n")
        elif csv:
            answer.to_csv(sys.stdout, index=False)
        else:
            from thermohyd.identify.report.terminal import table

            from .process import consoles

            kinds = [">" if kind.kind in "iuf" else "~" for kind in answer.dtypes]
            rows = [[_cell(value) for value in row] for row in answer.itertuples(index=False)]
            consoles(False).results.print(table(tuple(k + str(c) for k, c in zip(kinds, answer, strict=True)), rows))


@app.command("life")
def life_command(
    store: StoreFolder,
    limits: Limits = None,
    json: Annotated[bool, typer.Option("--json", help="Print all valves as JSON on stdout.")] = False,
) -> None:
    """How each valve wears, what was done to it, and when it reaches a limit: those first that need attention."""
    with plain_failures(), _extra():
        from thermohyd.identify.fleet.life import fleet_life
        from thermohyd.identify.fleet.remaining import read_limits
        from thermohyd.identify.fleet.store import Store

        from .process import consoles
        from .several_records import progress_on

        given = {} if limits is None else read_limits(limits)
        shown = consoles(json)
        with progress_on(shown.notes, SAID_EVERY) as progress:
            opened = Store(store, make=False)
            life = fleet_life(opened, given, progress)
        _say_set_aside(opened)
        life.print_on(shown.results)
        if json:
            from .run_command import print_json

            print_json(life.to_dict())


@app.command("report")
def report_command(
    store: StoreFolder,
    out: Annotated[str, typer.Option("--out", "-o", metavar="DIR", help="Folder for the pages; made if need be.")],
    limits: Limits = None,
) -> None:
    """Static pages that work from a disk: all valves, worst first, each valve's life, each type's spread."""
    with plain_failures(), _extra():
        from thermohyd.identify.fleet.page import fleet_page
        from thermohyd.identify.fleet.remaining import read_limits
        from thermohyd.identify.fleet.store import Store

        from .run_command import begin, say_where
        from .several_records import progress_on

        folder, shown = begin(out, False)
        assert folder is not None
        given = {} if limits is None else read_limits(limits)
        with progress_on(shown.notes, SAID_EVERY) as progress:
            opened = Store(store, make=False)
            fleet_page(opened, folder, given, progress)
        _say_set_aside(opened)
        say_where(shown.results, folder, "index.html")


def _cell(value: Any) -> str:
    import math

    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _settings(job: str, without: str) -> Any:
    from thermohyd.identify.bench.errors import BenchInputError
    from thermohyd.identify.fleet.identity import Settings
    from thermohyd.identify.fleet.jobs import check_job

    names = sorted({name.strip() for name in without.split(",") if name.strip()})
    if names and job != "diagnose":
        raise BenchInputError("--without is for --job diagnose")
    return Settings(check_job(job), {"without": names} if names else {})


def _care(job: str, seconds: float, gigabytes: float) -> Any:
    from thermohyd.identify.fleet.computer import Care

    from .jax_setup import set_up_jax

    return Care(seconds=seconds, memory=gigabytes * 1e9, prepare=None if job == "read" else set_up_jax)


def _between(job: str) -> Any:
    from .jax_setup import keep_memory_flat

    return None if job == "read" else keep_memory_flat


def _with_store(folder: Path, work: Any) -> Any:
    """Work on an opened store, with progress on stderr, and Ctrl-C that asks first."""
    import threading

    from thermohyd.identify.fleet.store import Store, StoreError
    from thermohyd.identify.interruption import first_interrupt_asks

    from .process import consoles
    from .several_records import progress_on

    stop = threading.Event()
    try:
        opened = Store(folder)
        with progress_on(consoles(False).notes, SAID_EVERY) as progress, first_interrupt_asks(stop.set):
            done = work(opened, progress, stop)
        _say_set_aside(opened)
        return done
    except StoreError as error:
        fail(str(error))
        raise


def _say_set_aside(store: Any) -> None:
    for path, why in store.set_aside.items():
        typer.echo(f"thermohyd: warning: {path} {why}", err=True)


def _say_summary(summary: "Summary") -> None:
    from thermohyd.identify.bench.errors import one_line

    if loudness() is not Loudness.QUIET:
        _say_counts(summary)
    for note in summary.notes:
        typer.echo(f"thermohyd: warning: {one_line(note)}", err=True)


def _say_counts(summary: "Summary") -> None:
    from thermohyd.identify.fleet.run import in_time

    rate = f", {3600 * summary.done / summary.seconds:,.0f} an hour" if summary.done else ""
    typer.echo(
        f"{summary.done:,} of {summary.records:,} records computed in {in_time(summary.seconds)}{rate}", err=True
    )
    parts = [
        (summary.known, "were in the store before"),
        (summary.doubles, "have the content of another folder"),
        (summary.given_up, "failed in an earlier run and were not tried again (--again does)"),
        (len(summary.failed), "failed"),
        (summary.left, "are left"),
    ]
    for count, words in parts:
        if count:
            typer.echo(f"{count:,} {words}", err=True)


def _end(summary: "Summary", store: Path) -> None:
    """The exit status, and one line about what the run has to confess."""
    from thermohyd.identify.interruption import INTERRUPTED

    if summary.interrupted and not summary.trouble:
        typer.echo(
            f"thermohyd: interrupted; {summary.left:,} records are left, and the same command goes on with them",
            err=True,
        )
        raise typer.Exit(INTERRUPTED)
    if summary.trouble:
        fail(f"{summary.trouble}; {summary.left:,} records are left, and the same command goes on with them")
    if summary.failed:
        folder, reason = next(iter(summary.failed.items()))
        more = f'; `thermohyd fleet query {store} "FROM failures"` lists them' if len(summary.failed) > 1 else ""
        fail(f"{len(summary.failed):,} of {summary.records:,} records failed: {folder}: {reason}{more}")
