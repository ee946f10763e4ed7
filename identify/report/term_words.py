"""Typed terms in words: place, variable, law and amount, what physics is known to do that, and what would confirm it. No JAX."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from thermohyd.identify.bench.shown_units import display_unit
from thermohyd.identify.model.typed_terms import OF_READING, VARIABLES, TypedTerm, place_of

from .diagnosis_words import p_words, percent


if TYPE_CHECKING:
    from thermohyd.identify.diagnosis.result import Term


@dataclass(frozen=True)
class Known:
    """What physics is known to show as terms of these places and variables, and what would confirm it on the bench."""

    places: tuple[str, ...]  # without their edges
    variables: tuple[str, ...]
    does: str
    confirm: str


_PORTS = ("flow_into_a", "flow_into_b")
_LENGTHS = ("edge_radius", "clearance", "underlap", "edge_flow")
KNOWN = (
    Known(
        _PORTS,
        ("pressure_rate",),
        "what a trapped volume does: hose, gauge or air at a blocked port",
        "sweep at half the rate, which halves it; a shorter hose or a bled gauge takes it away",
    ),
    Known(
        _PORTS,
        ("pressure", "pressure_drop", "constant"),
        "what a leak at that port does: a fitting, a shuttle valve, the gauge's line",
        "close the port at the valve itself",
    ),
    Known(
        (*_PORTS, "flow_from_a_to_b"),
        ("load", "pressure_drop", "pressure"),
        "what a leak between the ports does",
        "blank the ports at the valve, without the manifold",
    ),
    Known(
        ("flow_into_return",),
        ("pressure_drop",),
        "what a first stage, a bushing or a seal lets past the edges",
        "close the pilot supply, or read the leakage with the spool taken out",
    ),
    Known(
        ("flow_into_return", "flow_into_supply"),
        ("position", "opening", "load"),
        "what a flow beside the edges that follows the spool does",
        "read supply and return flow at once: what enters in between is their difference",
    ),
    Known(
        ("position",),
        ("direction",),
        "what play, friction or a magnetic loop does",
        "sweep again at another rate: the width stays",
    ),
    Known(
        ("position",), ("rate",), "what a lag between spool and reading does", "sweep at half the rate, which halves it"
    ),
    Known(
        ("position",),
        ("temperature", "pressure", "pressure_drop", "time"),
        "what a null that wanders does",
        "go back to the first condition: the null comes back, or it does not",
    ),
    Known(
        ("position",),
        ("position", "opening"),
        "what a transducer's calibration does",
        "check the transducer against a dial gauge",
    ),
    Known(
        ("supply_pressure", "return_pressure", "pressure_in_passages"),
        ("flow",),
        "what lines and passages between gauge and edge lose",
        "put the gauge at the valve, or read again at another flow",
    ),
    Known(
        ("viscosity",),
        ("temperature",),
        "what another oil, or a thermometer that is off, does",
        "measure a sample of the oil at two temperatures",
    ),
    Known(
        ("viscosity",),
        ("pressure", "pressure_drop", "flow", "load"),
        "what oil that thickens under pressure, or keeps its throttling heat, does",
        "repeat at another supply pressure",
    ),
    Known(
        ("clearance",),
        ("temperature",),
        "what spool and sleeve that expand unequally do",
        "repeat at a third temperature",
    ),
    Known(
        ("clearance",),
        ("pressure", "pressure_drop"),
        "what a sleeve that widens under pressure does",
        "repeat at another supply pressure",
    ),
    Known(
        _LENGTHS,
        ("constant",),
        "what wear of an edge, or a grinding error, does",
        "read both port pressures, or inspect the edge",
    ),
    Known(
        _LENGTHS,
        ("position", "opening"),
        "what an edge that is no longer straight, or an eccentric spool, does",
        "inspect the lands",
    ),
    Known((OF_READING,), ("constant",), "what an instrument's zero does", "read the instrument with its line shut"),
    Known(
        (OF_READING,),
        ("flow", "pressure", "load"),
        "what an instrument's calibration does",
        "calibrate the instrument, or swap it",
    ),
    Known(
        (OF_READING,),
        ("reading_rate", "rate", "direction"),
        "what an instrument that lags does",
        "sweep at half the rate, which halves it",
    ),
    Known(
        (OF_READING,),
        ("temperature", "time"),
        "what an instrument that drifts does",
        "read the instrument's zero before and after",
    ),
)
UNKNOWN = "nothing in a short list of known physics does just that"
ASK = "read the same again, once as it was and once with that quantity at another level"
SYMBOLS = {"a": "p_A", "b": "p_B", "a-b": "(p_A - p_B)", "supply": "p_S", "return": "p_T"}
LAW_WORDS = {"proportional": "in proportion to", "square": "with the square of", "root": "with the square root of"}


def known_physics(place: str, variable: str) -> Known | None:
    """The first entry of `KNOWN` for a pair of place and variable."""
    family = OF_READING if place.startswith(OF_READING) else place.split(":")[0]
    return next((k for k in KNOWN if family in k.places and variable in k.variables), None)


def law_words(term: TypedTerm) -> str:
    """ "in proportion to dp_A/dt"."""
    place = place_of(term.place)
    variable = VARIABLES[term.variable].words.format(p=SYMBOLS[place.local])
    if term.law == "constant":
        return "at all rows alike"
    if term.law == "smooth":
        return f"that varies smoothly with {variable}"
    return f"{LAW_WORDS[term.law]} {variable}"


def amount_words(value: float, std: float | None, unit: str) -> str:
    """ "(2.0 +- 0.1)e-12 m3/Pa": value and standard error to the error's two digits."""
    if not math.isfinite(value):
        return ""
    shown = display_unit(unit) if unit in ("m", "Pa", "m3/s", "m^3/s") else None
    if shown is not None:
        value, std, unit = value * shown.factor, None if std is None else std * shown.factor, shown.label
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
    known = known_physics(term.place, term.variable)
    size = amount_words(value, std, term.unit)
    how = "; its spread is " if term.law == "smooth" else ", "
    return f"{place.noun} {law_words(term)}{how}{size}: {UNKNOWN if known is None else known.does}"


def confirmed_by(place: str, variable: str) -> str:
    """What would confirm a term on the bench."""
    known = known_physics(place, variable)
    return ASK if known is None else known.confirm


def term_lines(terms: "tuple[Term, ...]") -> list[str]:
    """The leading term with what it closes, its rivals and what would confirm it; one line each."""
    if not terms:
        return []
    best = terms[0]
    verb = "Learned at your word: the model now has" if best.learned else "The record behaves as if there were"
    lines = [f"{verb} {best.sentence}. {_closes(best)}"]
    if best.alternatives:
        pairs = ", ".join(f"{place} with {variable}" for place, variable in best.alternatives[:4])
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
        rivals = ", ".join(f"{place} with {variable}" for place, variable in t.alternatives)
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
