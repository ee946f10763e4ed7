"""How every report looks in a terminal: headings, lines and tables in one place. User text is never read as markup."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.padding import Padding
from rich.segment import Segment
from rich.table import Table
from rich.text import Text


Cells = Iterable[str | Text]
# What a terminal obeys and a name of a folder, a column or a valve may hold: control characters (ESC among them), and those that turn the
# order of letters around. Surrogates are bytes of a file's name that are no text.
OBEYED = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


class PlainConsole(Console):
    """A console that shows what it is given and obeys nothing of it: only rich's own styles reach the terminal, `[um]` is no style to
    it and `:gear:` no picture."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=OBEYED.sub("", segment.text))


def heading(words: str) -> Text:
    """A title in colour, after an empty line."""
    return Text(f"\n{words}", style="bold cyan")


def indented(shown: RenderableType) -> Padding:
    """What stands under a heading, two blanks to the right of it."""
    return Padding(shown, (0, 0, 0, 2), expand=False)


def table(headings: Sequence[str], rows: Iterable[Cells] = (), gap: int = 1) -> Table:
    """A table of cells that are plain or bring their own style, `gap` blanks between its columns.

    As on a page, a heading begins with ">" where figures stand to the right and with "~" where words may wrap; ">~" for both.
    """
    made = Table(box=box.SIMPLE_HEAD, padding=(0, gap, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    vertical = "bottom" if any("\n" in heading for heading in headings) else "top"
    for heading in headings:
        title, right = heading.removeprefix(">"), heading.startswith(">")
        wraps = title.startswith("~")
        made.add_column(
            Text(title.removeprefix("~")),
            justify="right" if right else "left",
            vertical=vertical,
            no_wrap=not wraps,
            # words go on below; a figure that is cut off must show it, or it would be read as another
            overflow="fold" if wraps else "ellipsis",
        )
    return _filled(made, rows)


def grid(rows: Iterable[Cells]) -> Table:
    """Rows without headings, two blanks between their columns."""
    return _filled(Table.grid(padding=(0, 2)), rows)


def _filled(made: Table, rows: Iterable[Cells]) -> Table:
    for row in rows:
        made.add_row(*[Text(cell) if isinstance(cell, str) else cell for cell in row])
    return made
