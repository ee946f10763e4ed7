"""Read a logger's CSV file: decoded, comments set aside, separator found, every line with its number; then its cells as a table.

Lines are split fast where nothing is quoted. Rows with another number of cells than there are headers
are set aside as bad rows. Line numbers count comments, so that a message names the line that an editor shows.
"""

import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from .cells import BadCell, Cells, Source
from .errors import BenchInputError, quoted


PLAIN = frozenset("0123456789+-")  # what begins with one of these is a row
LARGEST = 400_000_000  # bytes after decompression; keeps a damaged or hostile gzip from filling the memory
LONGEST_HEADER = 100_000  # characters: a thousand columns of long names; more would be searched for minutes


@dataclass(frozen=True)
class CsvLines(Source):
    """The header's cells and the data lines of a file, with their line numbers (from 1, comments included)."""

    separator: str
    header_text: str
    lines: list[str]

    def top(self, most: int) -> Iterator[tuple[int, list[str]]]:
        """Each line split by the separator that it uses itself: lines above the headers often use another."""
        rows = zip((self.header_line, *self.numbers[:most]), (self.header_text, *self.lines[:most]), strict=True)
        for number, line in rows:
            yield number, [cell.strip(" \t\"'") for cell in line.split(_separator(line))]

    def first_row(self) -> list[str]:
        """The cells below the headers."""
        return [cell.strip() for cell in split_cells(self.lines[0], self.separator, self.path, self.numbers[0])]

    def after_first_row(self) -> "CsvLines":
        if len(self.lines) < 2:
            raise BenchInputError("has headers but no rows", file=self.path, line=self.header_line)
        return replace(self, lines=self.lines[1:], numbers=self.numbers[1:])

    def only(self, wanted: Callable[[int], bool]) -> "CsvLines":
        """The same with some of its rows, told by their places from 0."""
        rows = [row for row in range(len(self.lines)) if wanted(row)]
        return replace(self, lines=[self.lines[i] for i in rows], numbers=[self.numbers[i] for i in rows])


def read_csv_lines(path: Path, skip_rows: int = 0) -> CsvLines:
    """Read a CSV file as headers and lines. `skip_rows`: lines above the headers.

    Raises BenchInputError where the file cannot be read or is empty.
    """
    text = decode(read_bytes(path), path)
    every = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if skip_rows and skip_rows >= len(every):
        raise BenchInputError(f"has {len(every)} lines, but skip_rows leaves out {skip_rows}", file=path)
    numbered = [
        (number, line)
        for number, line in enumerate(every[skip_rows:], start=skip_rows + 1)
        if line[:1] in PLAIN or (line.strip(" \t,;\"'") and not line.lstrip(" \t\"'").startswith("#"))
    ]
    if numbered and re.fullmatch(r'"?sep=.?"?', numbered[0][1].strip()):  # Excel's own first line
        numbered = numbered[1:]
    if not numbered:
        raise BenchInputError("is empty; expected a line of headers and at least one row", file=path)
    header_line, first = numbered[0]
    if len(first) > LONGEST_HEADER:
        words = f"the line of headers has {len(first):,} characters; expected one name and unit per column, such as spool_position [um]"
        raise BenchInputError(words, file=path, line=header_line)
    separator = _separator(first)
    header = [cell.strip() for cell in split_cells(first, separator, path, header_line)]
    lines = [line for _, line in numbered[1:]]
    numbers = [number for number, _ in numbered[1:]]
    if not lines:
        raise BenchInputError("has headers but no rows", file=path, line=header_line)
    header, lines = _without_last_separator(header, lines, separator)
    return CsvLines(path, header, header_line, numbers, separator, first, lines)


def _without_last_separator(header: list[str], lines: list[str], separator: str) -> tuple[list[str], list[str]]:
    """Many loggers end every row with a separator, and some the headers too: no column stands behind it."""
    wide = lines[0].count(separator) + 1
    if len(header) > 1 and not header[-1]:
        if all(line.endswith(separator) for line in lines):
            return header[:-1], [line[:-1] for line in lines]
        if wide == len(header) - 1:
            return header[:-1], lines
    elif wide == len(header) + 1 and all(line.endswith(separator) for line in lines):
        return header, [line[:-1] for line in lines]
    return header, lines


