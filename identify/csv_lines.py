"""A logger's CSV file as lines: decoded, comments set aside, separator found, line numbers kept."""

import csv
import gzip
import re
import zlib
from dataclasses import dataclass
from pathlib import Path

from .errors import BenchInputError, quoted


LARGEST = 400_000_000  # bytes after decompression; keeps a damaged or hostile gzip from filling the memory


@dataclass(frozen=True)
class CsvLines:
    """The header's cells and the data lines of a file, with their line numbers (from 1, comments included)."""

    path: Path
    separator: str
    header: list[str]
    header_line: int
    lines: list[str]
    numbers: list[int]


def read_csv_lines(path: Path) -> CsvLines:
    """Raises BenchInputError where the file cannot be read, is empty, or has rows of the wrong length."""
    text = _decode(_bytes(path), path)
    numbered = [
        (number, line)
        for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1)
        if line.strip(" \t,;\"'") and not line.lstrip(" \t\"'").startswith("#")
    ]
    if numbered and re.fullmatch(r'"?sep=.?"?', numbered[0][1].strip()):  # Excel's own first line
        numbered = numbered[1:]
    if not numbered:
        raise BenchInputError("is empty; expected a line of headers and at least one row", file=path)
    header_line, first = numbered[0]
    separator = _separator(first)
    header = [cell.strip() for cell in split_cells(first, separator, path, header_line)]
    if any(_is_number(cell) for cell in header):
        raise BenchInputError(
            "the headers are missing; the first line must name the columns, such as spool_position [um]",
            file=path,
            line=header_line,
        )
    lines = [line for _, line in numbered[1:]]
    numbers = [number for number, _ in numbered[1:]]
    if not lines:
        raise BenchInputError("has headers but no rows", file=path, line=header_line)
    return CsvLines(path, separator, header, header_line, lines, numbers)


def split_cells(line: str, separator: str, path: Path, number: int) -> list[str]:
    """The cells of one line, quotes taken off."""
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    except (csv.Error, StopIteration):
        raise BenchInputError(f"a quote is not closed in {quoted(line)}", file=path, line=number) from None


def _bytes(path: Path) -> bytes:
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


def _decode(raw: bytes, path: Path) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return raw.decode("utf-16")
        except UnicodeDecodeError:
            raise BenchInputError("is not text; expected a CSV file", file=path) from None
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


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
