"""Open a file that somebody else may have chosen: plain files only, and no more of them than is read, packed or unpacked."""

import io
import json
import os
import stat
from pathlib import Path
from typing import Any

from .errors import BenchInputError


# The one limit of a test's file, in bytes of what it unpacks to. A value of a binary file counts for eight bytes at least.
LARGEST = 400_000_000
LARGEST_JSON = 10_000_000  # bytes; of nothing but brackets it still fits into the memory
TOO_LARGE = "thin the log before fitting"


def open_input(path: Path, largest: int = LARGEST, remedy: str = TOO_LARGE) -> io.BufferedIOBase:
    """A plain file of at most `largest` bytes, opened for reading. Raises BenchInputError.

    A pipe or a device may never end. One that says it is empty is taken at its word: /proc/kmsg, a plain file by its mode, waits for
    ever.
    """
    try:
        place = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except FileNotFoundError:
        raise BenchInputError("no such file", file=path) from None
    except (OSError, ValueError) as error:
        raise cannot_be_read(path, error) from None
    about = os.fstat(place)
    size, wrong = about.st_size, ""
    if not stat.S_ISREG(about.st_mode):
        wrong = "is a folder" if stat.S_ISDIR(about.st_mode) else "is no plain file, but a device or a pipe"
    elif size > largest:
        wrong = f"has {size:,} bytes, more than the {largest:,} that are read; {remedy}"
    if wrong or not size:
        os.close(place)
        if wrong:
            raise BenchInputError(wrong, file=path)
        return io.BytesIO()
    return os.fdopen(place, "rb")


def read_input(path: Path, largest: int = LARGEST, remedy: str = TOO_LARGE) -> bytes:
    """The content of a plain file of at most `largest` bytes. Raises BenchInputError."""
    with open_input(path, largest, remedy) as file:
        try:
            return file.read()
        except OSError as error:
            raise cannot_be_read(path, error) from None


def cannot_be_read(path: Path, error: Exception) -> BenchInputError:
    """What the system says of a file that it does not give."""
    return BenchInputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", file=path)


def read_json(path: Path, expected: str, largest: int = LARGEST_JSON) -> Any:
    """What a JSON file holds. expected: which file it should be, for messages. Raises BenchInputError."""
    raw = read_input(path, largest, f"expected {expected}")
    try:
        return json.loads(raw.decode("utf-8"))
    except UnicodeDecodeError:
        raise BenchInputError(f"is not UTF-8 text; expected {expected}", file=path) from None
    except json.JSONDecodeError as error:
        raise BenchInputError(
            f"is not valid JSON: {error.msg}; expected {expected}", file=path, line=error.lineno
        ) from None
    except ValueError:  # Python's limit on the digits of an integer
        raise BenchInputError(f"holds a number of thousands of digits; expected {expected}", file=path) from None
    except RecursionError:
        raise BenchInputError(f"is nested too deeply; expected {expected}", file=path) from None


class Allowance:
    """What may still be unpacked of a test's file."""

    def __init__(self, path: Path, remedy: str = TOO_LARGE) -> None:
        self._path, self._remedy = path, remedy
        self.taken = 0

    @property
    def left(self) -> int:
        return LARGEST - self.taken

    def take(self, size: float, what: str = "unpacks to") -> None:
        """Count `size` bytes, before room is made for them. Raises BenchInputError once it is more than is read."""
        self.taken += int(min(max(size, 0.0), 1e18))
        if self.taken > LARGEST:
            raise BenchInputError(
                f"{what} {self.taken:,} bytes or more, which is more than the {LARGEST:,} that are read; {self._remedy}",
                file=self._path,
            )
