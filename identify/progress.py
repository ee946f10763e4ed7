"""What a command tells its user while it works: a live line on a terminal, a few plain lines elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

from .interruption import when_interrupted


# Where stderr is a file, only a run that takes long says that it is alive.
SILENT_SECONDS = 10.0


@contextmanager
def progress_on(console: Console) -> Iterator[Callable[[str], None]]:
    """A function that takes a sentence about what is going on now; the live line vanishes at the end."""
    if console.is_terminal:
        with console.status(Text("starting")) as status, when_interrupted(status.stop):
            yield lambda words: status.update(Text(words))
        return
    began = time.monotonic()

    def say(words: str) -> None:
        if time.monotonic() - began > SILENT_SECONDS:
            console.print(Text(f"{words} ..."))

    yield say
