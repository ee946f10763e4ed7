"""Learned smooth terms in a `model.json`: written so that a reader sees that they are empirical, and checked. No JAX."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from .diagnosis.variation_terms import ABSOLUTE, LearnedTerm, legendre_basis


QUANTITIES = (
    "discharge_coefficient",
    "transition_number",
    "clearance",
    "edge_radius",
    "viscosity",
    "underlap",
    "null_bias",
)
# Conditions that a term may follow, with the unit of its centre and reach.
VARIABLES = {
    "spool_position": "m",
    "opening": "m",
    "temperature": "K",
    "supply_pressure": "Pa",
    "load_pressure": "Pa",
    "flow_number": "1",
    "direction": "1",
    "time": "s",
    "rate": "m/s",
    "elapsed": "s",
}
_WORDS = ("empirical", "meaning")


def learned_json(term: LearnedTerm) -> dict[str, Any]:
    """One entry of "learned"."""
    acts = f"{term.quantity} + sum [m]" if term.quantity in ABSOLUTE else f"{term.quantity} * (1 + sum)"
    meaning = (
        f"{acts}, sum = c0 P0(s) + c1 P1(s) + ... (Legendre), s = ({term.variable} - centre)/reach [SI], held at -1 and 1 "
        "beyond; a fit to data that no physics stands behind"
    )
    return {"empirical": True, "meaning": meaning, **asdict(term)}


def learned_term(entry: Any, number: int, fail: Callable[[str], Exception], to_number: Callable) -> LearnedTerm:
    """The term of an entry; `fail` makes the exception of a sentence, to_number(value, words) a checked float."""
    where = f'"learned" entry {number}'
    if not isinstance(entry, dict):
        raise fail(f"{where} must be a table")
    known = (*_WORDS, *LearnedTerm.__dataclass_fields__)
    for key in entry:
        if key not in known:
            raise fail(f'{where} has the unknown key "{key}"; known are {", ".join(known)}')
    for key, options in (("quantity", QUANTITIES), ("variable", tuple(VARIABLES))):
        if not isinstance(entry.get(key), str) or entry[key] not in options:
            raise fail(f'{where} "{key}" must be one of {", ".join(options)}')
    coefficients = entry.get("coefficients")
    if not isinstance(coefficients, list) or not 1 <= len(coefficients) <= 20:
        raise fail(f'{where} "coefficients" must be a list of 1 to 20 numbers')
    numbers = {
        key: to_number(entry.get(key, 0.0 if key in ("underlap", "null_bias") else None), f'{where} "{key}"')
        for key in ("centre", "reach", "underlap", "null_bias")
    }
    if numbers["reach"] <= 0.0:
        raise fail(f'{where} "reach" must be positive')
    found = LearnedTerm(
        quantity=entry["quantity"],
        variable=entry["variable"],
        coefficients=tuple(to_number(c, f'{where} "coefficients"') for c in coefficients),
        **numbers,
    )
    if found.quantity not in ABSOLUTE and least_factor(found) <= 0.0:
        raise fail(f"{where} would make {found.quantity} zero or negative within its reach")
    return found


def least_factor(term: LearnedTerm) -> float:
    """The smallest 1 + sum of a term over its reach."""
    s = np.linspace(-1.0, 1.0, 401)
    return float(np.min(1.0 + legendre_basis(s, 0.0, 1.0, len(term.coefficients) - 1) @ np.asarray(term.coefficients)))
