"""A typed term as diagnosis.json holds it, read back to be written as an effect; and the stage of the simulator that it becomes. No JAX."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.model.term_variables import VARIABLES, laws_in_motion
from thermohyd.identify.model.typed_term_file import place_named
from thermohyd.identify.model.typed_terms import LAWS, coefficients_of


@dataclass(frozen=True)
class TermRead:
    """A term as `diagnosis.json` holds it."""

    place: str
    variable: str
    law: str
    unit: str
    value: float
    coefficients: tuple[float, ...]
    low: float
    high: float
    sentence: str
    confirmed_by: str
    gap_closed: float | None
    moving: bool = False  # of tests in motion


def read_term(path: Path, number: int = 1) -> TermRead:
    """The term `number` of a diagnosis.json, counted from 1. Raises BenchInputError with the file and what would be right."""
    fail = lambda sentence: BenchInputError(sentence, file=path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise fail(f"cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, ValueError):
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
    moving = isinstance(entry, dict) and entry.get("moving") is True
    place_named(entry.get("place") if isinstance(entry, dict) else None, where, fail, moving=moving)
    about = VARIABLES.get(str(entry.get("variable")))
    if about is None or entry.get("law") not in (laws_in_motion(about) if moving else LAWS):
        raise fail(f'{where} has a "variable" or a "law" that is none')
    try:
        low, high = (float(end) for end in entry["range"])
        found = TermRead(
            entry["place"], entry["variable"], entry["law"], str(entry["unit"]), float(entry["value"]),
            tuple(float(c) for c in entry["coefficients"]), low, high, str(entry["sentence"]),
            str(entry.get("confirmed_by", "")), entry.get("gap_closed"), moving,
        )  # fmt: skip
    except (KeyError, TypeError, ValueError):
        raise fail(f'{where} must have "value", "unit", "coefficients", "range" and "sentence"') from None
    numbers = (found.value, found.low, found.high, *found.coefficients)
    if (
        len(found.coefficients) != coefficients_of(found.law)
        or not all(map(math.isfinite, numbers))
        or found.value == 0.0
    ):
        raise fail(f"{where} has no amount to write")
    return found


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


def refused(term: TermRead, why: str) -> BenchInputError:
    """The message of a term that no effect can be written of."""
    return BenchInputError(
        f"a term of {term.place} with {term.variable} cannot be written as an effect: {why}; --learn keeps it in model.json"
    )
