"""`thermohyd export`: a fitted valve or servo for other programs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .loudness import Commands
from .process import plain_failures
from .run_command import begin, print_json, say_where


export_app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Take a fitted valve into another program: an FMU of C sources, tables, results as CSV, Parquet, xlsx; a space of models.",
)

ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="model.json of a fit or a diagnosis.", show_default=False)
]
OutFolder = Annotated[
    str, typer.Option("--out", "-o", metavar="DIR", help="Folder for the files; made if need be.", show_default=False)
]
EffectsFolder = Annotated[
    Path | None,
    typer.Option("--effects", metavar="DIR", help="Folder with effects of your own, which are loaded as Python code."),
]
Json = Annotated[bool, typer.Option("--json", help="Print what was written as JSON on stdout, and nothing else there.")]


@export_app.command("fmu")
def fmu_command(
    model: ModelFile,
    out: OutFolder,
    current: Annotated[
        bool,
        typer.Option(
            "--current/--position", help="Drive the spool by the current of [valve] rated_current, or by its position."
        ),
    ] = False,
    servo: Annotated[
        str | None,
        typer.Option(
            "--servo",
            metavar="COMMAND",
            help="The valve with its actuator in motion, driven by a setpoint, a current or a spool_position.",
        ),
    ] = None,
    fmi: Annotated[int, typer.Option("--fmi", metavar="VERSION", help="2: FMI 2.0; 3: FMI 3.0.")] = 2,
    compiler: Annotated[
        str,
        typer.Option(
            "--compiler", metavar="CC", help='For the binary inside; "none": sources alone, which any host can build.'
        ),
    ] = "cc",
    json: Json = False,
) -> None:
    """The valve with its named effects, or the servo, as an FMU (model exchange and co-simulation) of C sources; no Python inside.

    Writes DIR/<valve>.fmu, or DIR/<valve>_servo.fmu. Its inputs are what the valve sees: errors of the bench's instruments stay out, and
    it says which.
    """
    with plain_failures():
        from thermohyd.identify.export.fmu import make_fmu
        from thermohyd.identify.model.model_file import load_model
        from thermohyd.identify.report.files import Writer, write_all

        folder, consoles = begin(out, json)
        assert folder is not None
        made = make_fmu(
            load_model(model), current=current, servo=servo, fmi=fmi, compiler=None if compiler == "none" else compiler
        )
        name = f"{made.name}.fmu"
        write_all(folder, {name: made.content}, Writer("export fmu", str(model.resolve())))
        inside = f"with a binary for {made.binary}" if made.binary else "sources alone: no compiler was used"
        consoles.results.print(f"FMU of {made.name}, FMI {fmi}.0, {inside}", soft_wrap=True)
        _say_left_out(consoles, made.left_out)
        say_where(consoles.results, folder, name)
        if json:
            print_json({"files": [name], "binary": made.binary or None, "left_out": list(made.left_out)})


def _say_left_out(consoles: Any, left_out: tuple[str, ...]) -> None:
    if left_out:
        consoles.results.print(
            f"left on the bench, as the valve elsewhere has none of it: {', '.join(left_out)}",
            soft_wrap=True,
        )


@export_app.command("tables")
def tables_command(
    model: ModelFile,
    out: OutFolder,
    supply: Annotated[
        str, typer.Option("--supply", metavar="PRESSURE", help="Supply pressure of the tables.", show_default=False)
    ],
    temperature: Annotated[
        str, typer.Option("--temperature", "-t", metavar="T", help="Of the oil.", show_default=False)
    ],
    return_pressure: Annotated[str, typer.Option("--return", metavar="PRESSURE", help="Return pressure.")] = "0 bar",
    programs: Annotated[
        str, typer.Option("--for", metavar="NAMES", help="modelica, simscape, amesim: with commas between them.")
    ] = "modelica,simscape,amesim",
    positions: Annotated[
        int, typer.Option("--positions", min=5, max=1601, help="Nodes along the spool position.")
    ] = 81,
    across: Annotated[int, typer.Option("--across", min=3, max=101, help="Nodes along the other axis.")] = 31,
    effects: EffectsFolder = None,
    json: Json = False,
) -> None:
    """Load flow, leakage and blocked load pressure over two axes, for Modelica (CombiTable2Ds), Simscape (.mat) and Amesim (.data).

    Each says how far linear interpolation between its nodes misses the model, measured in every cell.
    """
    with plain_failures():
        from .jax_setup import set_up_jax
        from .run_command import load_users_effects
        from .several_records import progress_on

        folder, consoles = begin(out, json)
        assert folder is not None
        with progress_on(consoles.notes) as progress:
            ps, pt = (
                _quantity(option, text, "pressure")
                for option, text in (("--supply", supply), ("--return", return_pressure))
            )
            warm = _quantity("--temperature", temperature, "temperature")
            wanted = [name.strip() for name in programs.split(",") if name.strip()]
            progress("starting JAX")
            set_up_jax()
            load_users_effects(effects)
            from thermohyd.identify.bench.errors import BenchInputError, quoted
            from thermohyd.identify.export.table_writers import WRITERS, error_words
            from thermohyd.identify.export.valve_tables import valve_tables
            from thermohyd.identify.model.model_file import load_model
            from thermohyd.identify.report.files import Writer, write_all

            unknown = [name for name in wanted if name not in WRITERS]
            if unknown or not wanted:
                named = f"unknown program {quoted(unknown[0])}" if unknown else "names no program"
                raise BenchInputError(f"--for: {named}; known: {', '.join(WRITERS)}")
            if not ps > pt:
                raise BenchInputError("--supply must exceed --return")
            progress("computing the tables")
            made = valve_tables(
                load_model(model),
                supply_pressure=ps,
                return_pressure=pt,
                temperature=warm,
                positions=positions,
                across=across,
            )
            files = {name: content for program in wanted for name, content in WRITERS[program](made).items()}
            write_all(folder, files, Writer("export tables", str(model.resolve())))
        for table in made.tables:
            size = f"{len(table.x.nodes)} by {len(table.y.nodes)} nodes"
            consoles.results.print(f"{table.name}: {size}; {error_words(table)}", soft_wrap=True)
        _say_left_out(consoles, made.left_out)
        say_where(consoles.results, folder, *files)
        if json:
            about = {
                t.name: {"unit": t.unit, "x": t.x.name, "y": t.y.name, "nodes": list(t.values.shape), "largest_error": t.largest,
                         "mean_error": t.mean, "range": t.span}
                for t in made.tables
            }  # fmt: skip
            print_json({"files": list(files), "tables": about, "left_out": list(made.left_out), "units": "SI"})


@export_app.command("results")
def results_command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="fit.json or diagnosis.json.", show_default=False)],
    out: OutFolder,
    formats: Annotated[
        str, typer.Option("--format", metavar="NAMES", help="csv, parquet, xlsx: with commas between them.")
    ] = "csv,xlsx",
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="BENCH",
            help="Add curves: this record's rows with the prediction of the model.json beside RESULT.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Parameters with their errors, correlation, noise, named effects and curves as CSV, Parquet or the sheets of a spreadsheet."""
    with plain_failures():
        from thermohyd.identify.export.results import load_result, result_files, result_tables
        from thermohyd.identify.report.files import Writer, write_all

        from .several_records import progress_on

        folder, consoles = begin(out, json)
        assert folder is not None
        with progress_on(consoles.notes) as progress:
            tables = result_tables(load_result(result))
            if record is not None:
                tables |= _curves(result, record, progress)
            files = result_files(tables, [form.strip() for form in formats.split(",") if form.strip()])
            write_all(folder, files, Writer("export results", str(result.resolve())))
        say_where(consoles.results, folder, *files)
        if json:
            print_json({"files": list(files), "tables": {name: list(table.columns) for name, table in tables.items()}})


