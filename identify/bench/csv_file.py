"""Read a logger's CSV file: decoded, comments set aside, separator found, every line with its number; then its cells as a table.

The text stays in one piece, and a line is a pair of places in it: as objects of their own, short lines would take ten times the memory.
Rows with another number of cells than there are headers are set aside as bad rows. Line numbers count comments, so that a message names
the line that an editor shows.
"""

import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from .cells import BadCell, Cells, Source
from .errors import BenchInputError, quoted
from .input_file import Allowance, cannot_be_read, open_input


NO_FIRST_OF_A_ROW = np.isin(np.arange(256), list(b" \t,;\"'#"))  # a line that begins so may be empty, or a comment
BLOCK = 1 << 20  # bytes that are unpacked at once
CELLS_AT_ONCE = 1_000_000  # while they are parsed
LONGEST_HEADER = 100_000  # characters of their line: a thousand columns of long names


@dataclass(frozen=True)
class CsvLines(Source):
    """The header's cells and the data lines of a file, with their line numbers (from 1, comments included).

    begins, ends: where the lines stand in `text` (UTF-8). closed: whether a separator that ends every line was left out of them.
    """

    separator: str
    header_text: str
    text: bytes
    begins: np.ndarray
    ends: np.ndarray
    closed: bool = False

    def line(self, row: int) -> str:
        """A data line, told by its place from 0."""
        return self.text[self.begins[row] : self.ends[row]].decode()

    def top(self, most: int) -> Iterator[tuple[int, list[str]]]:
        """Each line split by the separator that it uses itself: lines above the headers often use another."""
        few = range(min(most, len(self.numbers)))
        rows = [(self.header_line, self.header_text), *((int(self.numbers[row]), self.line(row)) for row in few)]
        for number, line in rows:
            yield number, [cell.strip(" \t\"'") for cell in line.split(_separator(line))]

    def first_row(self) -> list[str]:
        """The cells below the headers."""
        return [cell.strip() for cell in self.cells(0)]

    def cells(self, row: int) -> list[str]:
        """The cells of a data line, quotes taken off. Raises BenchInputError."""
        return split_cells(self.line(row), self.separator, self.path, int(self.numbers[row]))

    def after_first_row(self) -> "CsvLines":
        if len(self.numbers) < 2:
            raise BenchInputError("has headers but no rows", file=self.path, line=self.header_line)
        return self.only(np.arange(len(self.numbers)) > 0)

    def only(self, wanted: np.ndarray) -> "CsvLines":
        """The same with some of its rows (rows,)."""
        return replace(self, numbers=self.numbers[wanted], begins=self.begins[wanted], ends=self.ends[wanted])

    def body(self) -> bytes:
        """The data lines alone; a separator that closes them is still there."""
        ends = self.ends + self.closed
        breaks = np.flatnonzero(self.begins[1:] != ends[:-1] + 1)  # behind which a line was set aside
        first, last = [0, *(breaks + 1).tolist()], [*breaks.tolist(), len(ends) - 1]
        return b"\n".join(self.text[self.begins[a] : ends[b]] for a, b in zip(first, last, strict=True))

    def separators(self) -> np.ndarray:
        """How many each data line has, in quotes too (rows,)."""
        places = np.flatnonzero(np.frombuffer(self.text, np.uint8) == ord(self.separator))
        return np.searchsorted(places, self.ends) - np.searchsorted(places, self.begins)


