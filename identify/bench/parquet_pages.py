"""How much the pages of a .parquet file unpack to, by their own headers: its footer may claim less, and pyarrow makes room as they say.

A file of 641 bytes may claim twenty million rows of one text, and a page of a few thousand bytes unpacks to two gigabytes. Headers are
structs of Thrift's compact protocol (Apache Parquet, parquet.thrift, PageHeader), of which three numbers are read.
"""

from io import BufferedIOBase
from pathlib import Path
from typing import Any

from .input_file import Allowance


LONGEST_HEADER = 1 << 16  # bytes; with statistics of long texts
BYTES = 8  # of a value, at least
DEEPEST = 8  # structs within structs
# Types of Thrift's compact protocol.
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)
UNPACKED, PACKED, KINDS = (
    2,
    3,
    (5, 7, 8),
)  # fields of a PageHeader: sizes; headers of data, dictionary and newer data pages


def refuse_large_pages(path: Path, file: BufferedIOBase, about: Any) -> None:
    """Raise BenchInputError where the file holds more than is read, ValueError where its pages cannot be followed."""
    allowance = Allowance(path)
    allowance.take(about.num_rows * max(1, about.num_columns) * BYTES, "has rows for")
    for group in range(about.num_row_groups):
        for column in range(about.num_columns):
            chunk = about.row_group(group).column(column)
            first = [chunk.data_page_offset, chunk.dictionary_page_offset or chunk.data_page_offset]
            _refuse_chunk(allowance, file, min(first), chunk.total_compressed_size, chunk.num_values)


def _refuse_chunk(allowance: Allowance, file: BufferedIOBase, place: int, length: int, values: int) -> None:
    end = place + length
    while place < end and values > 0:
        file.seek(place)
        header = _Header(file.read(min(LONGEST_HEADER, end - place)))
        fields = header.struct(0)
        unpacked, packed = fields[UNPACKED], fields[PACKED]
        if unpacked < 0 or packed < 0:
            raise ValueError("a size below zero")
        allowance.take(unpacked)
        held = max((fields[kind].get(1, 0) for kind in KINDS if kind in fields), default=0)
        if 7 not in fields:
            values -= held
        place += header.place + packed


class _Header:
    """A struct as bytes; `place` is behind what was read of them. IndexError or ValueError where it is none."""

    def __init__(self, raw: bytes) -> None:
        self.raw, self.place = raw, 0

    def struct(self, depth: int) -> dict[int, Any]:
        if depth > DEEPEST:
            raise ValueError("nested too deeply")
        found: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._signed()
            found[number] = self._value(head & 15, depth)
        return found

    def _byte(self) -> int:
        self.place += 1
        return self.raw[self.place - 1]

    def _unsigned(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value
            if shift > 63:
                raise ValueError("no number")

    def _signed(self) -> int:
        value = self._unsigned()
        return (value >> 1) ^ -(value & 1)

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (TRUE, FALSE):
            return kind == TRUE
        if kind in (I16, I32, I64):
            return self._signed()
        if kind == STRUCT:
            return self.struct(depth + 1)
        # BYTE, DOUBLE and BINARY are passed over; a page's header has no lists, sets and maps.
        passed = {BYTE: lambda: 1, DOUBLE: lambda: 8, BINARY: self._unsigned}[kind]()
        self.place += passed
        return None
