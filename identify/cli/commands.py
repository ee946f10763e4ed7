"""The `thermohyd` command. Whatever is heavy is imported inside the commands: `--help` must not wait for JAX."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from thermohyd.identify.optional_parts import install

from .app_command import app_command
from .check_command import check_command
from .export_command import export_app
from .fleet import app as fleet_app
from .loudness import Commands
from .process import fail, plain_failures
from .run_command import begin, load_users_effects, of_each_record, run_study, say_where, show


if TYPE_CHECKING:
    from collections.abc import Callable

    from thermohyd.identify.comparison.result import ComparisonResult
    from thermohyd.identify.result import Result

    from .run_command import Progress, Work


app = typer.Typer(
    name="thermohyd",
    help="Servovalve models from test-bench curves. A bench record is a folder with bench.toml and one CSV per test.",
    no_args_is_help=True,
    cls=Commands,
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
UsersEffects = Annotated[
    Path | None,
    typer.Option("--effects", metavar="DIR", help="Folder with effects of your own, which are loaded as Python code."),
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
    effects: UsersEffects = None,
    model_form: ModelForm = True,
    profile: Annotated[
        bool,
        typer.Option("--profile", help="Likelihood profiles of all parameters and amounts, with nested intervals."),
    ] = False,
    posterior: Annotated[
        bool,
        typer.Option("--posterior", help=f"Draws of the posterior by the no-U-turn sampler: {install('posterior')}."),
    ] = False,
    coverage: Annotated[
        int,
        typer.Option(
            "--coverage", metavar="N", min=0, help="Simulate N records at the fit: how often does each interval hold?"
        ),
    ] = 0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the draws and of the simulated records.")] = 20110913,
) -> None:
    """Find edge radius, clearance, underlap, discharge coefficient, transition number and null bias, with error bars.

    With --out: fit.json, model.json (for simulate), report.html and one plot per test as PNG and SVG; several records get a
    folder each, DIR/<name of the record's folder>.
    """

    def fits() -> "Work":
        from thermohyd.identify.fitting.fit import fit

        from .several_results import print_summary_of_fits, unsettled

        load_users_effects(effects)
        asked: dict[str, Any] = {"effects": effect} if effect else {}
        compute = fit
        if profile or posterior or coverage:
            from thermohyd.identify.uncertainty.study import fit_in_depth

            compute = fit_in_depth
            asked |= {"profile": profile, "posterior": posterior, "coverage": coverage, "seed": seed}
        return (
            (lambda record, say: compute(record, progress=say, model_form=model_form, **asked)),
            print_summary_of_fits,
            unsettled,
        )

    of_each_record(benches, out, json, fits)


@app.command("diagnose")
def diagnose_command(
    benches: Benches,
    out: Out = None,
    json: Json = False,
    learn: Annotated[
        bool,
        typer.Option(
            "--learn", help="Where no effect explains the gap, add the leading empirical term to the model and say so."
        ),
    ] = False,
    without: Annotated[
        str,
        typer.Option(
            "--without",
            metavar="NAMES",
            help="Effects, with commas between them, to take out of the library this time.",
        ),
    ] = "",
    effects: UsersEffects = None,
    model_form: ModelForm = True,
    posterior: Annotated[
        bool,
        typer.Option(
            "--posterior",
            help=f"Draws of the posterior of the final model, faults of the bench in it: {install('posterior')}.",
        ),
    ] = False,
    seed: Annotated[int, typer.Option("--seed", help="Of the draws.", min=0)] = 20110913,
) -> None:
    """Find where bench and ideal valve disagree, name the missing effects, add them, and show the gap shrink.

    With --out: diagnosis.json, model.json (for simulate), report.html and the plots as PNG and SVG; several records get
    a folder each, DIR/<name of the record's folder>. --posterior adds posterior.nc.
    """

    def diagnoses() -> "Work":
        from thermohyd.identify.diagnosis.diagnose import diagnose
        from thermohyd.identify.users_effects import known_effects

        from .several_results import print_summary_of_many, unsettled_diagnoses

        load_users_effects(effects)
        names = known_effects(without.split(","))
        more: dict[str, Any] = {"without": names} if names else {}
        compute, more = diagnose, more | {"learn": learn}
        if posterior:
            from thermohyd.identify.uncertainty.diagnosed import diagnose_in_depth

            compute, more = diagnose_in_depth, {**more, "seed": seed}
        return (
            (lambda record, say: compute(record, model_form=model_form, progress=say, **more)),
            print_summary_of_many,
            unsettled_diagnoses,
        )

    of_each_record(benches, out, json, diagnoses)


@app.command("compare")
def compare_command(
    first: Annotated[Path, typer.Argument(metavar="A", help="Folder of the first record, such as before an overhaul.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Folder of the second: differences are B minus A.")],
    out: Out = None,
    json: Json = False,
    same_bench: Annotated[
        bool,
        typer.Option(
            "--same-bench/--other-bench",
            help="Instruments and oil are the same in both records as far as the data agree, or each record has its own.",
        ),
    ] = True,
) -> None:
    """Which parameters and effects differ between two records of one valve, or of two valves of a type, and by how much.

    With --out: compare.json, report.html and the picture as PNG and SVG.
    """

    def prepared(progress: "Progress") -> "Callable[[Progress], ComparisonResult]":
        from thermohyd.identify.bench.read import read_record

        records = []
        for bench in (first, second):
            progress(f"reading {bench}")
            records.append(read_record(bench))

        def study(progress: "Progress") -> "ComparisonResult":
            from thermohyd.identify.comparison.study import compare

            return compare(records[0], records[1], same_bench=same_bench, progress=progress)

        return study

    compared = run_study(out, json, "report.html", prepared, lambda found: found.warnings)
    if not compared.converged:
        fail(f"the joint fit did not converge: {compared.message}")


@app.command("plan")
def plan_command(
    bench: Annotated[
        Path,
        typer.Argument(
            metavar="BENCH", help="Folder of a record; its tests need no readings, or are planned in bench.toml."
        ),
    ],
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", "-m", metavar="FILE", help="model.json of the valve to expect; else [start], or the nominal one."
        ),
    ] = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Before any measurement: which effects will the planned tests find, from which amount on, and which ones will they confuse?

    With --out: plan.json, report.html and the pictures as PNG and SVG.
    """

    def prepared(progress: "Progress") -> "Callable[[Progress], Result]":
        from thermohyd.identify.bench.read import read_record
        from thermohyd.identify.model.model_file import load_model

        progress(f"reading {bench}")
        record = read_record(bench, readings_required=False)
        expected = None if model is None else load_model(model)

        def study(progress: "Progress") -> "Result":
            from thermohyd.identify.planning.study import plan

            return plan(record, model=expected, progress=progress)

        return study

    run_study(out, json, "report.html", prepared)


