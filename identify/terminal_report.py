"""The report of a fit in a terminal: verdict first, then what it rests on. Reads the same without colour."""

from collections.abc import Iterable

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from . import report_content as content
from .fit_result import FitResult
from .provenance import record_line


VERDICT_STYLE = {"good": "bold", "open": "bold yellow", "bad": "bold red"}


def print_report(result: FitResult, console: Console) -> None:
    """Write the whole report to a console; user text is never read as markup."""
    _heading(console, f"Fit of {result.record.name}")
    console.print(Padding(Text(record_line(result.record), style="dim"), (0, 0, 0, 2)))
    shout = content.shout(result)
    if shout:
        console.print(
            Panel(Text(shout, style="bold red"), border_style="bold red", box=box.DOUBLE, title="NOT CONVERGED")
        )
    _sentences(console, content.verdict(result), VERDICT_STYLE[result.standing])
    _section(console, "Warnings", result.warnings, "yellow")

    _heading(console, "Parameters")
    console.print(_parameters(console, result))
    _sentences(console, content.parameter_remarks(result), "")
    _correlations(console, result)
    _section(console, "Identifiability", content.identifiability(result))

    _heading(console, "Fit statistics")
    console.print(_pairs(content.statistics(result)))
    _heading(console, "Readings")
    console.print(_tests(console, result))
    _section(console, "Where the noise came from", content.noise_sources(result))
    _section(console, "Starts", content.multi_start(result))
    _section(console, "Notes", result.notes)
    if shout:
        console.print(Text(f"\n{shout}", style="bold red"))


def _heading(console: Console, words: str) -> None:
    console.print(Text(f"\n{words}", style="bold cyan"), highlight=False)


def _sentences(console: Console, sentences: Iterable[str], style: str) -> None:
    for sentence in sentences:
        line = Table.grid(padding=(0, 1))
        line.add_row(Text("*"), Text(sentence, style=style))
        console.print(Padding(line, (0, 0, 0, 2)))


def _section(console: Console, title: str, sentences: Iterable[str], style: str = "") -> None:
    sentences = tuple(sentences)
    if sentences:
        _heading(console, title)
        _sentences(console, sentences, style)


def _table(console: Console, *columns: tuple[str, str]) -> Table:
    gap = 1 if console.width >= 100 else 0
    table = Table(box=box.SIMPLE_HEAD, padding=(0, gap, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for title, side in columns:
        table.add_column(title, justify="right" if side == "right" else "left", no_wrap=True)
    return table


def _parameters(console: Console, result: FitResult) -> Padding:
    wide = console.width >= 100
    columns = [("name", "left"), ("value", "right"), ("unit", "left"), ("std err", "right")]
    columns += [("rel", "right")] if wide else []
    table = _table(console, *columns, ("95 % interval", "right"), ("start", "right"), ("status", "left"))
    for row in content.parameter_rows(result):
        cells = [row.name, row.value, row.unit, row.std, *([row.relative] if wide else []), row.interval, row.start]
        status = Text(row.status, style="bold red" if row.alarming else "dim")
        table.add_row(*[Text(cell) for cell in cells], status)
    return Padding(table, (0, 0, 0, 2), expand=False)


def _tests(console: Console, result: FitResult) -> Padding:
    table = _table(
        console,
        ("test", "left"),
        ("reading", "left"),
        ("points", "right"),
        ("n eff", "right"),
        ("RMS", "right"),
        ("noise", "right"),
        ("unit", "left"),
        ("red. chi2", "right"),
    )
    for row in content.test_rows(result):
        cells = (row.test, row.reading, row.points, row.effective, row.rms, row.noise, row.unit, row.reduced_chi2)
        table.add_row(*[Text(cell) for cell in cells])
    return Padding(table, (0, 0, 0, 2), expand=False)


def _pairs(pairs: list[tuple[str, str]]) -> Padding:
    grid = Table.grid(padding=(0, 2))
    for label, words in pairs:
        grid.add_row(Text(label), Text(words))
    return Padding(grid, (0, 0, 0, 2), expand=False)


def _correlations(console: Console, result: FitResult) -> None:
    pairs = content.correlations(result)
    _heading(console, f"Correlations above {content.CORRELATION_THRESHOLD:g}")
    if not pairs:
        _sentences(console, ("none",), "")
        return
    grid = Table.grid(padding=(0, 2))
    for a, b, value in pairs:
        grid.add_row(Text(a), Text(b), Text(f"{value:+.2f}", style="bold" if abs(value) > 0.9 else ""))
    console.print(Padding(grid, (0, 0, 0, 2)))
