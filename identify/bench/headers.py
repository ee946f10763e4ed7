"""Find which column of a file is which standard column.

Letter case and blanks are forgiven; `columns` and `ignore` of bench.toml are obeyed. An unknown header is answered with the
standard column that it most likely means, ready to be copied into bench.toml.
"""

import difflib
import re
from collections.abc import Iterable
from contextlib import suppress

from .cells import NUMBER, Source, is_clock_time
from .columns import standard_columns
from .errors import LONGEST_QUOTE, LONGEST_TEXT, BenchInputError, listed, one_line, quoted, suggestion
from .shown_units import KINDS
from .test_tables import StaticTest
from .units import UnitError, parse_unit


LONGEST_NAME = 100  # of a header that a message repeats in full
FROM_TOP = 100  # lines among which the headers are looked for
# Words in benches' own headers, only ever used to propose a column in a message.
WORDS = {
    "time": ("zeit", "temps", "clock", "stamp", "t"),
    "run": ("lauf", "sweep", "cycle", "essai"),
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
    last = len(header) - 1
    if header.endswith("]"):
        begin = header.rfind("[")
        sound = begin > header.rfind("]", 0, last)
    elif header.endswith(")"):  # a unit may have a pair of its own: "(bar (g))"
        begin, depth = last, 1
        while depth and begin > 0:
            begin -= 1
            depth += {")": 1, "(": -1}.get(header[begin], 0)
        sound = not depth and header.count("(", begin + 1) <= 1
    else:
        return header, None
    name = header[: max(begin, 0)].rstrip()
    return (name, header[begin + 1 : last].strip()) if sound and name else (header, None)


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
    for i, header in enumerate(source.header):
        if len(header) > LONGEST_TEXT:
            _refuse_preamble(test, source)
            raise source.error(
                f"the header has {len(header):,} characters, more than {LONGEST_TEXT}; expected a name and a unit, such as "
                "spool_position [um]",
                column=i,
            )
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
    return len(cell) <= LONGEST_TEXT and re.fullmatch(NUMBER, cell.replace(",", ".")) is not None


def _unknown(test: StaticTest, source: Source, columns: dict[str, int], unknown: list[int]) -> BenchInputError:
    """An error about the columns that are no standard ones, with the line of bench.toml that would name them."""
    open_ = [name for name in ("run", *test.kinds) if name not in columns]
    found: dict[str, str] = {}
    for i in unknown:
        guess = likely_column(test, source.header[i], [name for name in open_ if name not in found])
        if guess is not None:
            found[guess] = source.header[i]
    extra = "(extra columns: start the name with _ or list it in ignore)"
    if len(unknown) == 1:
        (i,) = unknown
        name = split_header(source.header[i])[0]
        known = suggestion(name, ("run", *test.kinds))
        way = f" Correct the header, or write {mapping(test, found)}" if found else ""
        if found and not known.endswith("?"):
            return source.error(
                f"unknown column {quoted(name)}; if it is {next(iter(found))}, write {mapping(test, found)} {extra}",
                column=i,
            )
        return source.error(f"unknown column {quoted(name)}; {known}{way} {extra}", column=i)
    names = listed([quoted(source.header[i], 30) for i in unknown], 6)
    if found:
        return source.error(f"unknown columns {names}; if this is what they are, write {mapping(test, found)} {extra}")
    return source.error(f"unknown columns {names}; known: {', '.join(('run', *test.kinds))} {extra}")


def likely_column(test: StaticTest, header: str, open_: Iterable[str]) -> str | None:
    """The standard column among `open_` that a user's header most likely means; None where none is likely."""
    if len(header) > LONGEST_NAME:
        return None
    name, unit = split_header(header)
    plain = plain_name(name)
    best, score = None, 0.0
    for standard in open_:
        kinds = test.kinds.get(standard, ())
        fits = unit is not None and any(is_unit_of(unit, kind) for kind in kinds)
        if unit is not None and kinds and not fits:
            continue
        words = plain.split("_")
        alike = difflib.SequenceMatcher(None, plain[:LONGEST_QUOTE], standard).ratio()
        if any(word == w if len(w) < 4 else w in plain for w in WORDS.get(standard, ()) for word in words):
            alike += 0.5
        alike += 0.3 * fits - 0.2 * standard.endswith("_std")
        if alike > score:
            best, score = standard, alike
    return best if score >= 0.5 else None


def likely_header(test: StaticTest, standard: str, headers: Iterable[str]) -> str | None:
    """The user's header that most likely is a standard column; None where none is."""
    return next((h for h in headers if likely_column(test, h.lstrip("_"), (standard,)) == standard), None)


def is_unit_of(unit: str, kind: str) -> bool:
    """Whether a text is a unit of this kind of quantity."""
    with suppress(UnitError):
        parse_unit(unit, kind)
        return True
    return False


def mapping(test: StaticTest, found: dict[str, str]) -> str:
    """The line of bench.toml that names a user's headers, the ones that it already names included, ready to be copied."""
    entries = []
    for standard, header in (test.columns | found).items():
        kinds = test.kinds.get(standard)
        unit = "" if kinds is None or split_header(header)[1] is not None else f" [{KINDS[kinds[0]].label}]"
        text = one_line(header).replace("\\", "\\\\").replace('"', '\\"')
        entries.append(f'{standard} = "{text}{unit}"')
    return f"columns = {{ {', '.join(entries)} }} in [tests.{test.name}]"
