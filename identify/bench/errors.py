"""Bad input, said in one line: where it is (file, line, column or key), what is wrong, and what would be right."""

import difflib
from collections.abc import Iterable
from pathlib import Path


# Longer text from a file is cut in messages: a message is one line that a terminal can show.
LONGEST_QUOTE = 60
# Longer headers, cells and quantities are refused before anything looks into them.
LONGEST_TEXT = 200


class BenchInputError(Exception):
    """A record, model file or option that cannot be used. `str()` is one line, ready for the terminal (exit status 2).

    file: the file (or folder) at fault, or the name of a test of a record made from arrays; line: its line, counted from
    1, comment lines included; row: instead of a line, the row of a file that has no lines (a spreadsheet's own number) or
    of arrays (from 0, as `iloc` counts); column: the header; key: the TOML key, such as "[valve] stroke". Any of them may
    be None.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        row: int | None = None,
        column: str | None = None,
        key: str | None = None,
    ) -> None:
        super().__init__(message)
        self.message = one_line(message)
        self.file = None if file is None else Path(file)
        self.line = line
        self.row = row
        self.column = column
        self.key = key

    def __str__(self) -> str:
        place = [] if self.file is None else [one_line(str(self.file))]
        if self.line is not None:
            place.append(f"line {self.line}")
        if self.row is not None:
            place.append(f"row {self.row}")
        if self.column is not None:
            place.append(f"column {quoted(self.column)}")
        if self.key is not None:
            place.append(one_line(self.key))
        return ": ".join(part for part in (", ".join(place), self.message) if part)


def one_line(text: str) -> str:
    """The text without line breaks or other characters that would disturb a terminal."""
    return "".join(c if c.isprintable() else " " if c.isspace() else c.encode("unicode_escape").decode() for c in text)


def quoted(text: object, longest: int = LONGEST_QUOTE) -> str:
    """What a user wrote, in double quotes, cut to a readable length."""
    try:
        plain = one_line(str(text))
    except ValueError:  # Python refuses to print integers of thousands of digits
        plain = "a number of thousands of digits"
    return f'"{plain}"' if len(plain) <= longest else f'"{plain[:longest]}..."'


def listed(parts: Iterable[str], most: int) -> str:
    """The parts with commas between them; where there are more than `most`, how many were left out."""
    every = list(parts)
    more = len(every) - most
    return ", ".join(every) if more <= 0 else f"{', '.join(every[:most])} and {more} more"


def suggestion(name: str, known: Iterable[str]) -> str:
    """The end of a sentence about an unknown name: the closest known one, or all of them where none is close."""
    names = list(known)
    lowered = {n.lower(): n for n in names}
    close = difflib.get_close_matches(name.lower()[:LONGEST_QUOTE], lowered, n=1, cutoff=0.6)
    return f"did you mean {quoted(lowered[close[0]])}?" if close else f"known: {', '.join(names)}"