def read_csv_lines(path: Path, skip_rows: int = 0) -> CsvLines:
    """Read a CSV file as headers and lines. `skip_rows`: lines above the headers.

    Raises BenchInputError where the file cannot be read or is empty.
    """
    text = as_utf8(read_bytes(path), path)
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    letters = np.frombuffer(text, np.uint8)
    ends = np.append(np.flatnonzero(letters == ord("\n")), len(text))
    if skip_rows and skip_rows >= len(ends):
        raise BenchInputError(f"has {len(ends)} lines, but skip_rows leaves out {skip_rows}", file=path)
    begins = np.append(0, ends[:-1] + 1)
    rows = begins < ends
    rows[:skip_rows] = False
    open_ = np.flatnonzero(rows)
    open_ = open_[NO_FIRST_OF_A_ROW[letters[begins[open_]]]]
    rows[open_] = [_is_row(text[begins[i] : ends[i]]) for i in open_]
    numbers = np.flatnonzero(rows) + 1
    header, *_ = lines = [text[begins[n - 1] : ends[n - 1]].decode() for n in numbers[:2].tolist()] or [""]
    if re.fullmatch(r'"?sep=.?"?', header.strip()):  # Excel's own first line
        header, numbers = "".join(lines[1:]), numbers[1:]
    if not len(numbers):
        raise BenchInputError("is empty; expected a line of headers and at least one row", file=path)
    header_line, numbers = int(numbers[0]), numbers[1:]
    if len(header) > LONGEST_HEADER:
        words = f"the line of headers has {len(header):,} characters; expected one name and unit per column, such as spool_position [um]"
        raise BenchInputError(words, file=path, line=header_line)
    separator = _separator(header)
    names = [cell.strip() for cell in split_cells(header, separator, path, header_line)]
    if not len(numbers):
        raise BenchInputError("has headers but no rows", file=path, line=header_line)
    begins, ends = begins[numbers - 1], ends[numbers - 1]
    return _without_last_separator(CsvLines(path, names, header_line, numbers, separator, header, text, begins, ends))


def _is_row(line: bytes) -> bool:
    """Whether a line holds a cell, and is no comment."""
    return bool(line.strip(b" \t,;\"'")) and not line.lstrip(b" \t\"'").startswith(b"#")


def _without_last_separator(source: CsvLines) -> CsvLines:
    """Many loggers end every row with a separator, and some the headers too: no column stands behind it."""
    header, wide = source.header, source.line(0).count(source.separator) + 1
    letters = np.frombuffer(source.text, np.uint8)
    closed = bool((letters[source.ends - 1] == ord(source.separator)).all())
    if len(header) > 1 and not header[-1]:
        if closed:
            return replace(source, header=header[:-1], ends=source.ends - 1, closed=True)
        if wide == len(header) - 1:
            return replace(source, header=header[:-1])
    elif wide == len(header) + 1 and closed:
        return replace(source, ends=source.ends - 1, closed=True)
    return source


def split_cells(line: str, separator: str, path: Path, number: int) -> list[str]:
    """The cells of one line, quotes taken off."""
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    except (csv.Error, StopIteration):
        raise BenchInputError(f"a quote is not closed in {quoted(line)}", file=path, line=number) from None


def read_bytes(path: Path) -> bytes:
    """The content of a text file, gzip unpacked. Raises BenchInputError where it is larger than is read."""
    with open_input(path) as file:
        try:
            packed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            if not packed:
                return file.read()
            with gzip.open(file) as unpacked:
                raw = b"".join(_blocks(unpacked, path))
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise BenchInputError("is a damaged gzip file; compress it again", file=path) from None
        except (OSError, ValueError) as error:
            raise cannot_be_read(path, error) from None
    return raw


def _blocks(unpacked: gzip.GzipFile, path: Path) -> Iterator[bytes]:
    allowance = Allowance(path)
    while block := unpacked.read(BLOCK):
        allowance.take(len(block))
        yield block


