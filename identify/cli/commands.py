"""The `thermohyd` command. Whatever is heavy is imported inside the commands: `--help` must not wait for JAX."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

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
ModelForm = Annotated[
    bool,
    typer.Option(
        "--model-form/--no-model-form",
        help="Fit once more with the other law of an edge, and say what it would change; takes another compilation.",
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
def fit_command(
    benches: Benches,
    out: Out = None,
    json: Json = False,
    effect: Annotated[
        list[str] | None,
        typer.Option("--effect", help="Free this effect beside the parameters; may be given several times."),
    ] = None,
    model_form: ModelForm = True,
) -> None:
    """Find edge radius, clearance, underlap, discharge coefficient, transition number and null bias, with error bars.

    With --out: fit.json, model.json (for simulate), report.html and one plot per test as PNG and SVG; several records get a
    folder each, DIR/<name of the record's folder>.
    """

    def fits() -> "Work":
        from thermohyd.identify.fitting.fit import fit

        from .several_results import print_summary_of_fits, unsettled

        freed: dict[str, Any] = {"effects": effect} if effect else {}
        return (
            (lambda record, say: fit(record, progress=say, model_form=model_form, **freed)),
            print_summary_of_fits,
            unsettled,
        )

    _of_each_record(benches, out, json, fits)


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
    model_form: ModelForm = True,
) -> None:
    """Find where bench and ideal valve disagree, name the missing effects, add them, and show the gap shrink.

    With --out: diagnosis.json, model.json (for simulate), report.html and the plots as PNG and SVG; several records get
    a folder each, DIR/<name of the record's folder>.
    """

    def diagnoses() -> "Work":
        from thermohyd.identify.diagnosis.diagnose import diagnose

        from .several_results import print_summary_of_many, unsettled_diagnoses

        return (
            (lambda record, say: diagnose(record, learn=learn, model_form=model_form, progress=say)),
            print_summary_of_many,
            unsettled_diagnoses,
        )

    _of_each_record(benches, out, json, diagnoses)


def _of_each_record(benches: list[Path], out: str | None, json: bool, work: "Callable[[], Work]") -> None:
    """The frame of a command that does one thing with every record. work: called once JAX may be imported."""
    with plain_failures():
        from .several_records import compute_all, progress_on, read_records

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            records = read_records(benches, folder, progress)
            progress("starting JAX")
            _set_up_jax()
            compute, print_table, unsettled = work()
            outcome = compute_all(records, compute, folder, progress)
        _show_records(outcome, len(records), consoles, json, print_table)
        if trouble := unsettled(outcome):
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
def seed_command(
    out: Out = None,
    json: Json = False,
    edge_law: Annotated[
        Literal["orifice", "lubrication"],
        typer.Option("--edge-law", help="With lubrication: what becomes of the claims, beside the paper's own law."),
    ] = "orifice",
) -> None:
    """Reproduce the paper that this program grew from: its Figures 3 to 8, its Eq. 6, and every claim: holds or not.

    With --out: seed.html, the figures as PNG and SVG, seed.json, eq6.json (the flow curve for system-level tools) and CSVs.
    """

    def study(progress: "Progress") -> "Result":
        from thermohyd.identify.seed.study import seed_study

        return seed_study(progress, edge_law=edge_law)

    _study(out, json, "seed.html", lambda progress: study)


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

    def prepared(progress: "Progress") -> "Callable[[Progress], Result]":
        from thermohyd.identify.sensitivity.source import actuator_of, read_source

        given = read_source(source, model, settings, progress)

        def study(progress: "Progress") -> "Result":
            from thermohyd.identify.sensitivity.study import sensitivity

            subject = given.subject(progress)
            actuator = actuator_of(subject, given.settings)
            return sensitivity(subject, given.settings, actuator=actuator, evaluations=evaluations, progress=progress)

        return study

    _study(out, json, "report.html", prepared)


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

    def prepared(progress: "Progress") -> "Callable[[Progress], Result]":
        from thermohyd.identify.sensitivity.source import read_source
        from thermohyd.identify.servo.request import read_request

        given = read_source(source, model, settings, progress)
        request = read_request(temperatures, step, supply, gain, given.settings)

        def study(progress: "Progress") -> "Result":
            from thermohyd.identify.servo.study import servo_study
            from thermohyd.identify.servo.subject import subject_of

            return servo_study(subject_of(given, request, progress), progress=progress)

        return study

    _study(out, json, "report.html", prepared)


def _study(
    out: str | None, json: bool, page: str, prepare: "Callable[[Progress], Callable[[Progress], Result]]"
) -> None:
    """The frame of a study. prepare: reads what it is about, before JAX starts, and gives what computes it."""
    with plain_failures():
        from .several_records import progress_on

        folder, consoles = _begin(out, json)
        with progress_on(consoles.notes) as progress:
            compute = prepare(progress)
            progress("starting JAX")
            _set_up_jax()
            study = compute(progress)
            _save(study, folder, progress)
        _show(study, folder, consoles, json, page)


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
