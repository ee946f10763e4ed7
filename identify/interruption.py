"""What Ctrl-C does to a command: one true line and status 130 at once, with every file whole or not there.

XLA compiles for many seconds in native code, where Python's own KeyboardInterrupt waits, is swallowed by a callback, or
unwinds the process under threads that still compile. So nothing is unwound: the signal wakes a thread, which says what
has been written and ends the process, all threads with it.
"""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from thermohyd.identify.bench.errors import one_line


INTERRUPTED = 130
# Signal: (what the line says, exit status)
_ENDINGS = {signal.SIGINT: ("interrupted", INTERRUPTED), signal.SIGTERM: ("terminated", 143)}

_writing = threading.Lock()
_written: list[Path] = []
_at_the_end: list[Callable[[], None]] = []
_asked_first: list[Callable[[], None]] = []


def leave_at_once_on_signals() -> None:
    """From here on Ctrl-C ends the process within moments, whatever its main thread is doing. Call it once, there."""
    woken, wakes = os.pipe()
    if os.name == "posix":
        os.set_blocking(wakes, False)
    caught = [number for number in _ENDINGS if signal.getsignal(number) is not signal.SIG_IGN]  # a shell's & ignores it
    for number in caught:
        signal.signal(number, _leave_it_to_the_thread)
    signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
    threading.Thread(target=_wait, args=(woken,), name="signals", daemon=True).start()


def done() -> None:
    """The command has come to its end and its status is settled: Ctrl-C no longer changes what it says."""
    for number in _ENDINGS:
        signal.signal(number, signal.SIG_IGN)


def _leave_it_to_the_thread(number: int, frame: object) -> None:
    """A handler must exist, or the signal would wake nobody."""


def _wait(woken: int) -> None:
    while True:
        (number,) = os.read(woken, 1)
        if number == signal.SIGINT and _asked_first:
            _asked_first.pop()()
        elif number in _ENDINGS:
            _leave(*_ENDINGS[signal.Signals(number)])


def _leave(word: str, status: int) -> None:
    _writing.acquire()  # for ever: files that are being written come first, and none after them
    for end in reversed(_at_the_end):
        with contextlib.suppress(Exception):
            end()
    with contextlib.suppress(OSError):
        os.write(2, f"thermohyd: {word}; {one_line(what_was_written())}\n".encode(errors="replace"))
    os._exit(status)


def begin() -> None:
    """A command begins: nothing has been written yet."""
    _written.clear()


@contextlib.contextmanager
def unbroken() -> Iterator[None]:
    """Within, a signal waits for the end of the block."""
    with _writing:
        yield


@contextlib.contextmanager
def whole_files(folder: Path) -> Iterator[None]:
    """Within, a signal waits until all files are there; then the folder counts as written."""
    with unbroken():
        yield
        _written.append(folder)


@contextlib.contextmanager
def when_interrupted(end: Callable[[], None]) -> Iterator[None]:
    """Within, a signal calls `end` before the process leaves; from another thread, so it must be quick and wait for nothing."""
    _at_the_end.append(end)
    try:
        yield
    finally:
        _at_the_end.remove(end)


@contextlib.contextmanager
def first_interrupt_asks(call: Callable[[], None]) -> Iterator[None]:
    """Within, the first Ctrl-C calls `call`, from another thread, and ends nothing; the second ends the process as ever."""
    _asked_first.append(call)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):  # it was called
            _asked_first.remove(call)


def always_when_interrupted(end: Callable[[], None]) -> None:
    """The same until the process ends."""
    if end not in _at_the_end:
        _at_the_end.append(end)


def what_was_written() -> str:
    """The files that a command has written so far, as the end of a sentence."""
    if not _written:
        return "nothing was written"
    return f"the files in {', '.join(map(str, _written))} are complete, nothing else was written"
