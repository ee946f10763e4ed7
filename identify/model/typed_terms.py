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
from .term_variables import THINNING, THINS, VARIABLES, At, States


POWERS = {"proportional": 1.0, "laminar": 1.0, "square": 2.0, "cube": 3.0, "root": 0.5}
GASEOUS = "gaseous"  # in motion, of what goes with a pressure's rate
CURVES = ("smooth", "local")  # of several coefficients, all in the place's own unit
LAWS = ("constant", *POWERS, *CURVES)
LAWS_IN_MOTION = ("constant", "proportional", GASEOUS, "square", "root", "smooth")
DEGREE = 3  # of the smooth law: a slope, a bend, and one turn
KNOTS = 24  # of the local law, evenly from end to end: a dozen waves over a stroke


@dataclass(frozen=True)
class TypedTerm:
    """place += law(variable), or times 1 + law of a place in shares; SI throughout.

    law: "constant", or coefficients[0] |v|^n sign(v) with n of `POWERS`, a "laminar" one times mu(40 degC)/mu(T) of the oil, or
    "gaseous": proportional, times the compliance of a gas at the chamber's pressure over that at gauge zero, or
    "smooth": coefficients[i] P_i(s) (Legendre), s = clip((v - centre)/reach, -1, 1), or "local": straight lines between coefficients at
    evenly spaced knots. v is held at what was seen, from low to high.
    null_bias [m]: position and opening count from it in static tests. moving: a term of tests in motion, which static ones pass by.
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
    if law == "constant" or law in CURVES or of == "1":
        return own
    if variable == "reading_rate":
        return "s"
    if of == f"{own}/s" and law == "proportional":
        return "s"
    whole = f"({of})" if "/" in of else of
    power = {"square": f"{whole}^2", "cube": f"{whole}^3", "root": f"sqrt({of})"}.get(law, whole)
    if own == of:
        return {"square": f"1/{whole}", "cube": f"1/{whole}^2", "root": f"sqrt({of})"}.get(law, "1")
    if (own, variable) == ("m3/s", "pressure_rate") and law in ("proportional", GASEOUS):
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
    return {"smooth": DEGREE + 1, "local": KNOTS}.get(law, 1)


def basis(law: str, values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(rows, coefficients): what each coefficient of a law multiplies; beyond low and high it is held. A laminar one at 40 degC, a gaseous
    one at gauge zero."""
    values = np.clip(values, low, high)
    if law == "constant":
        return np.ones((len(values), 1))
    if law == "smooth":
        reach = 0.5 * (high - low)
        return legendre.legvander((values - 0.5 * (low + high)) / reach if reach > 0.0 else 0.0 * values, DEGREE)
    if law == "local":
        return lines_between(values, low, high)
    return (np.sign(values) * np.abs(values) ** POWERS.get(law, 1.0))[:, None]


