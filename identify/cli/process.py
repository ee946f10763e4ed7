"""How a command ends and where its words go: one line and an exit status for every failure, results apart from progress.

Results go to stdout, progress and warnings to stderr; with --json all readable words go to stderr. No tracebacks unless asked for.
"""

import io
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import typer
from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.errors import BenchInputError, one_line
from thermohyd.identify.interruption import INTERRUPTED, begin, what_was_written
from thermohyd.identify.report.terminal import PlainConsole

from .loudness import Loudness, loudness


FAILED, BAD_INPUT = 1, 2
LONGEST_REASON = 300
LONGEST_MESSAGE = 2000  # about bad input: it may hold a line to copy into bench.toml
DEBUG = "THERMOHYD_DEBUG"


@contextmanager
def plain_failures() -> Iterator[None]:
    """Turn whatever a command raises into one line on stderr and an exit status."""
    begin()
    try:
        yield
    except typer.Exit:
        raise
    except BenchInputError as error:
        _end(str(error), BAD_INPUT, LONGEST_MESSAGE)
    except KeyboardInterrupt:  # where the command runs inside another program, which owns the signals
        _end(f"interrupted; {what_was_written()}", INTERRUPTED)
    except BrokenPipeError:
        # the reader of our output has gone (`thermohyd ... | head`): stop quietly, also at Python's own flush
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(FAILED) from None
    except Exception as error:
        _end(in_words(error), FAILED)


def in_words(error: Exception) -> str:
    """A failure as its user reads it, in one line."""
    if isinstance(error, BenchInputError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}"
    if isinstance(error, MemoryError):
        return "not enough memory for this record"
    lines = str(error).strip().splitlines() or [""]
    reason = f"{type(error).__name__}: {lines[0]}".rstrip(": ")
    return f"the computation failed: {reason} (set {DEBUG}=1 for the whole story)"


def wants_the_whole_story() -> bool:
    """Whether a failure is to be raised with its traceback."""
    return bool(os.environ.get(DEBUG))


def fail(message: str) -> None:
    """End a command whose computation failed, after it has written what it could."""
    _end(message, FAILED)


def _end(message: str, status: int, longest: int = LONGEST_REASON) -> None:
    if wants_the_whole_story() and sys.exc_info()[0] is not None:
        raise
    typer.echo(f"thermohyd: {one_line(message)[:longest]}", err=True)
    raise typer.Exit(status) from None


# Of a file or a pipe: every table of the program fits, and a printer still takes it.
WIDTH_OF_FILES = 120


@dataclass(frozen=True)
class Consoles:
    """results: what was asked for, readable. notes: progress, and warnings that must be seen beside redirected results."""

    results: Console
    notes: Console

    def warn(self, warnings: Iterable[str], of: str = "") -> None:
        """Warnings stand in the results; where those go to a file, they are said on stderr too."""
        if self.results is not self.notes and (self.results.quiet or not self.results.is_terminal):
            for warning in warnings:
                self.notes.print(Text(f"thermohyd: warning: {f'{of}: ' if of else ''}{warning}"), soft_wrap=True)


def consoles(json: bool) -> Consoles:
    """The two of a command; without escape codes where they are no terminal. With --quiet nothing of the results is shown."""
    notes = _console(stderr=True)
    results = notes if json else _console(stderr=False)
    if loudness() is Loudness.QUIET:
        results = _console(stderr=json)
        results.quiet = True
    return Consoles(results, notes)


def _console(stderr: bool) -> Console:
    stream = sys.stderr if stderr else sys.stdout
    if isinstance(stream, io.TextIOWrapper):
        # rich cuts the cells of a narrow table with an ellipsis, which an ASCII pipe or log cannot hold: better a "?"
        stream.reconfigure(errors="replace")
    console = PlainConsole(stderr=stderr)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = WIDTH_OF_FILES
    return console
