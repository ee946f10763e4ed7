"""Several diagnoses in a terminal: one line for each record."""

from collections.abc import Mapping

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from .diagnosis_content import changed, excess, percent, reading_words
from .result import DiagnosisResult
from .terminal_summary import COLOURS


def print_summary_of_many(results: Mapping[str, DiagnosisResult], console: Console) -> None:
    """{name: result}, in the order given; user text is never read as markup."""
    if not results:
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    columns = ("record", "verdict", "effects", "misses most", ">red. chi2", ">held out")
    for title in columns:
        table.add_column(title.lstrip(">"), justify="right" if title.startswith(">") else "left", overflow="fold")
    for name, result in results.items():
        gap = excess(result.gap_before) + (f" -> {excess(result.gap_after)}" if changed(result) else "")
        cells = (_added(result), _worst(result), gap, _held_out(result))
        table.add_row(Text(name), Text(result.verdict, style=COLOURS[result.verdict]), *[Text(cell) for cell in cells])
    console.print(table)


def _added(result: DiagnosisResult) -> str:
    """Names of what was added, each with the rivals that the data cannot tell from it."""
    words = [" or ".join([e.name, *(rival.name for rival in e.alternatives)]) for e in result.effects]
    words += [f"learned {v.quantity}({v.variable})" for v in result.variations if v.learned]
    return " + ".join(words) or "none"


def _worst(result: DiagnosisResult) -> str:
    if not result.where:
        return ""
    worst = result.where[0]
    return f"{reading_words(worst.test, worst.channel)} {percent(worst.share)}"


def _held_out(result: DiagnosisResult) -> str:
    if result.held_out is None or not changed(result):
        return ""
    return f"{percent(result.held_out.gap_closed)} closed"
