"""The cells of a test's file, whatever its format, as columns of numbers, dates and texts, with every cell that cannot be read.

A missing cell (empty, "n/a") is told from a bad one, which holds something that is no number. The bad cells of all tests of a
record are refused in one message: how many, the first of them, what to do. Dates and times of day become seconds since the
first row: ISO 8601, 31.12.2026, 12/31/2026, or a time alone. Numbers are checked only in the columns that are asked for.
"""

import re
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd

from .errors import LONGEST_QUOTE, LONGEST_TEXT, BenchInputError, one_line, quoted


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

    def __init__(self, tests: Sequence[BadCellsOfTest], folder: Path | None) -> None:
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


DAY = 86400.0  # s
TIME = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?(?:\s*[AaPp][Mm])?(?:\s*(?:Z|[+-]\d{2}:?\d{2}))?"
DATE = r"(?:\d{4}([-/.])\d{1,2}\1\d{1,2}|\d{1,2}([-/.])\d{1,2}\2\d{4})"
# A time alone needs its seconds: "12:30" may be hours and minutes, or minutes and seconds.
CLOCK = re.compile(rf"{DATE}[T ,]\s*{TIME}|\d{{1,3}}:\d{{2}}:\d{{2}}(?:[.,]\d+)?(?:\s*[AaPp][Mm])?")
PARTS = (
    r"^(?:(?P<a>\d{1,4})(?P<mark>[-/.])(?P<b>\d{1,2})[-/.](?P<c>\d{1,4})[T ,]\s*)?"
    r"(?P<hour>\d{1,3}):(?P<minute>\d{2})(?::(?P<second>\d{2}(?:[.,]\d+)?))?"
    r"(?:\s*(?P<half>[AaPp])[Mm])?(?:\s*(?P<zone>Z|[+-]\d{2}:?\d{2}))?$"
)