def lines_between(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(rows, KNOTS): the share that each knot from low to high has in a value on a straight line between two of them."""
    knots = np.linspace(low, high, KNOTS)
    return np.stack([np.interp(values, knots, one) for one in np.eye(KNOTS)], axis=1)


def values_of(variable: str, place: Place, test: TestRecord, states: States, null_bias: float) -> np.ndarray:
    """A variable at each row (rows,), SI. Raises ValueError where the test lacks a column."""
    needed = VARIABLES[variable].needs
    if needed and getattr(test, needed) is None:
        raise ValueError(f"the record has no {needed}")
    return VARIABLES[variable].values(At(test, place, states[test.name], null_bias))


FLAT = 1e-3  # of its range, within which a root counts as a line: its slope at 0 has no end


def slope_of_law(term: TypedTerm, values: np.ndarray) -> np.ndarray:
    """d(shift)/d(variable) at each row (rows,), 0 beyond what was seen."""
    seen = (values >= term.low) & (values <= term.high)
    if term.law == "constant":
        return np.zeros(len(values))
    if term.law == "smooth":
        scaled = np.clip((values - term.centre) / term.reach, -1.0, 1.0)
        return seen * legendre.legval(scaled, legendre.legder(np.asarray(term.coefficients))) / term.reach
    if term.law == "local":
        per = np.diff(term.coefficients) * (KNOTS - 1) / (term.high - term.low)
        between = ((values - term.low) / (term.high - term.low) * (KNOTS - 1)).astype(int)
        return seen * per[np.clip(between, 0, KNOTS - 2)]
    power, size = POWERS[term.law], np.maximum(np.abs(values), FLAT * term.reach)
    return seen * term.coefficients[0] * power * size ** (power - 1.0)


def entry_shifts(term: TypedTerm, test: TestRecord, states: States) -> dict[str, np.ndarray]:
    """{entry of `Place.entries`: what the term shifts it by at each row (rows,), SI}.

    A flow into a blocked port that goes with the port's pressure is a line in that pressure through the present state, so that the
    port finds its balance with it: held at what the pressure was, it would overshoot where it moves the pressure more than
    the edges do. Only one that drains the more the higher the pressure, which alone has one balance.
    """
    place = place_of(term.place)
    shifts = [(part, shift_of(term, test, states, part)) for part in place.parts]
    if place.warms:
        shifts = [(part, np.expm1(-thins(test, states) * shift)) for part, shift in shifts]
    found = {entry: sign * shift for part, shift in shifts for entry, sign in part.entries.items()}
    if term.variable not in OF_PORTS or not place.entries.keys() & FLOWS.keys():
        return found
    values = values_of(term.variable, place, test, states, term.null_bias)
    per = slope_of_law(term, values) * (thinning_of(test, states) if term.law == "laminar" else 1.0)
    for entry, port in FLOWS.items():
        if entry in place.entries and port in states[test.name]:
            moves = OF_PORTS[term.variable](place.local, port[-1])
            slope = np.minimum(place.entries[entry] * moves * per, 0.0)
            found[f"{entry}_per_pressure"] = slope
            found[entry] = found[entry] - slope * states[test.name][port]
    return found


def reading_shifts(term: TypedTerm, test: TestRecord, states: States) -> dict[str, np.ndarray]:
    """{what of the simulator's readings: what the term adds to it at each row (rows,), SI}."""
    return {
        reading: sign * shift_of(term, test, states, part)
        for part in place_of(term.place).parts
        for reading, sign in part.readings.items()
    }


# {entry: the state that it may follow}.
FLOWS = {"flow_into_a": "pressure_a", "flow_into_b": "pressure_b"}


def _of_pressure(local: str, port: str) -> float:
    """d(local pressure)/d(a port's): a flow from A to B lowers one by about what it raises the other."""
    if local == "a-b":
        return _of_load("a-b", port)
    return 1.0 if local == port else 0.0


def _of_load(local: str, port: str) -> float:
    sign = 1.0 if port == "a" else -1.0
    return 2.0 * sign if local == "a-b" else sign


def _of_drop(local: str, port: str) -> float:
    return _of_load(local, port) if local == "a-b" else -_of_pressure(local, port)


# {variable of the model's own port pressures: its derivative to one of them, by the place's local pressure}.
OF_PORTS = {"pressure": _of_pressure, "pressure_drop": _of_drop, "load": _of_load}


def shapes_at(law: str, values: np.ndarray, low: float, high: float, thinning: np.ndarray) -> np.ndarray:
    """`basis` at rows whose oil lets `thinning` (rows,) times as much through a gap as at 40 degC."""
    shapes = basis(law, values, low, high)
    return shapes * thinning[:, None] if law == "laminar" else shapes


def thinning_of(test: TestRecord, states: States) -> np.ndarray:
    """mu(40 degC)/mu(T) at a test's rows (rows,), at no pressure."""
    return states[test.name].get(THINNING, np.ones(test.rows))


def thins(test: TestRecord, states: States) -> np.ndarray:
    """-d ln mu/dT [1/K] at a test's rows (rows,), at no pressure."""
    return states[test.name].get(THINS, np.zeros(test.rows))


def shift_of(term: TypedTerm, test: TestRecord, states: States, part: Place | None = None) -> np.ndarray:
    """What the term shifts its place by, or a part of it, at each row of a test (rows,), SI."""
    values = values_of(term.variable, part or place_of(term.place), test, states, term.null_bias)
    return shapes_at(term.law, values, term.low, term.high, thinning_of(test, states)) @ np.asarray(term.coefficients)
