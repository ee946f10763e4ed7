"""The variables of a MATLAB file of version 4 to 7, by the published format (MATLAB, MAT-File Format, levels 4 and 5).

SciPy reads them too, but a damaged file ends its process (a segmentation fault), and it makes room for what a file claims before it looks
whether that is there. Here every size is held against the bytes that are there, and against what is read of a file.
"""

import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .input_file import Allowance, read_input


MATRIX, COMPRESSED = 14, 15  # types of elements
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
CELL, STRUCT, CHAR = 1, 2, 4  # classes of a matrix
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
NOT_READ = {3: "object", 5: "sparse", 16: "function", 17: "object"}
COMPLEX = 0x0800  # a flag of a matrix
OF_VERSION_4 = ("f8", "f4", "i4", "i2", "u2", "u1")
DEEPEST = 8  # structs within structs
BYTES = 8  # of a number in memory
OF_AN_ARRAY = 200  # bytes, whatever it holds: a file may be made of empty ones


def variables(path: Path) -> dict[str, Any]:
    """{name: what it holds}: an array, of texts (n,); a struct as a dict, a word for anything else.

    BenchInputError where they are more than is read; ValueError, IndexError, struct.error or zlib.error in a damaged file.
    """
    raw = read_input(path)
    if len(raw) < 128 or 0 in raw[:4] or raw[126:128] not in (b"IM", b"MI"):
        return dict(_of_version_4(raw, Allowance(path)))
    reader = _Elements("<" if raw[126:128] == b"IM" else ">", Allowance(path))
    found = {}
    for kind, start, stop in reader.elements(raw, 128, len(raw)):
        content = raw
        if kind == COMPRESSED:
            content = zlib.decompressobj().decompress(raw[start:stop], reader.allowance.left + 1)
            reader.allowance.take(len(content))
            kind, start, stop = next(reader.elements(content, 0, len(content)))
        if kind == MATRIX:
            name, value = reader.matrix(content, start, stop, 0)
            found[name] = value
    return {name: value for name, value in found.items() if name and not name.startswith("__")}


