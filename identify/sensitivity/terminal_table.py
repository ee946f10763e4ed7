"""A study in a terminal: the ranked table, the temperature drifts and the next test, on one screen."""

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from . import words
from .result import SensitivityResult


FIRST_CAUSE = 4  # of the drift table's columns


def print_sensitivity(result: SensitivityResult, console: Console) -> None:
    """Write the tables to a console."""
    sobol = result.tolerances.sobol
    _heading(console, f"Which parameter matters: {result.subject.name}, {words.conditions_in_words(result)}")
    console.print(_ranking(console, result))
    _line(
        console,
        f"Total Sobol indices in % over the tolerances (+/- {words.largest_interval(result):.0f} at most), sign: which way the "
        f"figure moves; {sobol.evaluations:,} evaluations.",
    )
    _heading(console, "Drift with temperature, and the causes of it [%/K]")
    console.print(_drifts(result))
    _line(console, words.actuator_sentence(result))
    _heading(console, "What to measure")
    for sentence in words.next_test_sentences(result):
        _line(console, sentence)
    if result.posterior is not None:
        _heading(console, "What the fit leaves uncertain")
        for sentence in words.posterior_sentences(result):
            _line(console, sentence)
    for note in result.notes:
        _line(console, note, "yellow")


def _heading(console: Console, text: str) -> None:
    console.print(Text(f"\n{text}", style="bold cyan"), highlight=False)


def _line(console: Console, text: str, style: str = "") -> None:
    console.print(Padding(Text(text, style=style), (0, 0, 0, 2)))


def _table(columns: list[tuple[str, bool]]) -> Table:
    """A table whose headings take two lines, so that its columns may be narrow; (heading, to the right)."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for title, right in columns:
        heading = title.replace(" ", "\n", 1)
        table.add_column(heading, justify="right" if right else "left", no_wrap=True, vertical="bottom")
    return table


def _ranking(console: Console, result: SensitivityResult) -> Padding:
    figures = [(name, True) for name in words.SHORT.values()]
    columns = [("", True), ("factor", False), ("value", True), ("tolerance", False), ("mean", True)]
    keep = [0, 1, 2, 3, 4] if console.width >= 106 else [1, 3, 4] if console.width >= 92 else [1, 4]
    table = _table([*(columns[i] for i in keep), *figures])
    for row in words.ranking_rows(result):
        strong = int(row[4]) >= 10
        cells = [row[i] for i in keep] + row[5:]
        table.add_row(*[Text(cell, style="bold" if strong else "") for cell in cells])
    label = ["" for _ in keep]
    label[keep.index(1)] = "spread (1 std)"
    table.add_section()
    table.add_row(*[Text(cell, style="dim") for cell in (*label, *words.spread_row(result))])
    return Padding(table, (0, 0, 0, 2), expand=False)


def _drifts(result: SensitivityResult) -> Padding:
    rows = words.drift_rows(result)
    # A cause that moves nothing needs no column.
    keep = [i for i in range(len(words.DRIFT_COLUMNS)) if i < FIRST_CAUSE or any(row[i] != "0" for row in rows)]
    table = _table([(words.DRIFT_COLUMNS[i], i not in (0, 2)) for i in keep])
    for row in rows:
        table.add_row(*[Text(row[i]) for i in keep])
    return Padding(table, (0, 0, 0, 2), expand=False)