@app.command("simulate")
def simulate_command(
    bench: Bench,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model", "-m", metavar="FILE", help="model.json of a fit; without it, the record's own [start]."
        ),
    ] = None,
    effects: UsersEffects = None,
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

        from .jax_setup import set_up_jax
        from .several_records import progress_on

        folder, consoles = begin(out, json)
        with progress_on(consoles.notes) as progress:
            progress(f"reading {bench}")
            record = read_record(bench, readings_required=False)
            from thermohyd.identify.model.simulation_output import spare_the_record

            spare_the_record(record, folder)
            progress("starting JAX")
            set_up_jax()  # first: effects in a model file are checked against the library of effects, which brings JAX
            load_users_effects(effects)
            chosen = nominal_model(record) if model is None else load_model(model)
            from thermohyd.identify.model.predict import simulate

            found = simulate(record, chosen, progress=progress)
            if folder is not None:
                found.save(folder)
        show(found, folder, consoles, json, *(f"{test}.csv" for test in found.tables), warnings=found.warnings)


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

    run_study(out, json, "seed.html", lambda progress: study)


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
            actuator = actuator_of(given, subject)
            return sensitivity(subject, given.settings, actuator=actuator, evaluations=evaluations, progress=progress)

        return study

    run_study(out, json, "report.html", prepared)


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

    run_study(out, json, "report.html", prepared)


@app.command("effect")
def effect_command(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What to call the effect, such as port_hose.")],
    source: Annotated[
        Path, typer.Option("--from", metavar="FILE", help="diagnosis.json with the term.", show_default=False)
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="DIR", help="Your own folder of effects; made if need be.", show_default=False
        ),
    ],
    term: Annotated[int, typer.Option("--term", min=1, help="Which of its terms; the first is the leading one.")] = 1,
) -> None:
    """Write a typed term of a diagnosis as an effect of your own: a class, its entry, and a test. --effects DIR loads it."""
    with plain_failures():
        from thermohyd.identify.effect_writer import write_effect

        written = write_effect(name, source, out, term)
        say_where(begin(None, False)[1].results, out, *written)


@app.command("new")
def new_command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; it must not hold a record yet.")],
) -> None:
    """Write a template record to fill in; it fits as it stands."""
    with plain_failures():
        from .new_record import write_template

        write_template(folder)
        say_where(begin(None, False)[1].results, folder, "bench.toml")


app.command("check")(check_command)
app.command("app")(app_command)
app.add_typer(export_app, name="export")
app.add_typer(fleet_app, name="fleet")


def main() -> None:
    """Entry point of the `thermohyd` command."""
    app(prog_name="thermohyd")
