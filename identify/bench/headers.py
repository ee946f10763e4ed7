"""Find which column of a file is which standard column, and which it lacks.

Letter case and blanks are forgiven; `columns` and `ignore` of bench.toml are obeyed. An unknown header is answered with the
standard column that it most likely means, ready to be copied into bench.toml.
"""

import difflib
import functools
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

from .cells import MISSING, NUMBER, Source, is_clock_time
from .columns import READINGS, standard_columns
from .errors import LONGEST_QUOTE, BenchInputError, listed, one_line, quoted, suggestion
from .shown_units import KINDS
from .test_record import kind_of_test
from .test_tables import DynamicTestTable, StaticTest
from .units import UnitError, parse_unit


HEADER = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*(?:\([^()]*\))?[^()]*)\))")
LONGEST_NAME = 100  # of a header that a message repeats in full
LONGEST_UNIT = 40  # longer is a sentence
FROM_TOP = 100  # lines among which the headers are looked for
MOST_PROPOSED = 200  # unknown headers that are looked at
MOST_IGNORED = 300  # characters of the headers that a message lists to be left out
# Units that a name may end with, of the words that are nothing else.
NAMED_UNITS = ("um", "mm", "l/min", "ml/min", "lpm", "gpm", "bar", "mbar", "psi", "MPa", "kPa", "degC", "degF", "mA")
# Beginnings of words for what somebody noted beside a row: of no quantity, and no name of a run.
REMARKS = ("remark", "comment", "note", "bemerk", "kommentar", "notiz", "anmerk")
# Words in benches' own headers, only ever used to propose a column in a message.
WORDS = {
    "time": ("zeit", "temps", "clock", "stamp", "t"),
    "run": ("run", "lauf", "sweep", "cycle", "essai"),
    "spool_position": ("spool", "lvdt", "hub", "stroke", "weg", "position", "tiroir", "xv", "x"),
    "current": ("strom", "courant", "i"),
    "supply_pressure": ("supply", "pump", "system", "versorgung", "ps", "pp", "p0"),
    "return_pressure": ("return", "tank", "drain", "rücklauf", "retour", "pr", "pt"),
    "temperature": ("temp", "oil", "öl", "huile"),
    "leakage_flow": ("leak", "leck", "fuite", "ql"),
    "load_pressure": ("load", "last", "differential", "delta", "dp", "charge"),
    "pressure_a": ("pa", "port a", "p a"),
    "pressure_b": ("pb", "port b", "p b"),
    "flow": ("flow", "fluss", "strom", "débit", "q"),
    "command": ("setpoint", "soll", "demand", "reference"),
    "piston_position": ("piston", "kolben", "cylinder", "jack"),
    "frequency": ("freq", "f"),
    "amplitude_ratio": ("gain", "ratio", "magnitude", "amplitude"),
}


def split_header(header: str) -> tuple[str, str | None]:
    """("spool_position", "um") of "spool_position [um]" or "spool_position (um)"; the unit None where there is none."""
    match = HEADER.fullmatch(header)
    if match is None or not match[1]:
        return header, None
    return match[1], (match[3] if match[2] is None else match[2]).strip()


def plain_name(name: str) -> str:
    """A header's name without what people write differently: "Spool Position" is spool_position."""
    return re.sub(r"[\s_-]+", "_", name.strip()).lower()


def recognise(test: StaticTest, source: Source) -> tuple[dict[str, int], list[int]]:
    """({standard column: place}, places of standard columns that belong to other tests). Raises BenchInputError."""
    columns, spare, unknown = sorted_headers(test, source)
    if unknown:
        raise _unknown(test, source, columns, unknown)
    if "spool_position" in columns and "current" in columns:
        spare.append(columns.pop("current"))
    return columns, spare