def split_cells(line: str, separator: str, path: Path, number: int) -> list[str]:
    """The cells of one line, quotes taken off."""
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    except (csv.Error, StopIteration):
        raise BenchInputError(f"a quote is not closed in {quoted(line)}", file=path, line=number) from None


def read_bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            if not packed:
                raw = file.read(LARGEST + 1)
            else:
                with gzip.open(file) as unpacked:
                    raw = unpacked.read(LARGEST + 1)
    except FileNotFoundError:
        raise BenchInputError("no such file", file=path) from None
    except (gzip.BadGzipFile, EOFError, zlib.error):
        raise BenchInputError("is a damaged gzip file; compress it again", file=path) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BenchInputError(f"cannot be read ({reason})", file=path) from None
    if len(raw) > LARGEST:
        raise BenchInputError(f"is larger than {LARGEST:,} bytes; thin the log before fitting", file=path)
    return raw


def decode(raw: bytes, path: Path) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError:
            raise BenchInputError("is not text; expected a CSV file", file=path) from None
    if raw.startswith(b"PK\x03\x04"):
        raise BenchInputError("is no CSV file but an .xlsx or zip file; give it its own ending", file=path)
    if b"\0" in raw:
        line = raw[: raw.index(b"\0")].count(b"\n") + 1
        raise BenchInputError("is not text; expected a CSV file", file=path, line=line)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # loggers on older Windows: µ, °, ² stand where Unicode has them


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
    body = "\n".join(source.lines)
    # A comma that separates nothing is a decimal one: then everything is read as text first, and no thousands
    # separator can pass for a decimal point.
    decimal_comma = source.separator != "," and "," in body
    if '"' in body:
        rows = [
            split_cells(line, source.separator, source.path, number)
            for line, number in zip(source.lines, source.numbers, strict=True)
        ]
        frame = pd.DataFrame(rows, columns=range(width), dtype=str)
    else:
        frame = pd.read_csv(
            io.StringIO(body),
            header=None,
            names=list(range(width)),
            index_col=False,
            sep=source.separator,
            quoting=csv.QUOTE_NONE,
            skipinitialspace=True,
            na_filter=False,
            low_memory=False,
            dtype=str if decimal_comma else dict.fromkeys(texts, str),
        )
    return Cells(source, frame, decimal_comma=decimal_comma, separator=source.separator, bad_rows=bad_rows)


def _even_rows(source: CsvLines) -> tuple[CsvLines, tuple[BadCell, ...]]:
    """(the rows with as many cells as there are headers, what is wrong with the others); quoted rows are counted cell by cell."""
    width, separator = len(source.header), source.separator
    if source.header_text not in source.lines and {line.count(separator) for line in source.lines} == {width - 1}:
        return source, ()
    bad: dict[int, BadCell] = {}
    for row, (line, number) in enumerate(zip(source.lines, source.numbers, strict=True)):
        found = line.count(separator) + 1
        if found != width and '"' in line:
            found = len(split_cells(line, separator, source.path, number))
        if found != width:
            what = f"the row has {found} {'cell' if found == 1 else 'cells'}, but there are {width} headers"
            bad[row] = _bad_row(source, number, what, "is the line cut off, or the separator wrong?")
        elif line == source.header_text:
            remedy = "are these two logs in one file? Remove the line, and give each log its own run"
            bad[row] = _bad_row(source, number, "the headers stand here again", remedy)
    if not bad:
        return source, ()
    first = next(iter(bad.values()))
    if len(bad) == len(source.lines):
        raise source.error(f"{first.what}; {first.remedy}", number=first.number)
    return source.only(lambda row: row not in bad), tuple(bad.values())


def _bad_row(source: CsvLines, number: int, what: str, remedy: str) -> BadCell:
    return BadCell(source.path, source.word, number, None, what, remedy)
