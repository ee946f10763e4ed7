"""`thermohyd check`: what would be read, how it is reduced and what is missing. It never imports JAX."""

from pathlib import Path
from typing import Annotated

import typer

from .process import plain_failures
from .run_command import begin, show


def check_command(
    bench: Annotated[Path, typer.Argument(metavar="BENCH", help="Folder of the bench record, or its bench.toml.")],
    out: Annotated[
        str | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for the picture and check.json; made if need be."),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON on stdout, and nothing else there.")
    ] = False,
) -> None:
    """Say in two seconds what would be read of a record, how it is reduced, what is missing, and what to do about it.

    Every test is read by itself, so one mistake hides no other. Exit status 2 where a fit would refuse the record; nothing is
    written then. With --out: check.json and the picture, check.png.
    """
    with plain_failures():
        from thermohyd.identify.bench.errors import BenchInputError
        from thermohyd.identify.checking.check import check

        from .several_records import progress_on

        folder, consoles = begin(out, json)
        with progress_on(consoles.notes) as progress:
            found = check(bench, progress=progress)
            if folder is not None and not found.trouble:
                progress("drawing")
                found.save(folder)
        drawn = () if folder is None or found.trouble else ("check.png",)
        show(found, folder, consoles, json, *drawn, warnings=found.warnings)
        if found.trouble:
            raise BenchInputError(found.trouble, file=found.folder)