def sorted_headers(test: StaticTest, source: Source) -> tuple[dict[str, int], list[int], list[int]]:
    """({standard column: place}, places of columns of other tests, places of headers that are no standard column).

    Raises BenchInputError where headers are missing, stand further down, or come twice.
    """
    names = [split_header(header) for header in source.header]
    columns: dict[str, int] = {}
    for standard, header in test.columns.items():
        places = _places(header, source.header, names)
        if not places:
            _refuse_preamble(test, source)
            raise test.table.error(
                f"{standard} is to be {quoted(header)}, but {source.path.name} has no such header; "
                + suggestion(header, source.header),
                "columns",
            )
        if len(places) > 1:
            raise source.error("duplicate header; each column needs a name of its own", column=places[1])
        columns[standard] = places[0]
    taken = set(columns.values())
    used, known = ("run", *test.kinds), standard_columns()
    if not any(plain_name(name) in known for name, _ in names) or any(_is_number(cell) for cell in source.header):
        _refuse_preamble(test, source)
    spare, unknown = [], []
    seen: set[str] = set()
    for i, (name, _) in enumerate(names):
        if not source.header[i]:
            raise source.error(f"column {i + 1} has no header; name it, or start its name with _ to leave it out")
        if source.header[i] in seen:
            raise source.error("duplicate header; each column needs a name of its own", column=i)
        seen.add(source.header[i])
        if i in taken or _left_out(name, source.header[i], test.ignore):
            continue
        plain = plain_name(name)
        if plain in columns:
            first = quoted(source.header[columns[plain]])
            raise source.error(
                f"duplicate header: {first} already gives {plain}; remove one, or list it in ignore", column=i
            )
        if plain in used:
            columns[plain] = i
        elif plain in known:
            spare.append(i)
        else:
            unknown.append(i)
    return columns, spare, unknown


def _places(header: str, headers: list[str], names: list[tuple[str, str | None]]) -> list[int]:
    """Where a user's header stands: written in full, or without the unit on either side; letter case does not matter."""
    name, unit = split_header(header)
    exact = [i for i, found in enumerate(headers) if found == header]
    same = [i for i, found in enumerate(headers) if plain_name(found) in (plain_name(header), plain_name(name))]
    without = [i for i, (n, u) in enumerate(names) if plain_name(n) == plain_name(name) and None in (u, unit)]
    bare = [i for i, (n, _) in enumerate(names) if plain_name(n) == plain_name(header)]
    return exact or same or without or bare


def _left_out(name: str, header: str, ignore: tuple[str, ...]) -> bool:
    ignored = {plain_name(text) for text in ignore}
    predicted = name.endswith(("_predicted", "_predicted_std"))
    return predicted or name.startswith("_") or plain_name(name) in ignored or plain_name(header) in ignored


def _refuse_preamble(test: StaticTest, source: Source) -> None:
    """Raise BenchInputError where the headers stand further down, or nowhere."""
    rows = list(source.top(FROM_TOP))
    for i, (number, cells) in enumerate(rows[:-1]):
        below = rows[i + 1 : i + 3]  # the row below the headers may hold units
        if (
            len(cells) > 1
            and all(cells)
            and not any(map(_is_number, cells))
            and any(_holds_readings(cells, b) for b in below)
        ):
            if i == 0:
                return
            raise source.error(
                f"these are not the headers, which seem to stand in {source.word} {number}: write skip_rows = "
                f"{number - 1} in [tests.{test.name}]"
            )
    if any(_is_number(cell) for cell in source.header):
        raise source.error("the headers are missing; the first line must name the columns, such as spool_position [um]")


def _holds_readings(headers: list[str], row: tuple[int, list[str]]) -> bool:
    cells = row[1]
    return len(cells) == len(headers) and 2 * sum(_is_number(c) or is_clock_time(c) for c in cells) >= len(cells)


def _is_number(cell: str) -> bool:
    return re.fullmatch(NUMBER, cell.replace(",", ".")) is not None


def _unknown(test: StaticTest, source: Source, columns: dict[str, int], unknown: list[int]) -> BenchInputError:
    """An error about the columns that are no standard ones, with the lines of bench.toml that name or leave out every one of them,
    and what the test would lack even then."""
    meant = likely_columns(test, source, unknown, [name for name in ("run", *test.kinds) if name not in columns])
    places = {standard: place for place, standard in meant.items()}
    first = split_header(source.header[unknown[0]])[0]
    known = suggestion(first, ("run", *test.kinds))
    left_out: list[str] = []
    if not meant:
        rest = known if len(unknown) == 1 else f"known: {', '.join(('run', *test.kinds))}"
    else:
        others = [source.header[i] for i in unknown if i not in meant]
        units = units_of(source)
        bare = {name: i for name, i in columns.items() if name in test.kinds and units[i] is None}
        left_out = others if sum(map(len, others)) <= MOST_IGNORED else []
        lines = mapping(test, source, bare | places, left_out)
        if lacks := lacking(test, {*columns, *places}):
            lines += f"; then still missing: {', '.join(lack.words for lack in lacks)}"
        if len(unknown) > 1:
            rest = f"if this is what they are, write {lines}"
        elif known.endswith("?"):
            rest = f"{known} Correct the header, or write {lines}"
        else:
            rest = f"if it is {meant[unknown[0]]}, write {lines}"
    if not left_out:
        rest += " (extra columns: start the name with _ or list it in ignore)"
    if len(unknown) == 1:
        return source.error(f"unknown column {quoted(first)}; {rest}", column=unknown[0])
    return source.error(f"unknown columns {listed([quoted(source.header[i], 30) for i in unknown], 12)}; {rest}")


