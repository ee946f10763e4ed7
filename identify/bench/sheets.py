"""The rows of an .xlsx sheet or a .parquet file. Both are archives that may unpack to far more than they show: bounded here."""

import warnings
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from thermohyd.identify.optional_parts import install

from .cells import Cells, Source
from .errors import BenchInputError, listed, one_line, quoted


LARGEST = 200_000_000  # bytes after decompression
MOST_CELLS = 20_000_000
MOST_ROWS = 1_048_576  # Excel's own limit; a file may claim any number
EXCEL = (".xlsx", ".xlsm")
ENDINGS = (*EXCEL, ".parquet")


@dataclass(frozen=True)
class SheetRows(Source):
    """The headers and rows of a sheet. numbers: as the spreadsheet shows them; of a .parquet file from 1 below the headers."""

    frame: pd.DataFrame
    word = "row"

    def top(self, most: int) -> Iterator[tuple[int, list[str]]]:
        yield self.header_line, self.header
        for number, (_, row) in zip(self.numbers, self.frame.head(most).iterrows(), strict=False):
            cells = _texts(row)
            filled = [i + 1 for i, cell in enumerate(cells) if cell]
            yield number, cells[: max(filled, default=0)]

    def first_row(self) -> list[str]:
        return _texts(self.frame.iloc[0])[: len(self.header)]

    def after_first_row(self) -> "SheetRows":
        if len(self.frame) < 2:
            raise BenchInputError("has headers but no rows", file=self.path)
        frame = pd.DataFrame(self.frame.iloc[1:].reset_index(drop=True).infer_objects())
        return replace(self, frame=frame, numbers=self.numbers[1:])

    def table(self) -> Cells:
        """Raises BenchInputError where something stands beside the columns that have headers."""
        width = len(self.header)
        for column in range(width, self.frame.shape[1]):
            filled = self.frame[column].notna().to_numpy()
            if filled.any():
                message = f"the row has {column + 1} cells, but there are {width} headers"
                raise self.error(message, number=self.numbers[int(filled.argmax())])
        return Cells(self, self.frame.iloc[:, :width].copy())


def read_sheet(path: Path, skip_rows: int = 0, sheet: str | None = None) -> SheetRows:
    """An .xlsx file (`sheet`: its name, None the first) or a .parquet file. Raises BenchInputError."""
    if path.suffix.lower() == ".parquet":
        if skip_rows:
            raise BenchInputError("a .parquet file has no lines above its headers; remove skip_rows", file=path)
        return _parquet(path)
    return _excel(path, skip_rows, sheet)


def _texts(row: Any) -> list[str]:
    return ["" if pd.isna(cell) else str(cell).strip() for cell in row]


