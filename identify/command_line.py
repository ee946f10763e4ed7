"""The `thermohyd` command. Whatever is heavy is imported inside the commands: `--help` must not wait for JAX."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .exit_status import fail, plain_failures


if TYPE_CHECKING:
    from rich.console import Console


app = typer.Typer(
    name="thermohyd",
    help="Servovalve models from test-bench curves. A bench record is a folder with bench.toml and one CSV per test.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Bench = Annotated[Path, typer.Argument(metavar="BENCH", help="Folder of the bench record, or its bench.toml.")]
Out = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results; made if need be.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout, and nothing else there.")]


def _print_version(wanted: bool) -> bool:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"thermohyd {version('thermohyd')}")
        raise typer.Exit
    return wanted


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Options of every command."""


@app.command("fit")
def fit_command(bench: Bench, out: Out = None, json: Json = False) -> None:
    """Find edge radius, clearance, underlap, discharge coefficient, transition number and null bias, with error bars.

    With --out: fit.json, model.json (for simulate), report.html and one plot per test as PNG and SVG.
    """
    with plain_failures():
        from .progress import progress_on
        from .read_record import read_record
        from .terminal_report import print_report

        console = _console()
        with progress_on(console) as progress:
            progress(f"reading {bench}")
            record = read_record(bench)
            progress("starting JAX")
            _set_up_jax()
            from .fit import fit

            result = fit(record, progress=progress)
            if out is not None:
                from .fit_files import fit_files
                from .write_files import write_all

                progress("drawing")
                files = fit_files(result)
                write_all(out, files)
        print_report(result, console)
        if out is not None:
            _say_where(console, out, "report.html")
        if json:
            from .fit_json import fit_json

            _print_json(fit_json(result))
        if not result.converged:
            fail(f"the fit did not converge: {result.message}")


@app.command("simulate")
def simulate_command(
    bench: Bench,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", "-m", metavar="FILE", help="model.json of a fit; without it, the record's own [start]."
        ),
    ] = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Predict each row of a record from a fitted model; the record needs no readings.

    With --out: one CSV per test, the record's columns with <reading>_predicted and <reading>_predicted_std added.
    """
    with plain_failures():
        from .model_file import load_model, nominal_model
        from .progress import progress_on
        from .read_record import read_record

        console = _console()
        with progress_on(console) as progress:
            progress(f"reading {bench}")
            record = read_record(bench, readings_required=False)
            chosen = nominal_model(record) if model is None else load_model(model)
            progress("starting JAX")
            _set_up_jax()
            from .predict import simulate_record
            from .simulation_output import simulation_files, simulation_json, simulation_table

            tables = simulate_record(record, chosen, progress=progress)
            if out is not None:
                from .write_files import write_all

                write_all(out, simulation_files(tables))
        console.print(simulation_table(tables))
        if out is not None:
            _say_where(console, out, *(f"{test}.csv" for test in tables))
        if json:
            _print_json(simulation_json(tables))


@app.command("new")
def new_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; it must not hold a record yet.")],
) -> None:
    """Write a template record to fill in; it fits as it stands."""
    with plain_failures():
        from .new_record import write_template

        write_template(folder)
        _say_where(_console(), folder, "bench.toml")


def _console() -> "Console":
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def _print_json(content: dict[str, Any]) -> None:
    from .fit_json import json_text

    sys.stdout.write(json_text(content))
    sys.stdout.flush()  # here a full disk or a closed pipe still gets its sentence


def _say_where(console: "Console", folder: Path, *names: str) -> None:
    # plain text, unwrapped: a path must survive copy and paste
    for name in names:
        console.print(f"written: {folder / name}", markup=False, soft_wrap=True)


def _set_up_jax() -> None:
    from .jax_setup import set_up_jax

    set_up_jax()


def main() -> None:
    """Entry point of the `thermohyd` command."""
    app(prog_name="thermohyd")
