"""How much the pages of a .parquet file unpack to, by their own headers: its footer may claim less, and pyarrow makes room as they say.

A file of 641 bytes may claim twenty million rows of one text, and a page of a few thousand bytes unpacks to two gigabytes. Footer and
headers are structs of Thrift's compact protocol (Apache Parquet, parquet.thrift), of which a few numbers are looked at; asked for them,
pyarrow ends the process where a footer is damaged.
"""

import os
from io import BufferedIOBase
from pathlib import Path
from typing import Any

from .input_file import Allowance


LONGEST_HEADER = 1 << 16  # bytes; with statistics of long texts
BYTES = 8  # of a value, at least
DEEPEST = 8  # structs within structs
# Types of Thrift's compact protocol.
TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = range(1, 13)  # of maps Parquet has none
# Fields by their numbers: of a footer, of a group of rows, of a column of it, of what is said of that column; of a page.
ROWS, GROUPS, COLUMNS, ABOUT, VALUES, LENGTH, DATA, WORDS = 3, 4, 1, 3, 5, 7, 9, 11
UNPACKED, PACKED, DICTIONARY, KINDS = 2, 3, 7, (5, 7, 8)  # KINDS: the own headers of pages, which say how many values


def refuse_large_pages(path: Path, file: BufferedIOBase) -> None:
    """Raise BenchInputError where the file holds more than is read; ValueError, LookupError or TypeError in a damaged one."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - 8))
    length = int.from_bytes(file.read(4), "little")
    file.seek(size - 8 - length)
    footer = _Struct(file.read(length)).fields(0)
    allowance = Allowance(path)
    columns = [column for group in footer[GROUPS] for column in group[COLUMNS]]
    widest = max((len(group[COLUMNS]) for group in footer[GROUPS]), default=1)
    allowance.take(footer[ROWS] * max(1, widest) * BYTES, "has rows for")
    for column in columns:
        about = column[ABOUT]
        first = min(about[DATA], about.get(WORDS) or about[DATA])
        _refuse_pages(allowance, file, first, first + about[LENGTH], about[VALUES])


def _refuse_pages(allowance: Allowance, file: BufferedIOBase, place: int, end: int, values: int) -> None:
    while place < end and values > 0:
        file.seek(place)
        header = _Struct(file.read(min(LONGEST_HEADER, end - place)))
        page = header.fields(0)
        if page[UNPACKED] < 0 or page[PACKED] < 0:
            raise ValueError("a size below zero")
        allowance.take(page[UNPACKED])
        if DICTIONARY not in page:
            values -= max((page[kind].get(1, 0) for kind in KINDS if kind in page), default=0)
        place += header.place + page[PACKED]


class _Struct:
    """A struct as bytes; `place` is behind what was read of them. IndexError or ValueError where it is none."""

    def __init__(self, raw: bytes) -> None:
        self.raw, self.place = raw, 0

    def fields(self, depth: int) -> dict[int, Any]:
        """{number of a field: its value}; None for texts and floats"""
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
            return self.fields(depth + 1)
        if kind in (LIST, SET):
            if depth > DEEPEST:
                raise ValueError("nested too deeply")
            head = self._byte()
            count = self._unsigned() if head >> 4 == 15 else head >> 4
            if count > len(self.raw):
                raise ValueError("more entries than bytes")
            if head & 15 in (TRUE, FALSE):
                return [self._byte() == TRUE for _ in range(count)]
            return [self._value(head & 15, depth + 1) for _ in range(count)]
        passed = {BYTE: lambda: 1, DOUBLE: lambda: 8, BINARY: self._unsigned}[kind]()
        self.place += passed
        return None