@export_app.command("select")
def select_command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="diagnosis.json.", show_default=False)],
    out: OutFolder,
    criterion: Annotated[str, typer.Option("--criterion", metavar="NAME", help="AIC, AICc or BIC.")] = "AICc",
    method: Annotated[
        str, typer.Option("--method", metavar="NAME", help="forward, backward, brute_force or famos.")
    ] = "forward",
    effects: EffectsFolder = None,
    json: Json = False,
) -> None:
    """Parameters and effects of a diagnosis as a model space of PEtab Select, which searches it with anybody's fits."""
    with plain_failures():
        from thermohyd.identify.export.model_space import model_space
        from thermohyd.identify.export.results import load_result
        from thermohyd.identify.report.files import Writer, write_all

        from .run_command import load_users_effects

        folder, consoles = begin(out, json)
        assert folder is not None
        load_users_effects(effects)
        made = model_space(load_result(result), criterion=criterion, method=method)
        write_all(folder, made.files, Writer("export select", str(result.resolve())))
        sets = f"{made.subspaces} set{'s' if made.subspaces > 1 else ''} of models"
        consoles.results.print(f"{len(made.effects)} effects in {sets}: {', '.join(made.effects)}", soft_wrap=True)
        for group in made.rivals:
            consoles.results.print(f"no model has two of: {', '.join(group)}", soft_wrap=True)
        say_where(consoles.results, folder, *made.files)
        if json:
            about = {
                "effects": list(made.effects),
                "rivals": [list(group) for group in made.rivals],
                "subspaces": made.subspaces,
            }
            print_json({"files": list(made.files), **about})


def _curves(result: Path, bench: Path, progress: Any) -> dict[str, Any]:
    """{test: rows with predictions} of a record by the model beside a result."""
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.model.model_file import load_model

    from .jax_setup import set_up_jax

    progress(f"reading {bench}")
    record = read_record(bench, readings_required=False)
    progress("starting JAX")
    set_up_jax()
    model = load_model(result.parent / "model.json")
    from thermohyd.identify.model.predict import simulate

    return dict(simulate(record, model, progress=progress).tables)


def _quantity(option: str, text: str, kind: str) -> float:
    from thermohyd.identify.bench.errors import BenchInputError
    from thermohyd.identify.bench.units import UnitError, parse_quantity

    try:
        return parse_quantity(text, kind)
    except UnitError as error:
        raise BenchInputError(f"{option}: {error}") from None
