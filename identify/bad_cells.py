"""All cells of a record that cannot be read, in one message: how many, the first of them, and what to do."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from .errors import LONGEST_QUOTE, BenchInputError, one_line, quoted


SHOWN = 5  # cells that a message names
MISSING = frozenset(
    ("", "nan", "na", "n/a", "null", "none", "-", "--", "#n/a", "#na", "nat", "-nan", "1.#qnan", "-1.#qnan", "-1.#ind")
)  # lower case; what loggers and spreadsheets write where there is no reading


def line_or_row(word: str, number: int) -> tuple[int | None, int | None]:
    """(line, row) of a BenchInputError about a place that is called by the word."""
    return (number, None) if word == "line" else (None, number)


@dataclass(frozen=True)
class BadCell:
    """One cell, or a row as a whole (column None). what: what is wrong; remedy: what would be right, None: it is missing."""

    file: Path
    word: str  # "line" or "row": how its place is called
    number: int
    column: str | None
    what: str
    remedy: str | None

    def place(self, longest: int = LONGEST_QUOTE) -> str:
        column = "" if self.column is None else f", column {quoted(self.column, longest)}"
        return f"{self.word} {self.number}{column}"


@dataclass(frozen=True)
class BadCellsOfTest:
    """The first bad cells of a test's file, and how many there are in all."""

    test: str
    first: tuple[BadCell, ...]
    count: int


class BadCellsError(BenchInputError):
    """A BenchInputError about the bad cells of one or more tests."""

    def __init__(self, tests: Sequence[BadCellsOfTest], folder: Path) -> None:
        self.tests = tuple(tests)
        first = [cell for test in tests for cell in test.first]
        count = sum(test.count for test in tests)
        remedies = list(dict.fromkeys(cell.remedy for cell in first if cell.remedy is not None))[:2]
        lacking = [test.test for test in tests if any(cell.remedy is None for cell in test.first)]
        if lacking:
            where = " and ".join(f"[tests.{name}]" for name in lacking)
            rows = "the row" if count == 1 else "such rows"
            remedies.insert(0, f'leave {rows} out, or write missing = "skip" in {where}')
        if count == 1:
            cell = first[0]
            line, row = line_or_row(cell.word, cell.number)
            super().__init__(f"{cell.what}; {remedies[0]}", file=cell.file, line=line, row=row, column=cell.column)
            return
        files = list(dict.fromkeys(cell.file for cell in first))
        parts = []
        named = files[0] if len(files) == 1 else None
        for cell in _in_turn(tests):
            name = "" if cell.file == named else f"{one_line(cell.file.name)[:LONGEST_QUOTE]}, "
            named = cell.file
            parts.append(f"{name}{cell.place(40)}: {cell.what}")
        if count > len(parts):
            parts.append(f"and {count - len(parts):,} more")
        several = f" in {len(files)} files" if len(files) > 1 else ""
        super().__init__(
            f"{count:,} bad cells{several}: {'; '.join(parts)}. {_sentence('; '.join(remedies))}",
            file=files[0] if len(files) == 1 else folder,
        )


def _in_turn(tests: Sequence[BadCellsOfTest]) -> list[BadCell]:
    """The cells to name: some of every test, in the order of the tests."""
    left = [replace(test) for test in tests[:SHOWN]]
    share = [0] * len(left)
    while sum(share) < SHOWN and any(n < len(test.first) for n, test in zip(share, left, strict=True)):
        for i, test in enumerate(left):
            if share[i] < len(test.first) and sum(share) < SHOWN:
                share[i] += 1
    return [cell for n, test in zip(share, left, strict=True) for cell in test.first[:n]]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
