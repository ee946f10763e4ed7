"""Parse a TOML file and keep the line of each key, which the standard parser does not: messages name it.

The same tables may come from a caller's arguments: then there is no line, and a bare number is one in SI.
"""

import math
import re
import tomllib
from pathlib import Path
from typing import Any

from .errors import BenchInputError, one_line, quoted, suggestion
from .input_file import read_input
from .shown_units import KINDS
from .units import UnitError, expected, parse_quantity


LARGEST = 1_000_000  # bytes; a bench.toml is a page
LONGEST_LINE = 10_000  # characters; a key of a hundred thousand parts, a.a.a..., would be taken apart for minutes
HEADER = re.compile(r"\s*\[\[?([^\]]*)\]")
KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")


class TableSource:
    """Nested tables that describe a record (`root`), wherever they come from, and how messages call their places."""

    path: Path | None = None  # None: no file
    si_numbers = False  # whether a number without a unit is one in SI, or a mistake
    words = "the arguments"  # what says it, in a sentence

    def __init__(self, root: dict[str, Any]) -> None:
        self._root = root

    @property
    def root(self) -> "TomlTable":
        return TomlTable(self, (), self._root)

    @property
    def folder(self) -> Path | None:
        """Where the files that it names lie."""
        return None if self.path is None else self.path.parent

    def line_of(self, path: tuple[str, ...]) -> int | None:
        """Line of a key, or of the nearest table around it that has a line of its own."""
        return None


class TomlSource(TableSource):
    """The parsed file and where its keys stand. Raises BenchInputError where it is not TOML."""

    words = "bench.toml"

    def __init__(self, path: Path) -> None:
        self.path = path
        raw = read_input(path, LARGEST, "a bench.toml is a page")
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = raw[: error.start].count(b"\n") + 1
            raise BenchInputError("is not UTF-8 text; save the file as UTF-8", file=path, line=line) from None
        self._lines = text.replace("\r\n", "\n").split("\n")
        for number, line in enumerate(self._lines, start=1):
            if len(line) > LONGEST_LINE:
                words = f"the line has {len(line):,} characters, more than {LONGEST_LINE:,}; write it as several"
                raise BenchInputError(words, file=path, line=number)
        try:
            super().__init__(tomllib.loads("\n".join(self._lines)))
        except RecursionError:
            raise BenchInputError("is nested too deeply to be a bench.toml", file=path) from None
        except tomllib.TOMLDecodeError as error:
            where = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
            what = re.sub(r"\s*\(at .*\)$", "", str(error), flags=re.DOTALL)
            line = int(where[1]) if where else len(self._lines)
            raise BenchInputError(
                f"is not valid TOML: {what[:1].lower()}{what[1:]}; texts and quantities are written in quotes",
                file=path,
                line=line,
            ) from None
        except ValueError:  # Python's limit on the digits of an integer
            raise BenchInputError("holds a number of thousands of digits", file=path) from None

    def line_of(self, path: tuple[str, ...]) -> int | None:
        best, best_depth = None, 0
        table: tuple[str, ...] = ()
        for number, line in enumerate(self._lines, start=1):
            if header := HEADER.match(line):
                table = found = _split(header[1])
            elif key := KEY.match(line):
                found = table + _split(key[1])
            else:
                continue
            if len(found) > best_depth and path[: len(found)] == found:
                best, best_depth = number, len(found)
            elif best is None and found[: len(path)] == path:  # [tests.step] also opens [tests]
                best = number
        return best


def _finite(table: "TomlTable", key: str, value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise table.error(f"{quoted(value)} is not finite", key)
    return number


def _split(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


class TomlTable:
    """One table of the file: its values checked as they are taken, with messages that say where they stand."""

    def __init__(self, source: TableSource, path: tuple[str, ...], data: dict[str, Any]) -> None:
        self.source = source
        self.path = path
        self.data = data

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def error(self, message: str, key: str | None = None) -> BenchInputError:
        path = self.path if key is None else (*self.path, key)
        if len(path) > 1 and (key is None or len(path) > 2):
            name = f"[{'.'.join(path[:-1])}] {path[-1]}" if key is not None else f"[{'.'.join(path)}]"
        else:
            name = f"[{path[0]}] {path[1]}" if len(path) > 1 else f"[{path[0]}]" if path else None
        return BenchInputError(message, file=self.source.path, line=self.source.line_of(path), key=name)

    def table_error(self, key: str, message: str) -> BenchInputError:
        """An error about a table inside this one, which may be missing."""
        return TomlTable(self.source, (*self.path, key), {}).error(message)

    def refuse_unknown(self, known: tuple[str, ...], what: str = "key") -> None:
        for key in self.data:
            if key not in known:
                raise self.error(f"unknown {what} {quoted(key)}; {suggestion(key, known)}", key)

    def table(self, key: str) -> "TomlTable | None":
        """A table inside this one, or None where it is missing."""
        if key not in self.data:
            return None
        value = self.data[key]
        if not isinstance(value, dict):
            name = ".".join((*self.path, key))
            raise self.error(f"must be a table: [{name}] on a line of its own, then its keys", key)
        return TomlTable(self.source, (*self.path, key), value)

    def quantity(self, key: str, kind: str, *, full_scale: float | None = None, sign: str = "") -> float | None:
        """A quantity in SI, None where the key is missing. `sign`: "" any, "positive", or "not negative"."""
        if key not in self.data:
            return None
        return self.as_quantity(key, self.data[key], kind, full_scale=full_scale, sign=sign)

    def as_quantity(
        self, key: str, value: object, kind: str, *, full_scale: float | None = None, sign: str = ""
    ) -> float:
        """A value found under a key (itself, or inside an array) as a quantity in SI."""
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            if self.source.si_numbers:
                return self._signed(key, value, _finite(self, key, value), sign)
            if kind != "plain number":
                example = f"1.5 {KINDS[kind].label}"
                raise self.error(f'{quoted(value)} has no unit; write it in quotes, such as "{example}"', key)
            value = str(quoted(value))[1:-1]
        if not isinstance(value, str):
            raise self.error(f"{quoted(value)} is not a quantity; expected {expected(kind)}", key)
        try:
            number = parse_quantity(value, kind, full_scale)
        except UnitError as error:
            raise self.error(str(error), key) from None
        return self._signed(key, value, number, sign)

    def _signed(self, key: str, value: object, number: float, sign: str) -> float:
        if (sign == "positive" and not number > 0.0) or (sign == "not negative" and number < 0.0):
            raise self.error(f"{quoted(value)} must be {sign if sign == 'positive' else 'zero or more'}", key)
        return number

    def text(self, key: str) -> str | None:
        """A text that is not empty, None where the key is missing."""
        value = self.data.get(key)
        if value is None:
            return None
        if not isinstance(value, str) or not value.strip():
            raise self.error(f"{quoted(value)} is not a text; write it in quotes", key)
        return one_line(value.strip())

    def flag(self, key: str, default: bool = False) -> bool:
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            raise self.error(f"{quoted(value)} is neither true nor false (without quotes)", key)
        return value