def units_of(source: Source) -> list[str | None]:
    """What each header gives as its unit, else the row below where that holds units; None where neither does."""
    # Parentheses may hold something else than a unit: "LVDT (left)".
    own = [
        None if unit is not None and header.endswith(")") and not kinds_of(unit) else unit
        for header, unit in ((header, split_header(header)[1]) for header in source.header)
    ]
    below = row_of_units(source)
    return [unit or (below[i] or None) if below else unit for i, unit in enumerate(own)]


def row_of_units(source: Source) -> list[str]:
    """The cells below the headers where they are units, "" for those that say none; empty where they are rather a row of readings."""
    row = [re.sub(r"^[\[(](.*)[\])]$", r"\1", cell).strip() for cell in source.first_row()]
    filled = [cell for cell in row if cell not in ("", "-")]
    if len(row) != len(source.header) or any(_is_number(cell) or is_clock_time(cell) for cell in row):
        return []
    if not filled or 2 * sum(bool(kinds_of(cell)) for cell in filled) < len(filled):
        return []
    return ["" if cell == "-" else cell for cell in row]


def likely_columns(test: StaticTest, source: Source, places: Iterable[int], open_: Iterable[str]) -> dict[int, str]:
    """{place: the standard column among `open_` that this header of the user's most likely means}, each column once.

    By name, unit (of the header or of the row below) and cells: a column whose unit is of another kind is never proposed, nor is
    one that holds texts, but for `run`.
    """
    units, open_ = units_of(source), tuple(open_)
    rows = [cells for number, cells in source.top(FROM_TOP) if number != source.header_line]
    rows = rows[1:] if row_of_units(source) else rows
    scores = []
    for place in list(places)[:MOST_PROPOSED]:
        cells = [row[place] for row in rows if place < len(row) <= len(source.header)]
        allowed = [name for name in open_ if _may_be(test.kinds.get(name), source.header[place], units[place], cells)]
        for standard in allowed:
            score = _likeness(test, source.header[place].lstrip("_"), units[place], standard)
            if score >= 0.5:
                scores.append((-score, place, standard))
    found: dict[int, str] = {}
    for _, place, standard in sorted(scores, key=lambda entry: entry[0]):
        if place not in found and standard not in found.values():
            found[place] = standard
    return dict(sorted(found.items()))


def _may_be(kinds: tuple[str, ...] | None, header: str, unit: str | None, cells: list[str]) -> bool:
    """Whether a user's column may be one of these kinds of quantity; None: the names of runs."""
    plain = plain_name(split_header(header)[0].lstrip("_"))
    words = plain.split("_")
    if len(header) > LONGEST_NAME or any(word.startswith(REMARKS) for word in words):
        return False
    if kinds is None:  # each row has a name, and rows share it
        named = any(word in WORDS["run"] for word in words)
        return unit is None and named and all(cells) and 2 * len(set(cells)) <= len(cells)
    clock = "time" in kinds
    filled = [cell for cell in cells if cell.lower() not in MISSING]
    if 2 * sum(_is_number(cell) or (clock and is_clock_time(cell)) for cell in filled) < len(filled):
        return False
    unit = unit or _unit_in_name(plain)
    # A format of times is no unit: "hh:mm:ss".
    return unit is None or not kinds_of(unit).isdisjoint(kinds) or (clock and not kinds_of(unit))


def _likeness(test: StaticTest, header: str, unit: str | None, standard: str) -> float:
    """How much a user's header is like a standard column; from 0.5 on it is worth a proposal."""
    plain = plain_name(split_header(header)[0])
    unit = unit or _unit_in_name(plain)
    alike = difflib.SequenceMatcher(None, plain[:LONGEST_QUOTE], standard).ratio()
    words = plain.split("_")
    if any(word == w if len(w) < 4 else w in plain for w in WORDS.get(standard, ()) for word in words):
        alike += 0.5
    alike += 0.4 * (unit is not None and not kinds_of(unit).isdisjoint(test.kinds.get(standard, ())))
    return alike - 0.2 * standard.endswith("_std")