class _Elements:
    """Elements are a tag and its bytes; a matrix is elements itself: flags, sizes, name, and what it holds."""

    def __init__(self, order: str, allowance: Allowance) -> None:
        self.order, self.allowance = order, allowance

    def elements(self, raw: bytes, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
        """(type, first byte, end) of each element between two places."""
        while start + 8 <= stop:
            kind, size = np.frombuffer(raw, f"{self.order}u4", 2, start).tolist()
            if kind >> 16:  # a small one: type and size in four bytes, its own in the next four
                if kind >> 16 > 4:
                    raise ValueError("a small element that is large")
                yield kind & 0xFFFF, start + 4, start + 4 + (kind >> 16)
                start += 8
                continue
            if start + 8 + size > stop:
                raise ValueError("an element beyond its end")
            yield kind, start + 8, start + 8 + size
            start += 8 + size + (-size % 8 if kind != COMPRESSED else 0)

    def numbers(self, raw: bytes, element: tuple[int, int, int]) -> np.ndarray:
        kind, start, stop = element
        of = np.dtype(self.order + NUMBERS[kind])
        return np.frombuffer(raw, of, (stop - start) // of.itemsize, start)

    def matrix(self, raw: bytes, start: int, stop: int, depth: int) -> tuple[str, Any]:
        """(name, what it holds)"""
        self.allowance.take(OF_AN_ARRAY)
        if start == stop:
            return "", np.zeros(0)
        if depth > DEEPEST:
            raise ValueError("nested too deeply")
        parts = self.elements(raw, start, stop)
        flags = int(self.numbers(raw, next(parts))[0])
        kind = flags & 0xFF
        second = next(parts)
        if second[0] != 5:  # of an object there are no sizes
            return self._name(raw, second), NOT_READ[kind]
        sizes = self.numbers(raw, second).tolist()
        name = self._name(raw, next(parts))
        count = math.prod(sizes)
        if len(sizes) < 2 or min(sizes) < 0:
            raise ValueError("no sizes of a matrix")
        if kind in NOT_READ:
            return name, NOT_READ[kind]
        self.allowance.take(BYTES * count)
        if kind in CLASSES:
            if flags & COMPLEX:
                return name, "complex"
            found = self.numbers(raw, next(parts)) if count else np.zeros(0)
            return name, found[:count].astype(CLASSES[kind]).reshape(sizes, order="F")
        if kind == CHAR:
            letters = next(parts, (1, 0, 0))
            if count > letters[2] - letters[1]:
                raise ValueError("more letters than bytes")
            return name, texts_of(self._text(raw, letters), sizes)
        if kind == STRUCT:
            longest = int(self.numbers(raw, next(parts))[0])
            _, first, last = next(parts)
            names = [
                raw[i : i + longest].split(b"\0")[0].decode("latin-1") for i in range(first, last, max(1, longest))
            ]
            if count != 1:
                return name, "struct"
            inner = [self._inner(raw, part, depth)[1] for part in parts]
            return name, dict(zip(names, inner, strict=True))
        if kind != CELL:
            raise ValueError("of no class")
        cells = [self._inner(raw, part, depth)[1] for part in parts]
        if len(cells) != count:
            raise ValueError("another number of cells than it says")
        plain = all(isinstance(cell, np.ndarray) and cell.dtype.kind == "U" and cell.size == 1 for cell in cells)
        return name, np.array([str(cell[0]) for cell in cells], dtype=object) if plain else "cell"

    def _inner(self, raw: bytes, part: tuple[int, int, int], depth: int) -> tuple[str, Any]:
        kind, start, stop = part
        if kind != MATRIX:
            raise ValueError("no matrix where one should be")
        return self.matrix(raw, start, stop, depth + 1)

    def _name(self, raw: bytes, element: tuple[int, int, int]) -> str:
        return raw[element[1] : element[2]].decode("latin-1")

    def _text(self, raw: bytes, element: tuple[int, int, int]) -> str:
        kind, start, stop = element
        code = TEXTS[kind]
        if code in ("utf-16", "utf-32"):
            code += "-le" if self.order == "<" else "-be"
        return raw[start:stop].decode(code, errors="replace")


def texts_of(text: str, sizes: list[int]) -> np.ndarray:
    """The rows (n,) of a matrix of letters, which stand column by column; one empty text where there are none."""
    count, rows = math.prod(sizes), sizes[0]
    if not count:
        return np.array([""])
    letters = np.frombuffer(text.ljust(count)[:count].encode("utf-32-le", errors="replace"), "<U1")
    table = np.ascontiguousarray(letters.reshape(rows, -1, order="F"))
    return table.view(f"<U{table.shape[1]}")[:, 0]


def _of_version_4(raw: bytes, allowance: Allowance) -> Iterator[tuple[str, Any]]:
    """Each variable: five numbers (what it is, its sizes, whether it is complex, the length of its name), its name, its numbers."""
    place = 0
    if not raw:
        raise ValueError("empty")
    while place < len(raw):
        order = "<" if 0 <= int(np.frombuffer(raw, "<i4", 1, place)[0]) < 5000 else ">"
        what, rows, columns, imaginary, length = np.frombuffer(raw, f"{order}i4", 5, place).tolist()
        if not 0 <= what < 5000 or min(rows, columns, length) < 0 or imaginary not in (0, 1):
            raise ValueError("no variable")
        of = np.dtype(order + OF_VERSION_4[what // 10 % 10])
        name = raw[place + 20 : place + 20 + length].split(b"\0")[0].decode("latin-1")
        place += 20 + length
        allowance.take(BYTES * rows * columns + OF_AN_ARRAY)
        numbers = np.frombuffer(raw, of, rows * columns, place)
        place += of.itemsize * rows * columns * (1 + imaginary)
        if what % 10 == 1:
            yield name, texts_of("".join(map(chr, numbers.astype(np.uint16).tolist())), [rows, columns])
        else:
            plain = what % 10 == 0 and not imaginary
            yield name, numbers.astype(of.newbyteorder("=")).reshape((rows, columns), order="F") if plain else "sparse"