def as_utf8(raw: bytes, path: Path) -> bytes:
    """The text of a file, in whatever it was written, as UTF-8. Raises BenchInputError where it is none."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return raw.decode("utf-16").encode()
        except UnicodeDecodeError:
            raise BenchInputError("is not text; expected a CSV file", file=path) from None
    if raw.startswith(b"PK\x03\x04"):
        raise BenchInputError("is no CSV file but an .xlsx or zip file; give it its own ending", file=path)
    if b"\0" in raw:
        line = raw[: raw.index(b"\0")].count(b"\n") + 1
        raise BenchInputError("is not text; expected a CSV file", file=path, line=line)
    try:
        raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1").encode()  # loggers on older Windows: µ, °, ² stand where Unicode has them
    return raw.removeprefix(b"\xef\xbb\xbf")


def _separator(header: str) -> str:
    """The separator that the header uses outside quotes; a comma where it uses none."""
    bare = re.sub(r'"[^"]*"', "", header)
    return next((mark for mark in (";", "\t", ",") if mark in bare), ",")


def csv_cells(source: CsvLines, texts: tuple[int, ...] = ()) -> Cells:
    """The cells of a CSV file as a table. `texts`: columns that stay as they are written (run names).

    Raises BenchInputError where most rows are uneven.
    """
    source, bad_rows = _even_rows(source)
    width = len(source.header)
    body = source.body()
    # A comma that separates nothing is a decimal one: then everything is read as text first, and no thousands
    # separator can pass for a decimal point.
    decimal_comma = source.separator != "," and b"," in body
    if b'"' in body:
        rows = (source.cells(row) for row in range(len(source.numbers)))
        frame = pd.DataFrame(rows, columns=range(width), dtype=str)
    else:
        frame = _parsed(body, source, "all" if decimal_comma else texts)
    return Cells(source, frame, decimal_comma=decimal_comma, separator=source.separator, bad_rows=bad_rows)


def _parsed(body: bytes, source: CsvLines, texts: tuple[int, ...] | Literal["all"]) -> pd.DataFrame:
    """Rows without quotes as a table, a piece at a time: what a parser keeps of its cells is five times their text.

    A column that is numbers in one piece and text in another is read again, as text throughout.
    """
    width = len(source.header)
    pieces: list[pd.DataFrame] = []
    for piece in pd.read_csv(
        io.BytesIO(body),
        header=None,
        names=list(range(width + source.closed)),
        usecols=list(range(width)),
        index_col=False,
        sep=source.separator,
        quoting=csv.QUOTE_NONE,
        skipinitialspace=True,
        na_filter=False,
        low_memory=False,
        dtype=str if texts == "all" else dict.fromkeys(texts, str),
        chunksize=max(1, CELLS_AT_ONCE // width),
    ):
        pieces.append(piece)
        kinds = {place: {each[place].dtype.kind for each in (pieces[0], piece)} for place in range(width)}
        mixed = [place for place, of in kinds.items() if len(of) > 1 and not of <= set("iuf")]
        if mixed:
            return _parsed(body, source, (*(texts if texts != "all" else ()), *mixed))
    return pd.concat(pieces, ignore_index=True)


def _even_rows(source: CsvLines) -> tuple[CsvLines, tuple[BadCell, ...]]:
    """(the rows with as many cells as there are headers, what is wrong with the others); quoted rows are counted cell by cell."""
    width, found = len(source.header), source.separators() + 1
    bad: dict[int, BadCell] = {}
    suspects = np.flatnonzero((found != width) | (source.ends - source.begins == len(source.header_text.encode())))
    for row in suspects.tolist():
        line, number, cells = source.line(row), int(source.numbers[row]), int(found[row])
        if cells != width and '"' in line:
            cells = len(source.cells(row))
        if cells != width:
            what = f"the row has {cells} {'cell' if cells == 1 else 'cells'}, but there are {width} headers"
            bad[row] = _bad_row(source, number, what, "is the line cut off, or the separator wrong?")
        elif line == source.header_text:
            remedy = "are these two logs in one file? Remove the line, and give each log its own run"
            bad[row] = _bad_row(source, number, "the headers stand here again", remedy)
    if not bad:
        return source, ()
    first = next(iter(bad.values()))
    if len(bad) == len(source.numbers):
        raise source.error(f"{first.what}; {first.remedy}", number=first.number)
    kept = np.ones(len(source.numbers), bool)
    kept[list(bad)] = False
    return source.only(kept), tuple(bad.values())


def _bad_row(source: CsvLines, number: int, what: str, remedy: str) -> BadCell:
    return BadCell(source.path, source.word, number, None, what, remedy)
