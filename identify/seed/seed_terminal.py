"""What `thermohyd seed` says in a terminal: every claim on one line, on one screen."""

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from .seed_study import SeedStudy


COLOURS = {"holds": "green", "partly": "yellow", "no": "red"}


def print_seed(study: SeedStudy, console: Console) -> None:
    """A row per claim with its figure, and the error of Eq. 6."""
    table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, show_edge=False)
    for name in ("claim of the paper", "computed", ""):
        table.add_column(name, no_wrap=True)
    for claim in study.claims:
        table.add_row(Text(claim.title), Text(claim.short), Text(claim.holds, style=COLOURS[claim.holds]))
    console.print(table)
    macro = study.macro["HM"]
    own = max(fit.worst for fit in macro.fits)
    console.print(
        Text(
            f"{len(study.claims)} claims: {study.count('holds')} hold, {study.count('partly')} in part, {study.count('no')} not.\n"
            f"Eq. 6 misses the opening by at most {own * 1e6:.1f} um ({100 * own / macro.stroke:.1f} % of stroke) at each temperature "
            f"alone, {macro.worst * 1e6:.1f} um ({100 * macro.worst / macro.stroke:.1f} %) with smooth laws."
        )
    )
