"""The bench.toml that a page writes: every click is a change to its text, whose own lines and comments stay as they are.

The text is all there is: what a widget shows is read from it, so that a bench.toml that was dropped, clicked together or typed is the
same thing. TOML Kit edits it.
"""

import functools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from thermohyd.identify.bench.cells import Source
from thermohyd.identify.bench.columns import READINGS
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.headers import (
    is_unit_of,
    likely_columns,
    plain_name,
    sorted_headers,
    split_header,
    units_of,
)
from thermohyd.identify.bench.read import NAME
from thermohyd.identify.bench.record import ValveData
from thermohyd.identify.bench.sensors import read_sensors
from thermohyd.identify.bench.shown_units import KINDS
from thermohyd.identify.bench.test_file import read_source
from thermohyd.identify.bench.test_record import DYNAMIC_TESTS, STATIC_TESTS
from thermohyd.identify.bench.test_tables import StaticTest, read_loop, read_tests
from thermohyd.identify.bench.toml_file import TableSource, TomlSource, TomlTable
from thermohyd.identify.bench.units import WRITTEN
from thermohyd.identify.bench.valve_tables import STAND_IN_STROKE


TABLES = (".csv", ".csv.gz", ".txt", ".tsv", ".dat", ".asc", ".xlsx", ".xlsm", ".parquet", ".mat", ".tdms")
TESTS = (*STATIC_TESTS, *DYNAMIC_TESTS)
LEFT_OUT = "left out"
VISCOSITY = [["40 degC", "32 cSt"], ["100 degC", "5.4 cSt"]]  # to be written over: ISO VG 32, as its name says
Place = tuple[str | int, ...]  # ("valve", "stroke"); ("oil", "viscosity", 0, 1)


@functools.lru_cache(maxsize=8)  # a look at the page asks dozens of times
def parsed(text: str) -> dict[str, Any] | None:
    """The tables of a text, to be read and not changed; None where it is not TOML."""
    try:
        return tomlkit.parse(text).unwrap()
    except TOMLKitError:
        return None


def value_at(text: str, place: Place) -> Any:
    """What stands at a place; None where nothing does."""
    found: Any = parsed(text)
    for key in place:
        try:
            found = found[key]
        except (KeyError, IndexError, TypeError):
            return None
    return found


def with_value(text: str, place: Place, value: Any) -> str:
    """The text with a value at a place; None, an empty text or table takes it away. A text that is not TOML stays as it is."""
    try:
        document = tomlkit.parse(text)
    except TOMLKitError:
        return text
    *path, last = place
    at: Any = document
    empty = value in (None, "", {}, [])
    for depth, key in enumerate(path):
        if isinstance(key, str) and key not in at:
            if empty:
                return text
            at[key] = tomlkit.table(is_super_table=depth == 0 and len(path) > 1)
        at = _inside(at, key)
        if at is None:
            return text
    if empty:
        if isinstance(at, dict):
            at.pop(last, None)
    elif isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update(value)
        at[last] = inline
    else:
        at[last] = value
    return tomlkit.dumps(document)


def _inside(table: Any, key: str | int) -> Any:
    """A table or an array in another; None where something else stands there."""
    found = table[key]
    return found if isinstance(found, dict | list) else None


def held_by(text: str, file: str) -> list[str]:
    """The tests whose rows a file holds."""
    tests = value_at(text, ("tests",))
    return [name for name, test in tests.items() if _file(test) == file] if isinstance(tests, dict) else []


def _file(test: Any) -> str:
    return str(test.get("file", "")).removeprefix("./") if isinstance(test, dict) else ""


def with_test(text: str, file: str, test: str | None) -> str:
    """The text with a file as the rows of a test and of no other; None: of none. What was said of its columns goes along."""
    before = held_by(text, file)
    said = value_at(text, ("tests", before[0])) if before else {}
    for name in before:
        text = with_value(text, ("tests", name), None)
    if test is None:
        return text if value_at(text, ("tests",)) else with_value(text, ("tests",), None)
    kept = {key: value for key, value in said.items() if key in ("columns", "ignore", "skip_rows", "missing")}
    for key, value in ({"file": file} | kept).items():
        text = with_value(text, ("tests", test, key), value)
    return text


def first_draft(name: str) -> str:
    """A bench.toml for files that came without one: sizes, oil and tests are still to be said."""
    return tomlkit.dumps({"valve": {"name": name}, "oil": {}, "conditions": {}})


def with_likely_tests(text: str, record: Path, files: Iterable[str]) -> str:
    """The text in which each file that no test names, and that looks like one that is not there yet, is its file."""
    for file in files:
        test = likely_test(record / file) if is_table(file) and not held_by(text, file) else None
        if test is not None and value_at(text, ("tests", test)) is None:
            text = with_test(text, file, test)
    return text


def is_table(file: str) -> bool:
    """Whether a file's ending is one of those that hold rows."""
    return file.lower().endswith(TABLES)


def likely_test(path: Path) -> str | None:
    """The test that a file seems to hold, by its name, else by its headers; None where neither says."""
    stem = plain_name(path.name)
    for test in TESTS:
        if test in stem:
            return test
    scores = {test: _alike(test, path) for test in STATIC_TESTS}
    best = max(scores, key=lambda test: scores[test])
    return best if scores[best] else None


