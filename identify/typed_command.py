"""What the user typed, so that a report can say how to repeat it. Only standard library: every command passes here."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar


PROGRAM = "thermohyd"
_TYPED: ContextVar[tuple[str, ...]] = ContextVar("typed", default=())


@contextmanager
def typed(arguments: Sequence[str]) -> Iterator[None]:
    """While it lasts, the program runs with these arguments."""
    token = _TYPED.set(tuple(arguments))
    try:
        yield
    finally:
        _TYPED.reset(token)


def arguments() -> tuple[str, ...]:
    """Of the command that runs; empty where a program of the user's own calls."""
    return _TYPED.get()


def command() -> str:
    """The line as it can be typed again, quoted where a shell needs it; empty where no command runs."""
    return shlex.join((PROGRAM, *arguments())) if arguments() else ""