def is_clock_time(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day with seconds."""
    return len(cell) <= 40 and CLOCK.fullmatch(cell) is not None


def clock_seconds(series: pd.Series, text: pd.Series) -> np.ndarray:
    """Seconds since the first row (n,), NaN where a cell is neither date nor time. text: the series as stripped text.

    Raises ValueError with a sentence where day and month cannot be told apart and it matters.
    """
    if series.dtype.kind == "M":
        found = (series - series.dropna().iloc[0] if series.notna().any() else series - series).dt.total_seconds()
        return found.to_numpy(dtype=float)
    if series.dtype.kind == "m":
        found = series.dt.total_seconds().to_numpy(dtype=float)
        return found - found[np.isfinite(found)][0] if np.isfinite(found).any() else found
    parts = text.str.extract(PARTS)
    hour = _numbers(parts["hour"])
    half = parts["half"].str.lower()
    hour = np.where(half.notna(), hour % 12 + 12.0 * (half == "p"), hour)
    second = _numbers(parts["second"].str.replace(",", ".", regex=False))
    minute = _numbers(parts["minute"])
    seconds = 3600.0 * hour + 60.0 * minute + np.nan_to_num(second) - _zone(parts["zone"])
    seconds[(minute > 59.0) | (second >= 61.0)] = np.nan
    if parts["a"].notna().any():
        seconds[hour > 24.0] = np.nan
        days = _days(parts)
        seconds += DAY * (days - _first(days))
    else:  # over midnight a time of day falls by almost a day
        valid = np.flatnonzero(np.isfinite(seconds))
        seconds[valid[1:]] += DAY * np.cumsum(np.diff(seconds[valid]) < -0.5 * DAY)
    return seconds - _first(seconds)


def _first(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len(finite) else 0.0


def _numbers(column: Any) -> np.ndarray:
    return np.array(pd.to_numeric(column, errors="coerce"), dtype=float)


def _zone(column: pd.Series) -> np.ndarray:
    """Seconds by which each row's clock is ahead of UTC; 0 where none is given."""
    number = np.nan_to_num(_numbers(column.str.replace(":", "", regex=False)))  # "Z" becomes 0
    return np.sign(number) * (np.abs(number) // 100 * 3600.0 + np.abs(number) % 100 * 60.0)


def _days(parts: pd.DataFrame) -> np.ndarray:
    """Days since 1970 of each row, NaN where the date is none."""
    a, b, c = (_numbers(parts[name]) for name in "abc")
    if (a > 31.0).any():  # the year stands first
        return _day_numbers(a, b, c)
    day, month = a, b
    if "." not in set(parts["mark"]):  # with dots, the day stands first everywhere
        if (a > 12.0).any() and (b > 12.0).any():
            return np.full(len(parts), np.nan)
        if (b > 12.0).any():
            day, month = b, a
        elif not (a > 12.0).any() and len({*zip(a[np.isfinite(a)], b[np.isfinite(a)], strict=True)}) > 1:
            raise ValueError(
                "the day and the month of these dates cannot be told apart; write them as 2026-03-01 or 01.03.2026"
            )
    return _day_numbers(c, month, day)


def _day_numbers(year: np.ndarray, month: np.ndarray, day: np.ndarray) -> np.ndarray:
    stamps = pd.to_datetime(pd.DataFrame({"year": year, "month": month, "day": day}), errors="coerce")
    days = (stamps - pd.Timestamp(1970, 1, 1)).dt.total_seconds() / DAY
    return days.to_numpy(dtype=float)


NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"  # each text in one way only: a long one is read once
THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d*|[+-]?\d{1,3}(?:\.\d{3})+,\d*|[+-]?\d{1,3}(?:[ ',]\d{3}){2,}")


def _too_long(text: str) -> tuple[str, str]:
    """(what is wrong with a cell of a column that is read, what would be right)"""
    return (
        f"the cell has {len(text):,} characters, more than {LONGEST_TEXT}",
        "expected a number such as 1.5, or a name",
    )


@dataclass(frozen=True)
class Source:
    """The headers of a file and its rows, not yet numbers. numbers: of each row in the file, from 1, as users count them."""

    path: Path
    header: list[str]
    header_line: int
    numbers: np.ndarray

    word = "line"  # how the place of a row is called
    noun = "file"  # and what holds them

    @abstractmethod
    def top(self, most: int) -> Iterable[tuple[int, list[str]]]:
        """(number, cells) of the first rows, that of the headers first."""

    @abstractmethod
    def first_row(self) -> list[str]:
        """The cells below the headers."""

    @abstractmethod
    def after_first_row(self) -> "Source":
        """The same without its first row. Raises BenchInputError where none is left."""

    def error(self, message: str, *, number: int | None = None, column: int | None = None) -> BenchInputError:
        """An error about a row (None: that of the headers) and a column."""
        found = self.header_line if number is None else int(number)
        line, row = line_or_row(self.word, found) if found else (None, None)  # .parquet: headers stand in no row
        header = None if column is None else self.header[column]
        return BenchInputError(message, file=self.path, line=line, row=row, column=header)


class Cells:
    """The table of a file. Numbers are checked only for the columns that are asked for: others may hold anything."""

    def __init__(
        self,
        source: Source,
        frame: pd.DataFrame,
        *,
        decimal_comma: bool = False,
        separator: str = "",
        bad_rows: tuple[BadCell, ...] = (),
        unreadable: Mapping[int, str] | None = None,
    ) -> None:
        """bad_rows: rows of the file that are none of the frame's. unreadable: {column: what it holds, neither number nor text}"""
        self.source = source
        self.frame = frame
        self._decimal_comma = decimal_comma
        self._separator = separator
        self._bad_rows = bad_rows
        self._unreadable = unreadable or {}
        self._missing: dict[int, np.ndarray] = {}
        self._wrong: dict[int, np.ndarray] = {}
        self._clocks: set[int] = set()

    def error(self, column: int, row: int | None, message: str) -> BenchInputError:
        """An error about a column, and one row of it if given."""
        number = None if row is None else int(self.source.numbers[row])
        return self.source.error(message, number=number, column=column)

    def texts(self, column: int) -> np.ndarray:
        """The column as stripped text. Raises BenchInputError where a cell is too long to be a name or a number."""
        text = self._text(column)
        long = np.flatnonzero(text.str.len().to_numpy() > LONGEST_TEXT)
        if len(long):
            what, remedy = _too_long(text.iloc[long[0]])
            raise self.error(column, int(long[0]), f"{what}; {remedy}")
        codes, names = pd.factorize(text)  # of a name that stands in many rows one copy is kept
        return np.asarray(names, dtype=object)[codes]

    def _series(self, column: int) -> pd.Series:
        if column in self._unreadable:
            what = quoted(self._unreadable[column], 30)
            raise self.error(column, None, f"holds {what} in every cell; expected a column of numbers, times or texts")
        return cast(pd.Series, self.frame[column])

    def _text(self, column: int) -> pd.Series:
        series = self._series(column)
        return cast(pd.Series, series.astype(str).str.strip().where(series.notna(), ""))

    def numbers(self, column: int) -> np.ndarray:
        """The column as floats, NaN where a cell is missing or no finite number: `missing` and `bad_cells` tell which.

        A column that had to be converted from text stays converted in `frame`.
        """
        series = self._series(column)
        if series.dtype.kind in "iuf":
            values = np.array(series, dtype=float)
            missing = np.isnan(values)
        else:
            text = self._text(column)
            if self._decimal_comma:
                text = self._with_points(column, text)
            # Python's own float() would let "1_000" and "infinity" pass; pandas' does not take the former.
            values = np.array(pd.to_numeric(text, errors="coerce"), dtype=float)
            missing = np.zeros(len(values), bool)
            empty = np.flatnonzero(np.isnan(values))
            missing[empty] = [cell.lower() in MISSING for cell in text.iloc[empty]]
            if not len(empty):
                self.frame[column] = values
        return self._noted(column, values, missing)

    def is_clock(self, column: int) -> bool:
        """Whether the column holds dates or times of day: whether its first cell that is not missing does."""
        series = self._series(column)
        if series.dtype.kind in "iuf":
            return False
        if series.dtype.kind in "mM":
            return True
        texts = ("" if pd.isna(cell) else str(cell).strip() for cell in series)
        first = next((text for text in texts if text.lower() not in MISSING), "")
        return is_clock_time(first)

    def seconds(self, column: int) -> np.ndarray:
        """Dates and times of day as seconds since the first row, NaN where a cell is missing or holds neither."""
        text = self._text(column)
        missing = text.str.lower().isin(MISSING).to_numpy(dtype=bool)
        self._clocks.add(column)
        text = text.where(text.str.len() <= LONGEST_TEXT, "?")
        try:
            return self._noted(column, clock_seconds(self._series(column), text), missing)
        except ValueError as error:
            raise self.error(column, int(np.flatnonzero(~missing)[0]), str(error)) from None

    def _noted(self, column: int, values: np.ndarray, missing: np.ndarray) -> np.ndarray:
        self._missing[column] = missing
        self._wrong[column] = ~np.isfinite(values) & ~missing
        return np.where(np.isfinite(values), values, np.nan)

    def missing(self) -> np.ndarray:
        """Rows in which a column that was read has no reading."""
        return np.logical_or.reduce([*self._missing.values(), np.zeros(len(self.frame), bool)])

    def bad_cells(self, test: str, *, skip_missing: bool) -> BadCellsOfTest | None:
        """The bad cells of the columns that were read; None where there are none."""
        first, count = list(self._bad_rows), len(self._bad_rows)
        for column, wrong in self._wrong.items():
            bad = wrong if skip_missing else wrong | self._missing[column]
            rows = np.flatnonzero(bad)
            count += len(rows)
            first += [self._bad_cell(column, int(row)) for row in rows[:SHOWN]]
        first.sort(key=lambda cell: cell.number)
        return BadCellsOfTest(test, tuple(first[:SHOWN]), count) if count else None

    def _bad_cell(self, column: int, row: int) -> BadCell:
        what, remedy = self._complaint(column, row)
        source = self.source
        return BadCell(source.path, source.word, int(source.numbers[row]), source.header[column], what, remedy)

    def _complaint(self, column: int, row: int) -> tuple[str, str | None]:
        """(what is wrong with a cell, what would be right; None: it is missing)"""
        cell = self._series(column).iloc[row]
        text = "" if pd.isna(cell) else str(cell).strip()
        shown = quoted(text, 30)
        if not text:
            return "the cell is empty", None
        if len(text) > LONGEST_TEXT:
            return _too_long(text)
        if text.lower() in MISSING:
            return f"{shown} is not a number", None
        if column in self._clocks:
            return f"{shown} is no date and time", "expected one such as 2026-03-01 12:00:00.5, as in the first row"
        if re.fullmatch(NUMBER + r"|[+-]?inf(?:inity)?", text.replace(",", "."), re.IGNORECASE) and (
            "," not in text or self._decimal_comma
        ):
            return f"{text[:30]} is not a finite number", "leave the row out"
        if THOUSANDS.fullmatch(text):
            return f"{shown} is not a number", "write numbers without separators between the thousands"
        if re.fullmatch(NUMBER + r"\s*[^\W\d_].*|" + NUMBER + r"\s*[%°].*", text, re.DOTALL):
            return f"{shown} is not a number", "the unit stands in the header only"
        if "," in text and self._separator == ",":
            return f"{shown} is not a number", "decimal commas need semicolons or tabs between the columns"
        return f"{shown} is not a number", "expected a number such as 1.5"

    def _with_points(self, column: int, text: pd.Series) -> pd.Series:
        points = text.str.contains(".", regex=False).to_numpy(dtype=bool)
        if points.any() and text.str.contains(",", regex=False).any():
            row = int(np.flatnonzero(points)[0])
            message = (
                f"{quoted(text.iloc[row])} has a decimal point where other rows have decimal commas; use one of them"
            )
            raise self.error(column, row, message)
        return text.str.replace(",", ".", regex=False)
