"""Typed terms in words: place, variable, law and amount, what physics is known to do that, and what would confirm it. No JAX."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from thermohyd.identify.bench.shown_units import display_unit
from thermohyd.identify.model.places import EDGES, place_of
from thermohyd.identify.model.term_variables import IMPLICIT, VARIABLES
from thermohyd.identify.model.typed_terms import GASEOUS, TypedTerm

from .diagnosis_words import p_words, pair_words, percent
from .known_physics import known_physics


if TYPE_CHECKING:
    from thermohyd.identify.diagnosis.result import Term


UNKNOWN = "nothing in a short list of known physics does just that"
ASK = "read the same again, once as it was and once with that quantity at another level"
SYMBOLS = {"a": "p_A", "b": "p_B", "a-b": "(p_A - p_B)", "supply": "p_S", "return": "p_T", "each": "its own pressure",
           "edges": "each edge's mean pressure", **dict.fromkeys(EDGES, "the edge's mean pressure")}  # fmt: skip
LAMINAR = " over the oil's viscosity"  # stated at 40 degC
OF_A_GAS = ", the more the lower the pressure, as a gas gives way"  # stated at gauge zero
SHORT = 0.1  # s, below which a time is said in milliseconds
LAW_WORDS = {
    "proportional": "in proportion to",
    "gaseous": "in proportion to",
    "laminar": "in proportion to",
    "square": "with the square of",
    "cube": "with the cube of",
    "root": "with the square root of",
}


def law_words(term: TypedTerm) -> str:
    """ "in proportion to dp_A/dt"."""
    place, about = place_of(term.place, moving=term.moving), VARIABLES[term.variable]
    # Of a port the drop is that from the supply to its own pressure.
    in_full = term.moving or (term.variable == "pressure_drop" and place.local in ("a", "b", "each"))
    words = about.moving if in_full else about.words
    if term.law == "constant":
        return words
    rate_in_words = term.variable == IMPLICIT and place.local == "each"  # no symbol to write a derivative of
    variable = "the rate of its own pressure" if rate_in_words else words.format(p=SYMBOLS[place.local])
    if term.law == "smooth":
        return f"that varies smoothly with {variable}"
    if term.law == "local":
        return f"that differs from spot to spot along {variable}, alike in all runs"
    more = {"laminar": LAMINAR, GASEOUS: OF_A_GAS}.get(term.law, "")
    return f"{LAW_WORDS[term.law]} {variable}{more}"


def term_name(term: TypedTerm) -> str:
    """Place and law, without an amount."""
    return f"{place_of(term.place).noun} {law_words(term)}"


def amount_words(value: float, std: float | None, unit: str) -> str:
    """ "(2.0 +- 0.1)e-12 m3/Pa": value and standard error to the error's two digits."""
    if not math.isfinite(value):
        return ""
    shown = display_unit(unit) if unit in ("m", "Pa", "m3/s", "m^3/s") else None
    if shown is not None:
        value, std, unit = value * shown.factor, None if std is None else std * shown.factor, shown.label
    elif unit == "s" and abs(value) < SHORT:
        value, std, unit = 1e3 * value, None if std is None else 1e3 * std, "ms"
    unit = "" if unit == "1" else f" {unit}"
    if std is None or not std > 0.0 or not math.isfinite(std):
        return f"{value:.3g}{unit}"
    exponent = math.floor(math.log10(max(abs(value), std)))
    size = 1.0 if -3 <= exponent < 4 else 10.0**exponent
    digits = max(1 - math.floor(math.log10(std / size)), 0)
    figures = f"{value / size:.{digits}f} +- {std / size:.{digits}f}"
    return f"({figures}){'' if size == 1.0 else f'e{exponent}'}{unit}"


def term_sentence(term: TypedTerm, value: float, std: float | None) -> str:
    """Place, law, amount, and what physics does that: no capital, no full stop."""
    place = place_of(term.place)
    known = known_physics(term.place, term.variable, term.law, moving=term.moving)
    size = amount_words(value, std, term.unit)
    how = {
        "smooth": "; its spread is ",
        "local": "; its spread about a straight line is ",
        GASEOUS: ", at gauge zero ",
    }.get(term.law, ", ")
    return f"{place.noun} {law_words(term)}{how}{size}: {UNKNOWN if known is None else known.does}"


def confirmed_by(place: str, variable: str, law: str, *, moving: bool = False) -> str:
    """What would confirm a term on the bench."""
    known = known_physics(place, variable, law, moving=moving)
    return ASK if known is None else known.confirm


def term_lines(terms: "tuple[Term, ...]") -> list[str]:
    """The leading term with what it closes, its rivals and what would confirm it; one line each."""
    if not terms:
        return []
    best = terms[0]
    verb = "Learned at your word: the model now has" if best.learned else "The record behaves as if there were"
    lines = [f"{verb} {best.sentence}. {_closes(best)}"]
    if best.alternatives:
        pairs = ", ".join(map(pair_words, best.alternatives[:4]))
        more = f" and {len(best.alternatives) - 4} more" if len(best.alternatives) > 4 else ""
        lines.append(f"These readings allow as well: {pairs}{more}.")
    lines.append(f"It names a place, not a cause. To confirm it: {best.confirmed_by}.")
    if not best.learned and best.holds:
        lines[-1] += (
            " --learn keeps it in the model; thermohyd effect NAME --from diagnosis.json --out DIR writes it as an effect."
        )
    return lines


@dataclass(frozen=True)
class TermRow:
    """A term as a table shows it."""

    place: str
    goes: str
    amount: str
    closes: str
    p: str
    rivals: str
    status: str


def term_rows(terms: "tuple[Term, ...]") -> list[TermRow]:
    """The terms, the best first."""
    rows = []
    for t in terms:
        amount = amount_words(t.value, t.std, t.unit)
        closes = percent(max(t.gap_closed, 0.0)) if math.isfinite(t.gap_closed) else ""
        rivals = ", ".join(map(pair_words, t.alternatives))
        status = "learned" if t.learned else "" if t.holds else "one linear step" if not t.on_held_out else "not proven"
        rows.append(TermRow(t.place, f"{t.variable} ({t.law})", amount, closes, p_words(t.p_value), rivals, status))
    return rows


def term_headline(term: "Term") -> str:
    """A clause for the first sentence: place and law, and what it closes."""
    verb = "closes" if term.learned else "would close"
    return f"{term.sentence.split(':')[0]} {verb} {percent(term.gap_closed)} of what is left: a place, not a cause"


def _closes(term: "Term") -> str:
    if not math.isfinite(term.gap_closed):
        return ""
    where = "of the remaining gap on rows held out" if term.on_held_out else "of the remaining gap, by one linear step"
    weak = "" if term.holds else "; that does not prove it"
    return f"{'It closes' if term.learned else 'It would close'} {percent(max(term.gap_closed, 0.0))} {where}{weak}."
