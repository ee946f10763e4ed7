"""A typed term in files: "terms" of `model.json`, and one of `diagnosis.json` read back. No JAX."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .places import PLACES, Place, place_of
from .term_variables import IMPLICIT, VARIABLES, asked_with, laws_in_motion
from .typed_terms import GASEOUS, LAWS, LAWS_IN_MOTION, TypedTerm, coefficients_of


KEYS = (
    "empirical", "meaning", "place", "variable", "law", "unit", "coefficients", "range", "null_bias", "covariance",
    "with_parameters", "moving",
)  # fmt: skip


def typed_json(term: TypedTerm) -> dict[str, Any]:
    """One entry of "terms"."""
    acts = "times 1 + law" if place_of(term.place).unit == "1" else "plus law"
    of = {
        "constant": "c0",
        "smooth": "c0 P0(s) + c1 P1(s) + ... (Legendre), s from -1 to 1 over the range",
        "local": "straight lines between c0, c1, ... at evenly spaced knots over the range",
        "proportional": "c0 v",
        "laminar": "c0 v mu(40 degC)/mu(T), mu the oil's viscosity",
        GASEOUS: "c0 v (p_a/P)^(1 + 1/1.4), P the chamber's absolute pressure",
        "square": "c0 v |v|",
        "cube": "c0 v^3",
        "root": "c0 sign(v) sqrt|v|",
    }[term.law]
    return {
        "empirical": True,
        "meaning": f"{term.place} {acts}({term.variable}), law = {of}, v held at the ends of the range; a place, not a cause",
        "place": term.place,
        "variable": term.variable,
        "law": term.law,
        "unit": term.unit,
        "coefficients": list(term.coefficients),
        "range": [term.low, term.high],
        "null_bias": term.null_bias,
        "covariance": [list(row) for row in term.covariance],
        "with_parameters": {name: list(values) for name, values in term.with_parameters.items()},
        **({"moving": True} if term.moving else {}),
    }


def typed_term(
    entry: Any, number: int, free: tuple[str, ...], fail: Callable[[str], Exception], to_number: Callable[..., float]
) -> TypedTerm:
    """The term of an entry of `model.json`; `fail` makes the exception of a sentence, to_number(value, words) a checked float.

    free: what the model's covariance is of.
    """
    where = f'"terms" entry {number}'
    if not isinstance(entry, dict):
        raise fail(f"{where} must be a table")
    for key in entry:
        if key not in KEYS:
            raise fail(f'{where} has the unknown key "{key}"; known are {", ".join(KEYS)}')
    moving = entry.get("moving", False)
    if not isinstance(moving, bool):
        raise fail(f'{where} "moving" must be true or false: whether it is a term of tests in motion')
    place = place_named(entry.get("place"), where, fail, moving=moving)
    for key, options in (("variable", tuple(VARIABLES)), ("law", (*LAWS, GASEOUS))):
        if not isinstance(entry.get(key), str) or entry[key] not in options:
            raise fail(f'{where} "{key}" must be one of {", ".join(options)}')
    if not asked_with(place, VARIABLES[entry["variable"]], moving=moving):
        raise fail(f"{where}: a term of {place.name} does not go with {entry['variable']}")
    if moving and entry["law"] not in LAWS_IN_MOTION:
        raise fail(f"{where}: the law {entry['law']} is one of static tests")
    if entry["law"] == GASEOUS and not (moving and entry["variable"] == IMPLICIT):
        raise fail(f"{where}: the law {GASEOUS} is one of {IMPLICIT} in motion")
    if moving and entry["law"] not in (laws := laws_in_motion(VARIABLES[entry["variable"]])):
        raise fail(f"{where}: {entry['variable']} goes by the law {' or '.join(laws)}")
    if entry["law"] == "local" and entry["variable"] not in place.followed:
        raise fail(f"{where}: the law local is none of {place.name} with {entry['variable']}")
    coefficients, ends = entry.get("coefficients"), entry.get("range")
    count = coefficients_of(entry["law"])
    if not isinstance(coefficients, list) or len(coefficients) != count:
        raise fail(f'{where} "coefficients" must be a list of {count} for the law {entry["law"]}')
    if not isinstance(ends, list) or len(ends) != 2:
        raise fail(f'{where} "range" must be the least and the greatest value of {entry["variable"]}')
    low, high = (to_number(end, f'{where} "range"') for end in ends)
    if low > high:
        raise fail(f'{where} "range" must not fall')
    own, cross = entry.get("covariance", []), entry.get("with_parameters", {})
    try:
        matrix = np.asarray(own, dtype=float).reshape(count, count) if own else np.zeros((0, 0))
        known = {name: tuple(float(v) for v in values) for name, values in cross.items()}
    except (TypeError, ValueError, AttributeError):
        raise fail(
            f'{where} "covariance" must be {count} rows of {count} numbers, "with_parameters" {count} of each'
        ) from None
    finite = all(np.isfinite(values).all() and len(values) == count for values in known.values())
    if not np.isfinite(matrix).all() or not finite or (matrix.size and np.any(np.diag(matrix) < 0.0)):
        raise fail(f'{where} "covariance" must be finite, with a diagonal that is not negative')
    for name in known:
        if name not in free:
            raise fail(f'{where} "with_parameters" has "{name}", which "covariance" "of" does not list')
    return TypedTerm(
        place.name, entry["variable"], entry["law"], tuple(to_number(c, f'{where} "coefficients"') for c in coefficients),
        low, high, to_number(entry.get("null_bias", 0.0), f'{where} "null_bias"'), moving,
        tuple(tuple(float(v) for v in row) for row in matrix), known,
    )  # fmt: skip


def place_named(name: Any, where: str, fail: Callable[[str], Exception], *, moving: bool = False) -> Place:
    """The place of a name in a file; moving: of a term of tests in motion."""
    try:
        if isinstance(name, str):
            return place_of(name, moving=moving)
        raise KeyError(name)
    except KeyError:
        raise fail(f'{where} "place" must be one of {", ".join(PLACES)}, or reading:<channel>') from None