def _unit_in_name(plain: str) -> str | None:
    """ "psi" of "supply_pressure_psi": no statement, but a hint."""
    last = plain.rpartition("_")[2]
    return next((unit for unit in NAMED_UNITS if unit.lower() == last), None)


@functools.lru_cache(maxsize=4096)
def kinds_of(unit: str) -> frozenset[str]:
    """The kinds of quantity that a text is a unit of; none of what is no unit."""
    if len(unit) > LONGEST_UNIT:
        return frozenset()
    return frozenset(kind for kind in KINDS if is_unit_of(unit, kind))


def is_unit_of(unit: str, kind: str) -> bool:
    """Whether a text is a unit of this kind of quantity."""
    with suppress(UnitError):
        parse_unit(unit, kind)
        return True
    return False


def mapping(test: StaticTest, source: Source, found: Mapping[str, int], ignore: Sequence[str] = ()) -> str:
    """The lines of bench.toml that name a user's headers and leave others out, those that it already holds included, ready to be
    copied. A header without a unit, in the row below too, gets the usual one. found: {standard column: place}."""
    units = {split_header(header)[0]: unit for header, unit in zip(source.header, units_of(source), strict=True)}
    entries = []
    for standard, header in (test.columns | {name: source.header[place] for name, place in found.items()}).items():
        kinds = test.kinds.get(standard)
        name, unit = split_header(header)
        hint = _unit_in_name(plain_name(name)) if kinds is not None else None
        usual = f" [{hint or KINDS[kinds[0]].label}]" if kinds is not None else ""
        unit = usual if (units.get(name) or unit) is None else ""
        entries.append(f"{standard} = {_toml_text(header, unit)}")
    lines = f"columns = {{ {', '.join(entries)} }}"
    if ignore:
        lines += f" and ignore = [{', '.join(map(_toml_text, dict.fromkeys((*test.ignore, *ignore))))}]"
    return f"{lines} in [tests.{test.name}]"


def _toml_text(text: str, end: str = "") -> str:
    return '"' + one_line(text).replace("\\", "\\\\").replace('"', '\\"') + f'{end}"'


@dataclass(frozen=True)
class Lack:
    """Something that a test lacks: the standard columns that would do, and how a message calls them."""

    names: tuple[str, ...]
    words: str


def lacking(
    test: StaticTest, have: Collection[str], conditions: Collection[str] | None = None, *, readings: bool = True
) -> list[Lack]:
    """What a test needs beside the standard columns that it has, conditions last. conditions: what [conditions] states, by default
    as bench.toml has it. readings: a fit's, too."""
    if conditions is None:
        stated = test.table.source.root.data.get("conditions")
        conditions = stated if isinstance(stated, dict) else ()
    kind = kind_of_test(test.name)
    needs = [*_AXES.get(kind, _POSITION)]
    if kind == "step":
        closed = isinstance(test, DynamicTestTable) and test.closed_loop
        what = "command [mm], a setpoint of the piston" if closed else "command [um] or command [mA]"
        needs.append(Lack(("command",), what))
    if readings:
        single = [name for name in ("pressure_a", "pressure_b") if name in have]
        if kind == "pressure_gain" and "load_pressure" not in have and len(single) == 1:
            other = {"pressure_a": "pressure_b", "pressure_b": "pressure_a"}[single[0]]
            needs.append(Lack((other,), f"{other} [bar] beside {single[0]}"))
        else:
            names = tuple(READINGS[kind])
            usual = f"{names[0]} [{KINDS[test.kinds[names[0]][0]].label}]"
            needs.append(Lack(names, _READINGS_IN_WORDS.get(kind, usual)))
    needs += [Lack((name,), words) for name, words in _CONDITIONS.items() if name not in conditions]
    return [need for need in needs if not any(name in have for name in need.names)]


_POSITION = (Lack(("spool_position", "current"), "spool_position [um] or current [mA]"),)
_AXES = {
    "load_flow": (*_POSITION, Lack(("load_pressure",), "load_pressure [bar], the imposed load pressure")),
    "step": (Lack(("time",), "time [s]"),),
    "frequency": (Lack(("frequency",), "frequency [Hz]"),),
}
_READINGS_IN_WORDS = {
    "pressure_gain": "load_pressure [bar], or pressure_a and pressure_b",
    "step": "piston_position [mm] or pressure_a [bar], a reading",
    "frequency": "amplitude_ratio [1] or phase [deg], a reading",
}
_CONDITIONS = {"supply_pressure": "supply_pressure [bar]", "temperature": "temperature [degC]"}
