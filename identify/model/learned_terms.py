"""Learned smooth terms of a model: Legendre polynomials of a condition that change one quantity, and their form in `model.json`.

They are empirical, and written so that a reader sees that. NumPy only, no JAX.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.oil_definition import OilDefinition


# Quantities to which a term is added, in m; every other one is multiplied by 1 + the term.
ABSOLUTE = frozenset({"underlap", "null_bias"})


@dataclass(frozen=True)
class LearnedTerm:
    """A smooth variation of a model quantity, fitted to data: empirical, not a cause, and constant beyond what was seen.

    quantity: a parameter's name or "viscosity"; multiplied by 1 + sum, or in `ABSOLUTE` plus sum [m], where sum is that of
    coefficients[i] P_i(s), s = clip((variable - centre)/reach, -1, 1). underlap, null_bias: fixed numbers [m] that
    `opening` and `flow_number` are counted with.
    """

    quantity: str
    variable: str
    centre: float
    reach: float
    coefficients: tuple[float, ...]
    underlap: float = 0.0
    null_bias: float = 0.0


def term_values(term: LearnedTerm, test: TestRecord, oil: OilDefinition) -> np.ndarray:
    """The sum of a term at each row (rows,)."""
    reference = {"underlap": term.underlap, "null_bias": term.null_bias, "oil": oil}
    values = variable_values(term.variable, test, reference)
    basis = legendre_basis(values, term.centre, term.reach, len(term.coefficients) - 1)
    return basis @ np.asarray(term.coefficients)


def legendre_basis(values: np.ndarray, centre: float, reach: float, degree: int) -> np.ndarray:
    """P_0 .. P_degree (rows, degree + 1) of s = clip((v - centre)/reach, -1, 1): constant beyond what was seen."""
    return legendre.legvander(np.clip((values - centre) / reach, -1.0, 1.0), degree)


def variable_values(name: str, test: TestRecord, reference: Mapping[str, Any]) -> np.ndarray:
    """A condition of each row (rows,), SI. reference: the fitted `underlap` and `null_bias`, and the `oil`'s definition.

    opening: |x - x0|. flow_number: 2 (|x - x0| + U) / nu(T) sqrt((P_s - P_t)/rho), the scale of the edges' flow number,
    of conditions only. elapsed: time since the start of the run. Raises ValueError where a column is missing.
    """
    opening = np.abs(test.spool_position - float(reference["null_bias"]))
    if name == "opening":
        return opening
    if name == "flow_number":
        oil = reference["oil"]
        drop = np.maximum(test.supply_pressure - test.return_pressure, 0.0)
        gap = opening + max(float(reference["underlap"]), 0.0)
        return 2.0 * gap / kinematic_viscosity(oil, test.temperature) * np.sqrt(drop / oil.density)
    if name == "elapsed":
        if test.time is None:
            raise ValueError("the record has no time")
        first = {run: float(np.min(test.time[test.run == run])) for run in np.unique(test.run)}
        return test.time - np.array([first[run] for run in test.run])
    column = getattr(test, name)
    if column is None:
        raise ValueError(f"the record has no {name}")
    return np.asarray(column, dtype=float)


def kinematic_viscosity(oil: OilDefinition, temperature: np.ndarray) -> np.ndarray:
    """ASTM D341 (docs/physics.md section 2), m2/s."""
    return 1e-6 * (10.0 ** (10.0 ** (oil.viscosity_a - oil.viscosity_b * np.log10(temperature))) - 0.7)


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
