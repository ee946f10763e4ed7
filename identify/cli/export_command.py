"""`thermohyd export`: a fitted valve for other programs."""

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
    help="Take a fitted valve into another program: an FMU of C sources, tables, results as CSV, Parquet or a spreadsheet.",
)

ModelFile = Annotated[
    Path, typer.Argument(metavar="MODEL", help="model.json of a fit or a diagnosis.", show_default=False)
]
OutFolder = Annotated[
    str, typer.Option("--out", "-o", metavar="DIR", help="Folder for the files; made if need be.", show_default=False)
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
    compiler: Annotated[
        str,
        typer.Option(
            "--compiler", metavar="CC", help='For the binary inside; "none": sources alone, which any host can build.'
        ),
    ] = "cc",
    json: Json = False,
) -> None:
    """The valve with its named effects as an FMU (FMI 2.0, model exchange and co-simulation) of C sources; no Python inside.

    Writes DIR/<valve>.fmu. Its inputs are what the valve sees, so errors of the bench's instruments stay out, and it says which.
    """
    with plain_failures():
        from thermohyd.identify.export.fmu import make_fmu
        from thermohyd.identify.model.model_file import load_model
        from thermohyd.identify.report.files import Writer, write_all

        folder, consoles = begin(out, json)
        assert folder is not None
        made = make_fmu(load_model(model), current=current, compiler=None if compiler == "none" else compiler)
        name = f"{made.name}.fmu"
        write_all(folder, {name: made.content}, Writer("export fmu", str(model.resolve())))
        inside = f"with a binary for {made.binary}" if made.binary else "sources alone: no compiler was used"
        consoles.results.print(f"FMU of {made.name}, FMI 2.0, {inside}", markup=False, soft_wrap=True)
        _say_left_out(consoles, made.left_out)
        say_where(consoles.results, folder, name)
        if json:
            print_json({"files": [name], "binary": made.binary or None, "left_out": list(made.left_out)})


def _say_left_out(consoles: Any, left_out: tuple[str, ...]) -> None:
    if left_out:
        consoles.results.print(
            f"left on the bench, as the valve elsewhere has none of it: {', '.join(left_out)}",
            markup=False,
            soft_wrap=True,
        )