def _alike(name: str, path: Path) -> int:
    """How well a file's headers suit a static test: 2 for a reading's own name, 1 for a header that may mean one."""
    test = StaticTest(name, path, {}, {}, (), TomlTable(TableSource({}), ("tests", name), {}))
    try:
        source = read_source(test)
        likely = likely_columns(test, source, range(len(source.header)), READINGS[name])
    except BenchInputError:
        return 0
    own = {plain_name(split_header(text)[0]) for text in source.header}
    if name == "load_flow" and "load_pressure" not in own:
        return 0
    if own & set(READINGS[name]):
        return 2 + (name == "load_flow")
    return int(bool(likely))


def described_tests(record: Path) -> dict[str, StaticTest]:
    """What bench.toml says of its tests, whatever it lacks of valve and oil. Raises BenchInputError."""
    root = TomlSource(record / NAME).root
    # Sizes of the valve decide nothing about headers: with stand-ins they can be looked at before anything else is said.
    valve = ValveData("", STAND_IN_STROKE, STAND_IN_STROKE, rated_current=1.0)
    sensors = read_sensors(root.table("sensors"), valve.stroke)
    actuator, sensors = read_loop(root.table("actuator") or TomlTable(root.source, ("actuator",), {}), valve, sensors)
    tests = root.table("tests")
    if tests is None:
        return {}
    static, dynamic = read_tests(tests, actuator, sensors)
    return {**static, **dynamic}


class Headers:
    """The headers of a test's file, each with what it is taken for: a standard column, LEFT_OUT, or "" where nobody knows."""

    def __init__(self, test: StaticTest, source: Source) -> None:
        columns, spare, unknown = sorted_headers(test, source)
        self.test, self.source, self.header = test, source, source.header
        self._units = units_of(source)
        self._columns = columns
        places = {place: name for name, place in columns.items()}
        self.taken_for = [places.get(i, "" if i in unknown else LEFT_OUT) for i in range(len(source.header))]
        self.unknown = [source.header[i] for i in unknown]
        self.spare = [source.header[i] for i in spare]

    @property
    def meanings(self) -> tuple[str, ...]:
        """Every standard column of the test."""
        return ("run", *self.test.kinds)

    def units(self, standard: str) -> tuple[str, ...]:
        """Units that a standard column may have, the usual one first."""
        kinds = self.test.kinds.get(standard, ())
        known = [unit for kind in kinds for unit in (KINDS[kind].label, *WRITTEN.get(kind, ()))]
        return tuple(dict.fromkeys([*known, *(["%"] if standard in self.test.percent_of_stroke else [])]))

    def needs_unit(self, place: int, standard: str) -> bool:
        """Whether a header says no unit of its own that this column may have."""
        kinds = self.test.kinds.get(standard, ())
        written = self._units[place]
        return bool(kinds) and (
            written is None or (not any(is_unit_of(written, kind) for kind in kinds) and written != "%")
        )

    def stated_unit(self, place: int) -> str:
        """The unit that bench.toml states for a header; empty where it states none."""
        said = self.test.columns.get(self.taken_for[place])
        if said is None or said == self.header[place]:
            return ""
        return split_header(said)[1] or ""

    def guesses(self) -> dict[int, str]:
        """{place: the standard column that an unknown header most likely means}, each column once."""
        places = [place for place, taken in enumerate(self.taken_for) if not taken]
        return likely_columns(self.test, self.source, places, [n for n in self.meanings if n not in self.taken_for])

    def with_meaning(self, text: str, place: int, standard: str, unit: str = "") -> str:
        """The text in which a header is taken for a standard column, LEFT_OUT, or for what its own name says (""). unit: of a header
        that has none. The header that was the column before is left out where its name alone makes it one.
        """
        where: Place = ("tests", self.test.name)
        columns = {name: said for name, said in self.test.columns.items() if self._columns.get(name) != place}
        ignore = [name for name in self.test.ignore if not self._means(name, place)]
        header = self.header[place]
        if standard == LEFT_OUT:
            ignore.append(header)
        elif standard:
            columns.pop(standard, None)
            columns |= self._said(header, place, standard, unit)
            for other, name in enumerate(self.header):
                if other != place and plain_name(split_header(name)[0]) == standard:
                    ignore.append(name)
        text = with_value(text, (*where, "columns"), columns)
        return with_value(text, (*where, "ignore"), list(dict.fromkeys(ignore)))

    def _said(self, header: str, place: int, standard: str, unit: str) -> Mapping[str, str]:
        """What `columns` must say; nothing where the header speaks for itself."""
        if self.needs_unit(place, standard) and unit:
            name = split_header(header)[0] if split_header(header)[1] is None else header
            return {standard: f"{name} [{unit}]"}
        return {} if plain_name(split_header(header)[0]) == standard else {standard: header}

    def _means(self, ignored: str, place: int) -> bool:
        header = self.header[place]
        return plain_name(ignored) in (plain_name(header), plain_name(split_header(header)[0]))
