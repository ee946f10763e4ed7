"""Typed terms of a model: a place of the circuit, shifted by a law of a variable. No JAX.

A term says where something is missing and with which quantity it goes, in the place's own unit: "a flow into port A in proportion
to dp_A/dt, m3/Pa". It acts inside the model, like an effect, but names no cause. Places (`places`) and variables (`term_variables`)
are two tables.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import legendre

from thermohyd.identify.bench.test_record import TestRecord

from .places import Place, place_of
from .term_variables import VARIABLES, At, States


POWERS = {"proportional": 1.0, "square": 2.0, "root": 0.5}
LAWS = ("constant", *POWERS, "smooth")
DEGREE = 3


@dataclass(frozen=True)
class TypedTerm:
    """place += law(variable), or times 1 + law of a place in shares; SI throughout.

    law: "constant", or coefficients[0] |v|^n sign(v) with n of `POWERS`, or "smooth": coefficients[i] P_i(s) (Legendre),
    s = clip((v - centre)/reach, -1, 1). v is held at what was seen, from low to high. null_bias [m]: position and opening count from it
    in static tests. moving: a term of tests in motion, which static ones pass by.
    """

    place: str
    variable: str
    law: str
    coefficients: tuple[float, ...]
    low: float
    high: float
    null_bias: float = 0.0
    moving: bool = False  # of tests in motion
    # Of the coefficients (k, k), and of each with parameters and amounts by name: what a prediction's error bar needs.
    covariance: tuple[tuple[float, ...], ...] = ()
    with_parameters: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def centre(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def reach(self) -> float:
        return 0.5 * (self.high - self.low)

    @property
    def unit(self) -> str:
        """Of the first coefficient."""
        return unit_of(self.place, self.variable, self.law)


def unit_of(place: str, variable: str, law: str) -> str:
    """SI, of a law's coefficient: what the place is shifted by per unit of the variable."""
    own, of = place_of(place).unit, VARIABLES[variable].unit
    if law in ("constant", "smooth") or of == "1":
        return own
    if variable == "flow" and own == "m3/s":
        own, of = "1", "1"
    if variable == "reading_rate":
        return "s"
    if own == of and law == "proportional":
        return "1"
    if of == f"{own}/s" and law == "proportional":
        return "s"
    whole = f"({of})" if "/" in of else of
    power = {"proportional": whole, "square": f"{whole}^2", "root": f"sqrt({of})"}[law]
    if (own, variable, law) == ("m3/s", "pressure_rate", "proportional"):
        return "m3/Pa"
    return f"m3/(s {power})" if own == "m3/s" and law != "root" else f"{own}/{power}"


def with_covariance(term: TypedTerm, free: tuple[str, ...], matrix: np.ndarray) -> TypedTerm:
    """The term with the joint covariance of `free` and its coefficients, which stand last."""
    count = len(term.coefficients)
    own = tuple(tuple(float(v) for v in row) for row in matrix[-count:, -count:])
    cross = {name: tuple(float(v) for v in matrix[i, -count:]) for i, name in enumerate(free)}
    return replace(term, covariance=own, with_parameters=cross)


def coefficients_of(law: str) -> int:
    """How many coefficients a law has."""
    return DEGREE + 1 if law == "smooth" else 1


def basis(law: str, values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(rows, coefficients): what each coefficient of a law multiplies; beyond low and high it is held."""
    values = np.clip(values, low, high)
    if law == "constant":
        return np.ones((len(values), 1))
    if law == "smooth":
        reach = 0.5 * (high - low)
        return legendre.legvander((values - 0.5 * (low + high)) / reach if reach > 0.0 else 0.0 * values, DEGREE)
    return (np.sign(values) * np.abs(values) ** POWERS[law])[:, None]


def values_of(variable: str, place: Place, test: TestRecord, states: States, null_bias: float) -> np.ndarray:
    """A variable at each row (rows,), SI. Raises ValueError where the test lacks a column."""
    needed = VARIABLES[variable].needs
    if needed and getattr(test, needed) is None:
        raise ValueError(f"the record has no {needed}")
    return VARIABLES[variable].values(At(test, place, states[test.name], null_bias))


def shift_of(term: TypedTerm, test: TestRecord, states: States) -> np.ndarray:
    """What the term shifts its place by at each row of a test (rows,), SI."""
    values = values_of(term.variable, place_of(term.place), test, states, term.null_bias)
    return basis(term.law, values, term.low, term.high) @ np.asarray(term.coefficients)
