"""The cells of a CSV file as columns of numbers, and where one is none, the first bad cell."""

import csv
import io

import numpy as np
import pandas as pd

from .csv_lines import CsvLines, split_cells
from .errors import BenchInputError, quoted


class CsvCells:
    """The table of a file. Numbers are checked only for the columns that are asked for: others may hold anything."""

    def __init__(self, source: CsvLines, texts: tuple[int, ...] = ()) -> None:
        """`texts`: columns that stay as they are written (run names). Raises BenchInputError for uneven rows."""
        self.source = source
        _check_lengths(source)
        width = len(source.header)
        body = "\n".join(source.lines)
        # A comma that separates nothing is a decimal one: then everything is read as text first, and no thousands
        # separator can pass for a decimal point.
        self._decimal_comma = source.separator != "," and "," in body
        if '"' in body:
            rows = [
                split_cells(line, source.separator, source.path, number)
                for line, number in zip(source.lines, source.numbers, strict=True)
            ]
            self.frame = pd.DataFrame(rows, columns=range(width), dtype=str)
        else:
            self.frame = pd.read_csv(
                io.StringIO(body),
                header=None,
                names=list(range(width)),
                index_col=False,
                sep=source.separator,
                quoting=csv.QUOTE_NONE,
                skipinitialspace=True,
                na_filter=False,
                low_memory=False,
                dtype=str if self._decimal_comma else dict.fromkeys(texts, str),
            )

    def error(self, column: int, row: int | None, message: str) -> BenchInputError:
        """An error about a column, and one row of it if given."""
        line = self.source.header_line if row is None else self.source.numbers[row]
        return BenchInputError(message, file=self.source.path, line=line, column=self.source.header[column])

    def texts(self, column: int) -> np.ndarray:
        """The column as stripped text."""
        return self.frame[column].astype(str).str.strip().to_numpy(dtype=object)

    def numbers(self, column: int) -> np.ndarray:
        """The column as finite floats. Raises BenchInputError with the line of the first cell that is none.

        A column that had to be converted from text stays converted in `frame`.
        """
        series = self.frame[column]
        if series.dtype.kind not in "iuf":
            text = series.astype(str).str.strip()
            if self._decimal_comma:
                text = self._with_points(column, text)
            # Python's own float() would let "1_000" and "infinity" pass; pandas' does not take the former.
            series = pd.Series(np.asarray(pd.to_numeric(text, errors="coerce"), dtype=float))
            bad = np.flatnonzero(np.isnan(series))
            if len(bad):
                raise self.error(column, int(bad[0]), self._complaint(str(text.iloc[bad[0]])))
            self.frame[column] = series
        values = np.asarray(series, dtype=float)
        finite = np.isfinite(values)
        if not finite.all():
            row = int(np.flatnonzero(~finite)[0])
            raise self.error(column, row, f"{values[row]} is not a finite number; leave the row out")
        return values

    def _with_points(self, column: int, text: pd.Series) -> pd.Series:
        points = text.str.contains(".", regex=False).to_numpy(dtype=bool)
        if points.any() and text.str.contains(",", regex=False).any():
            row = int(np.flatnonzero(points)[0])
            message = (
                f"{quoted(text.iloc[row])} has a decimal point where other rows have decimal commas; use one of them"
            )
            raise self.error(column, row, message)
        return text.str.replace(",", ".", regex=False)

    def _complaint(self, cell: str) -> str:
        if not cell:
            return "the cell is empty; expected a number (leave out rows without a reading)"
        if cell.lower() in ("nan", "na", "n/a", "null", "none", "-", "#n/a", "1.#qnan", "-1.#ind"):
            return f"{quoted(cell)} is not a finite number; leave the row out"
        hint = "; expected a number such as 1.5"
        if "," in cell and self.source.separator == ",":
            hint = "; decimal commas need semicolons or tabs between the columns"
        return f"{quoted(cell)} is not a number{hint}"


def _check_lengths(source: CsvLines) -> None:
    """Every row has as many cells as there are headers; quoted files are counted cell by cell."""
    width = len(source.header)
    for line, number in zip(source.lines, source.numbers, strict=True):
        found = line.count(source.separator) + 1
        if found != width and '"' in line:
            found = len(split_cells(line, source.separator, source.path, number))
        if found != width:
            raise BenchInputError(
                f"the row has {found} {'cell' if found == 1 else 'cells'}, but there are {width} headers; "
                "is the line cut off, or the separator wrong?",
                file=source.path,
                line=number,
            )
