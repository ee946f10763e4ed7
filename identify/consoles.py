"""Where a command's words go: results to stdout, progress and warnings to stderr; with --json all readable ones to stderr."""

import os
from collections.abc import Iterable
from dataclasses import dataclass

from rich.console import Console
from rich.text import Text


# Of a file or a pipe: every table of the program fits, and a printer still takes it.
WIDTH_OF_FILES = 120


@dataclass(frozen=True)
class Consoles:
    """results: what was asked for, readable. notes: progress, and warnings that must be seen beside redirected results."""

    results: Console
    notes: Console

    def warn(self, warnings: Iterable[str], of: str = "") -> None:
        """Warnings stand in the results; where those go to a file, they are said on stderr too."""
        if self.results is not self.notes and not self.results.is_terminal:
            for warning in warnings:
                self.notes.print(Text(f"thermohyd: warning: {f'{of}: ' if of else ''}{warning}"), soft_wrap=True)


def consoles(json: bool) -> Consoles:
    """The two of a command; without escape codes where they are no terminal."""
    notes = _console(stderr=True)
    return Consoles(notes if json else _console(stderr=False), notes)


def _console(stderr: bool) -> Console:
    console = Console(stderr=stderr, highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = WIDTH_OF_FILES
    return console
