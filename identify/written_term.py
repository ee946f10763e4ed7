"""A typed term as diagnosis.json holds it, read back to be written as an effect; and the stage of the simulator that it becomes. No JAX.

The file is a stranger's. Of it come numbers, and the names of entries of our own tables: no text of it is ever written into code.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.model.model_file import ModelReader
from thermohyd.identify.model.typed_term_file import typed_term
from thermohyd.identify.model.typed_terms import TypedTerm


LARGEST = 50_000_000  # bytes of a diagnosis.json
OF_THE_TERM = ("place", "variable", "law", "coefficients", "range", "moving")
# Between these an amount, its square, and limits of a search around it are all numbers.
LEAST, MOST = 1e-100, 1e100


@dataclass(frozen=True)
class TermRead:
    """A term, its size (of a curve its spread, else the coefficient), and the share of a gap that it closed."""

    term: TypedTerm
    value: float
    gap_closed: float | None


def read_term(path: Path, number: int = 1) -> TermRead:
    """The term `number` of a diagnosis.json, counted from 1. Raises BenchInputError with the file and what would be right."""
    reader = ModelReader(path)
    fail = reader.fail
    try:
        if path.exists() and not path.is_file():
            raise fail("is no file; expected a diagnosis.json written by thermohyd diagnose")
        if path.stat().st_size > LARGEST:
            raise fail(f"is larger than {LARGEST:,} bytes: not a diagnosis.json")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise fail(f"cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError):
        raise fail("is not JSON; expected a diagnosis.json written by thermohyd diagnose") from None
    terms = content.get("terms") if isinstance(content, dict) else None
    if not isinstance(terms, list) or "verdict" not in content:
        raise fail('has no "terms"; expected a diagnosis.json written by thermohyd diagnose')
    if not 1 <= number <= len(terms):
        held = (
            "no term: nothing is left unexplained there"
            if not terms
            else f"{len(terms)} terms, so --term is 1 to {len(terms)}"
        )
        raise fail(f"has {held}")
    entry, where = terms[number - 1], f'"terms" entry {number}'
    own = {key: entry[key] for key in OF_THE_TERM if key in entry} if isinstance(entry, dict) else entry
    term = typed_term(own, number, (), fail, reader.number)
    value = reader.number(entry.get("value"), f'{where} "value"')
    closed = entry.get("gap_closed")
    closed = None if closed is None else reader.number(closed, f'{where} "gap_closed"')
    if value == 0.0 or (len(term.coefficients) == 1 and term.coefficients[0] == 0.0):
        raise fail(f"{where} has no amount to write")
    sizes = [abs(size) for size in (value, term.low, term.high, *term.coefficients) if size != 0.0]
    if not all(LEAST <= size <= MOST for size in sizes):
        raise fail(f"{where} must hold numbers from {LEAST:g} to {MOST:g} in size, or 0")
    if term.low == term.high and term.law != "constant":
        raise fail(f'{where} "range" must rise, from the least to the greatest value of {term.variable}')
    return TermRead(term, value, closed)


@dataclass(frozen=True)
class Stage:
    """Where a class acts: its base, what it imports, the methods as text."""

    base: str
    imports: tuple[str, ...]
    body: str
    needs: tuple[str, ...] = ()
    shows: tuple[str, ...] = ("leakage", "pressure_gain", "flow_gain", "load_flow")
    sign: float = 1.0  # of the amount, beside the term's coefficient
    lower_is_zero: bool = False
    remembers: bool = False  # it goes with which way the spool's command went last


def refused(term: TypedTerm, why: str) -> BenchInputError:
    """The message of a term that no effect can be written of."""
    return BenchInputError(
        f"a term of {term.place} with {term.variable} cannot be written as an effect: {why}; --learn keeps it in model.json"
    )
