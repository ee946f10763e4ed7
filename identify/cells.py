"""The cells of a test's file, whatever its format, as columns of numbers; which of them are missing, and which are none."""

import re
from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd

from .bad_cells import MISSING, SHOWN, BadCell, BadCellsOfTest, line_or_row
from .clock_times import clock_seconds, is_clock_time
from .errors import BenchInputError, quoted


NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+\.\d*|[+-]?\d{1,3}(?:\.\d{3})+,\d*|[+-]?\d{1,3}(?:[ ',]\d{3}){2,}")


@dataclass(frozen=True)
class Source:
    """The headers of a file and its rows, not yet numbers. numbers: of each row in the file, from 1, as users count them."""

    path: Path
    header: list[str]
    header_line: int
    numbers: list[int]

    word = "line"  # how the place of a row is called

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
        found = self.header_line if number is None else number
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
    ) -> None:
        """bad_rows: rows of the file that are none of the frame's."""
        self.source = source
        self.frame = frame
        self._decimal_comma = decimal_comma
        self._separator = separator
        self._bad_rows = bad_rows
        self._missing: dict[int, np.ndarray] = {}
        self._wrong: dict[int, np.ndarray] = {}
        self._clocks: set[int] = set()

    def error(self, column: int, row: int | None, message: str) -> BenchInputError:
        """An error about a column, and one row of it if given."""
        number = None if row is None else self.source.numbers[row]
        return self.source.error(message, number=number, column=column)

    def texts(self, column: int) -> np.ndarray:
        """The column as stripped text."""
        return self._text(column).to_numpy(dtype=object)

    def _series(self, column: int) -> pd.Series:
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
        return BadCell(source.path, source.word, source.numbers[row], source.header[column], what, remedy)

    def _complaint(self, column: int, row: int) -> tuple[str, str | None]:
        """(what is wrong with a cell, what would be right; None: it is missing)"""
        cell = self._series(column).iloc[row]
        text = "" if pd.isna(cell) else str(cell).strip()
        shown = quoted(text, 30)
        if not text:
            return "the cell is empty", None
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