def _excel(path: Path, skip_rows: int, sheet: str | None) -> SheetRows:
    import openpyxl

    try:
        with path.open("rb") as file:
            if file.read(4) == b"\xd0\xcf\x11\xe0":
                raise BenchInputError(
                    "has a password, or the format of Excel before 2007; save it as .xlsx without a password", file=path
                )
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(part.file_size for part in archive.infolist())
            if unpacked > LARGEST:
                raise BenchInputError(f"unpacks to more than {LARGEST:,} bytes; save the log as CSV", file=path)
            file.seek(0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about styles and extensions, which hold no readings
                book = openpyxl.load_workbook(file, read_only=True, data_only=True, keep_links=False)
                rows = _sheet_rows(book, path, skip_rows, sheet)
    except BenchInputError:
        raise
    except OSError as error:
        raise BenchInputError(f"cannot be read ({error.strerror or error})", file=path) from None
    except Exception:  # openpyxl raises whatever it trips over in a damaged or hostile archive
        raise BenchInputError("is no .xlsx file, or a damaged one; save it again, or as CSV", file=path) from None
    if not rows:
        raise BenchInputError("is empty; expected a row of headers and at least one row", file=path)
    header_line, first = rows[0]
    width = max(i + 1 for i, cell in enumerate(first) if cell is not None)
    numbers, cells = [number for number, _ in rows[1:]], [row for _, row in rows[1:]]
    if not cells:
        raise BenchInputError("has headers but no rows", file=path, row=header_line)
    wide = max(width, *(len(row) for row in cells))
    if wide * len(cells) > MOST_CELLS:  # one far cell, and every row is as wide
        raise BenchInputError(f"has more than {MOST_CELLS:,} cells; save the log as CSV", file=path)
    padded = [[*row, *[None] * (wide - len(row))] for row in cells]
    frame = pd.DataFrame(padded, columns=range(wide), dtype=object).infer_objects()
    header = ["" if cell is None else one_line(str(cell)).strip() for cell in first[:width]]
    return SheetRows(path, header, header_line, numbers, frame)


def _filled(row: Sequence[Any]) -> bool:
    """Whether a row is one of the table: not empty, and no comment."""
    first = next((cell for cell in row if cell is not None and (not isinstance(cell, str) or cell.strip())), None)
    return first is not None and not (isinstance(first, str) and first.lstrip().startswith("#") and first != "#N/A")


def _sheet_rows(book: Any, path: Path, skip_rows: int, sheet: str | None) -> list[tuple[int, Sequence[Any]]]:
    """(number in the sheet, cells) of each row that holds some."""
    sheets = {page.title: page for page in book.worksheets}
    if not sheets:
        raise BenchInputError("holds no sheet with cells", file=path)
    if sheet is not None and sheet not in sheets:
        names = listed([quoted(name) for name in sheets], 8)
        raise BenchInputError(f"has no sheet {quoted(sheet)}; it has {names}", file=path)
    page = next(iter(sheets.values())) if sheet is None else sheets[sheet]
    page.reset_dimensions()  # what the file says of its own size need not be true
    found, cells = [], 0
    for number, row in enumerate(page.iter_rows(values_only=True), start=1):
        cells += len(row) + 1
        if cells > MOST_CELLS or number > MOST_ROWS:
            raise BenchInputError(
                f"has more than {MOST_CELLS:,} cells or {MOST_ROWS:,} rows; save the log as CSV", file=path
            )
        if row and number > skip_rows and _filled(row):
            found.append((number, row))
    return found


def _parquet(path: Path) -> SheetRows:
    try:
        from pyarrow import parquet
    except ImportError:
        raise BenchInputError(
            f"needs the package pyarrow: {install('parquet')}; or save the log as CSV", file=path
        ) from None
    try:
        with parquet.ParquetFile(path) as file:
            about = file.metadata
            size = sum(about.row_group(i).total_byte_size for i in range(about.num_row_groups))
            if size > LARGEST or about.num_rows * max(1, about.num_columns) > MOST_CELLS:
                raise BenchInputError(
                    f"has more than {MOST_CELLS:,} cells or {LARGEST:,} bytes; thin the log before fitting", file=path
                )
            frame = file.read().to_pandas()
    except BenchInputError:
        raise
    except Exception as error:  # pyarrow raises whatever it trips over, OSError for a damaged page
        if isinstance(error, OSError) and error.errno is not None:
            raise BenchInputError(f"cannot be read ({error.strerror})", file=path) from None
        raise BenchInputError("is no .parquet file, or a damaged one; write it again", file=path) from None
    header, frame = headers_apart(frame, path)
    return SheetRows(path, header, 0, list(range(1, len(frame) + 1)), frame)


def headers_apart(frame: pd.DataFrame, path: Path) -> tuple[list[str], pd.DataFrame]:
    """(headers, the rows under numbered columns); an index with a name is a column. The frame given stays as it is."""
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index()
    if not len(frame.columns) or not len(frame):
        raise BenchInputError("is empty; expected columns and at least one row", file=path)
    header = [one_line(str(name)).strip() for name in frame.columns]
    frame = frame.reset_index(drop=True)
    frame.columns = range(len(header))
    return header, frame
