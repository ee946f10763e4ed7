"""The `thermohyd` command. Whatever is heavy is imported inside the commands: `--help` must not wait for JAX."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .process import fail, plain_failures


if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rich.console import Console

    from thermohyd.identify.diagnosis.result import DiagnosisResult
    from thermohyd.identify.fitting.result import FitResult
    from thermohyd.identify.result import Result

    from .process import Consoles
    from .several_records import Outcome


app = typer.Typer(
    name="thermohyd",
    help="Servovalve models from test-bench curves. A bench record is a folder with bench.toml and one CSV per test.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

Bench = Annotated[Path, typer.Argument(metavar="BENCH", help="Folder of the bench record, or its bench.toml.")]
Benches = Annotated[
    list[Path],
    typer.Argument(
        metavar="BENCH", help="Folders of one or more bench records, or their bench.toml.", show_default=False
    ),
]
Out = Annotated[  # text: of an empty one a Path would make the working directory
    str | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results; made if need be.")
]
Source = Annotated[
    Path | None,
    typer.Argument(
        metavar="[BENCH|MODEL]",
        help="A bench record, which is fitted first, or a model.json. Without it: the valve of the seed paper.",
    ),
]
InsteadOfFit = Annotated[
    Path | None,
    typer.Option(
        "--model", "-m", metavar="FILE", help="model.json to use with a record's conditions instead of a fit."
    ),
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
def fit_command(benches: Benches, out: Out = None, json: Json = False) -> None:
    """Find edge radius, clearance, underlap, discharge coefficient, transition number and null bias, with error bars.

    With --out: fit.json, model.json (for simulate), report.html and one plot per test as PNG and SVG; several records get a
    folder each, DIR/<name of the record's folder>.
    """
    with plain_failures():
        from .several_records import compute_all, progress_on, read_records

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            records = read_records(benches, folder, progress)
            progress("starting JAX")
            _set_up_jax()
            from thermohyd.identify.fitting.fit import fit

            outcome = compute_all(records, lambda record, say: fit(record, progress=say), folder, progress)
        from .several_results import print_summary_of_fits, unsettled

        _show_records(outcome, len(records), consoles, json, print_summary_of_fits)
        trouble = unsettled(outcome)
        if trouble:
            fail(trouble)


@app.command("diagnose")
def diagnose_command(
    benches: Benches,
    out: Out = None,
    json: Json = False,
    learn: Annotated[
        bool,
        typer.Option(
            "--learn", help="Where no effect explains the gap, add a smooth empirical term to the model and say so."
        ),
    ] = False,
) -> None:
    """Find where bench and ideal valve disagree, name the missing effects, add them, and show the gap shrink.

    With --out: diagnosis.json, model.json (for simulate), report.html and the plots as PNG and SVG; several records get
    a folder each, DIR/<name of the record's folder>.
    """
    with plain_failures():
        from .several_records import compute_all, progress_on, read_records

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            records = read_records(benches, folder, progress)
            progress("starting JAX")
            _set_up_jax()
            from thermohyd.identify.diagnosis.diagnose import diagnose

            outcome = compute_all(
                records, lambda record, say: diagnose(record, learn=learn, progress=say), folder, progress
            )
        from .several_results import print_summary_of_many, unsettled_diagnoses

        _show_records(outcome, len(records), consoles, json, print_summary_of_many)
        trouble = unsettled_diagnoses(outcome)
        if trouble:
            fail(trouble)


def _show_records(
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
        _say_where(consoles.results, folder, "report.html")
    for name, result in outcome.results.items():
        consoles.warn(result.warnings, name if count > 1 else "")
    if json:
        from .several_results import json_of_several

        (only,) = outcome.results.values() if count == 1 else (None,)
        _print_json(json_of_several(outcome) if only is None else only.to_dict())


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
    """Predict each row of a record from a fitted model; the record needs no readings. Its oil, stroke and slot width count.

    With --out: one CSV per test, the record's columns with <reading>_predicted and <reading>_predicted_std added, and
    outside_fitted_range where rows lie outside what the model was fitted to.
    """
    with plain_failures():
        from thermohyd.identify.bench.read import read_record
        from thermohyd.identify.model.model_file import load_model, nominal_model

        from .several_records import progress_on

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            progress(f"reading {bench}")
            record = read_record(bench, readings_required=False)
            from thermohyd.identify.model.simulation_output import spare_the_record

            spare_the_record(record, folder)
            progress("starting JAX")
            _set_up_jax()  # first: effects in a model file are checked against the library of effects, which brings JAX
            chosen = nominal_model(record) if model is None else load_model(model)
            from thermohyd.identify.model.predict import simulate

            found = simulate(record, chosen, progress=progress)
            if folder is not None:
                found.save(folder)
        _show(found, folder, consoles, json, *(f"{test}.csv" for test in found.tables), warnings=found.warnings)


@app.command("seed")
def seed_command(out: Out = None, json: Json = False) -> None:
    """Reproduce the paper that this program grew from: its Figures 3 to 8, its Eq. 6, and every claim: holds or not.

    With --out: seed.html, the figures as PNG and SVG, seed.json, eq6.json (the flow curve for system-level tools) and CSVs.
    """
    with plain_failures():
        from .several_records import progress_on

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            progress("starting JAX")
            _set_up_jax()
            from thermohyd.identify.seed.study import seed_study

            study = seed_study(progress)
            _save(study, folder, progress)
        _show(study, folder, consoles, json, "seed.html")


@app.command("sensitivity")
def sensitivity_command(
    source: Source = None,
    out: Out = None,
    json: Json = False,
    model: InsteadOfFit = None,
    settings: Annotated[
        Path | None,
        typer.Option(
            "--settings", "-s", metavar="FILE", help="TOML file with your own tolerances, conditions and noise."
        ),
    ] = None,
    evaluations: Annotated[
        int, typer.Option("--evaluations", "-n", min=128, max=4_194_304, help="Of the three tests in the Sobol study.")
    ] = 65_536,
) -> None:
    """Which parameter matters: sensitivities, temperature drift, Sobol indices, and what to measure next.

    With --out: sensitivity.json, report.html and the plots as PNG and SVG.
    """
    with plain_failures():
        from thermohyd.identify.sensitivity.source import actuator_of, read_source

        from .several_records import progress_on

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            given = read_source(source, model, settings, progress)
            progress("starting JAX")
            _set_up_jax()
            from thermohyd.identify.sensitivity.study import sensitivity

            subject = given.subject(progress)
            actuator = actuator_of(subject, given.settings)
            result = sensitivity(subject, given.settings, actuator=actuator, evaluations=evaluations, progress=progress)
            _save(result, folder, progress)
        _show(result, folder, consoles, json, "report.html")


@app.command("servo")
def servo_command(
    source: Source = None,
    out: Out = None,
    json: Json = False,
    temperatures: Annotated[
        str | None,
        typer.Option(
            "--temperatures",
            "-t",
            metavar="LIST",
            help="Of the oil; 12 at most.",
            show_default="-40 -20 0 20 40 70 degC",
        ),
    ] = None,
    step: Annotated[str, typer.Option("--step", metavar="LENGTH", help="Of the setpoint, from mid stroke.")] = "5 mm",
    supply: Annotated[
        str | None, typer.Option("--supply", metavar="PRESSURE", help="Else the record's; without one 210 bar.")
    ] = None,
    gain: Annotated[
        str | None,
        typer.Option("--gain", metavar="GAIN", help='Of the amplifier, such as "0.1 A/V"; else the record\'s.'),
    ] = None,
    model: InsteadOfFit = None,
    settings: Annotated[
        Path | None,
        typer.Option("--settings", "-s", metavar="FILE", help="TOML file with your own actuator and conditions."),
    ] = None,
) -> None:
    """What temperature does to the position loop: step responses, gain and phase margin, bandwidth, from cold to hot.

    With --out: servo.json, report.html and the plots as PNG and SVG.
    """
    with plain_failures():
        from thermohyd.identify.sensitivity.source import read_source
        from thermohyd.identify.servo.request import read_request

        from .several_records import progress_on

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            given = read_source(source, model, settings, progress)
            request = read_request(temperatures, step, supply, gain, given.settings)
            progress("starting JAX")
            _set_up_jax()
            from thermohyd.identify.servo.study import servo_study
            from thermohyd.identify.servo.subject import subject_of

            study = servo_study(subject_of(given, request, progress), progress=progress)
            _save(study, folder, progress)
        _show(study, folder, consoles, json, "report.html")


@app.command("new")
def new_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; it must not hold a record yet.")],
) -> None:
    """Write a template record to fill in; it fits as it stands."""
    with plain_failures():
        from .new_record import write_template

        write_template(folder)
        _say_where(_begin(None, False)[1].results, folder, "bench.toml")


def _begin(out: str | None, json: bool) -> "tuple[Path | None, Consoles]":
    """(the folder of --out, checked before any work is done for it; where words go)"""
    from thermohyd.identify.report.files import checked_folder

    from .process import consoles

    return checked_folder(out), consoles(json)


def _save(result: "Result", folder: Path | None, progress: "Callable[[str], None]") -> None:
    """Draw and write, where --out names a folder."""
    if folder is not None:
        progress("drawing")
        result.save(folder)


def _show(
    result: "Result", folder: Path | None, consoles: "Consoles", json: bool, *names: str, warnings: "Iterable[str]" = ()
) -> None:
    """A result in words, where those of its files are that a user opens, and JSON."""
    result.print_on(consoles.results)
    consoles.warn(warnings)
    if folder is not None:
        _say_where(consoles.results, folder, *names)
    if json:
        _print_json(result.to_dict())


def _print_json(content: dict[str, Any]) -> None:
    from thermohyd.identify.report.fit_json import json_text

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
