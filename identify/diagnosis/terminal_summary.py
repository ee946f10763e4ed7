"""A diagnosis in a terminal: the answer first, then what it rests on, on one screen. Reads the same without colour."""

from rich import box
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..provenance import record_line
from . import diagnosis_content as content, diagnosis_sentences as words
from .result import DiagnosisResult


SCREEN = 40  # lines
COLOURS = {"consistent": "green", "named": "green", "ambiguous": "yellow", "unexplained": "red"}
# How many rows of a section are shown at most; a screen that runs over is tried again with fewer.
ROWS = (5, 4, 3, 2, 1)


def print_summary(result: DiagnosisResult, console: Console) -> None:
    """Write at most one screen to a console; user text is never read as markup."""
    screens = (_screen(result, console, rows) for rows in ROWS)
    fitting = (screen for screen in screens if len(console.render_lines(screen, pad=False)) <= SCREEN)
    console.print(next(fitting, None) or _screen(result, console, ROWS[-1]))


def _screen(result: DiagnosisResult, console: Console, rows: int) -> Group:
    parts: list[RenderableType] = [Text(result.headline, style="bold")]
    shout = content.shout(result)
    if shout:
        parts.append(Text(shout, style="bold red"))
    facts = f"{result.record.name}: {content.verdict_words(result)} ({result.before.points:,} readings, "
    colour = "yellow" if result.open else COLOURS[result.verdict]
    parts.append(Text(f"{facts}{result.seconds:.1f} s)", style=colour))
    parts.append(Text(record_line(result.record), style="dim"))
    parts += [Text(f"warning: {warning}", style="yellow") for warning in result.warnings[: max(1, rows - 3)]]
    if result.where:
        parts += [_heading(f"Where the {result.plain_model} misses"), _where(result, rows)]
    if result.effects:
        parts += [_heading("Effects added to the model"), _effects(result, console.width >= 100)]
    shifts = content.shift_rows(result)
    if shifts:
        parts += [_heading("Parameters"), _shifts(shifts, rows + 2, result.plain_model)]
    parts += [Text(""), _facts(result, rows)]
    return Group(*parts)


def _heading(title: str) -> Text:
    return Text(f"\n{title}", style="bold cyan")


def _facts(result: DiagnosisResult, rows: int) -> Table:
    """What fits on a line or two each, with its label before it."""
    labelled = [
        ("meaning", result.sentences[: max(0, rows - 2)]),
        ("gap", [words.gap(result)]),
        ("held out", [words.held_out(result, short=True)]),
        ("rivals", content.rival_sentences(result)[:rows]),
        ("next test", [] if result.next_test is None else [result.next_test.sentence]),
        ("left over", [words.left_over(result)]),
        ("empirical", words.variations(result)[: max(1, rows - 3)]),
        ("absorbed", [words.absorbed(result)]),
        ("least seen", [words.would_show(result)] if result.verdict == "consistent" else []),
    ]
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    for label, sentences in labelled:
        for sentence in filter(None, sentences):
            grid.add_row(Text(label, style="bold"), Text(sentence))
            label = ""
    return grid


def _table(*columns: str) -> Table:
    """Columns by title; a leading ">" sets figures to the right, a leading "~" lets a column wrap."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for title in columns:
        table.add_column(
            title.lstrip(">~"),
            justify="right" if title.startswith(">") else "left",
            no_wrap=not title.startswith("~"),
            overflow="fold",  # the ellipsis of the default is not ASCII, and what it hides may be the answer
        )
    return table


def _where(result: DiagnosisResult, rows: int) -> Padding:
    table = _table("test", "~where", ">share", ">excess chi2", "~bench")
    for row in content.where_rows(result, result.where)[:rows]:
        table.add_row(*[Text(cell) for cell in (row.reading, row.place, row.share, row.excess, row.miss)])
    more = len(result.where) - rows
    if more > 0:
        table.add_row(Text(f"and {more} more", style="dim"))
    return Padding(table, (0, 0, 0, 2), expand=False)


def _effects(result: DiagnosisResult, wide: bool) -> Padding:
    table = _table("name", ">value", "unit", *([">p"] if wide else []), ">gap closed", "~rivals")
    for row in content.effect_rows(result):
        value = f"{row.value} +/- {row.std}" if row.std else row.value
        status = Text(f"{row.status} ", style="bold red") if row.status else Text("")
        cells = [Text(cell) for cell in (row.name, value, row.unit, *([row.p] if wide else []), row.closed)]
        table.add_row(*cells, status + Text(row.rivals))
    return Padding(table, (0, 0, 0, 2), expand=False)


def _shifts(shifts: list[content.ShiftRow], rows: int, plain: str) -> Padding:
    table = _table("name", f">{plain}", ">final model", ">std err", "unit", ">bias / std err")
    for row in shifts[:rows]:
        table.add_row(*[Text(cell) for cell in (row.name, row.before, row.after, row.std, row.unit, row.change)])
    return Padding(table, (0, 0, 0, 2), expand=False)
