"""The factors that can vary in a study, their tolerances and steps. No JAX."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from thermohyd.identify.bench.errors import suggestion
from thermohyd.identify.fitting.parameters import absent_parameters
from thermohyd.identify.model.model import Model


MICRON = 1e-6


ABSOLUTE = ("null_bias", "temperature", "return_pressure", "heat_retention")


@dataclass(frozen=True)
class Factor:
    """A quantity that a study varies: a parameter, a condition or a size (SI).

    value: where it stands; tolerance: half the width of the interval in which it may lie; lower, upper: what it can be at
    all. kind: of its quantity, for files. In words `meaning`.
    """

    name: str
    unit: str
    kind: str
    value: float
    tolerance: float
    lower: float
    upper: float
    meaning: str

    @property
    def low(self) -> float:
        """The lower end of the tolerance interval, cut where the factor cannot go."""
        return max(self.lower, self.value - self.tolerance)

    @property
    def high(self) -> float:
        """The upper end of the tolerance interval, cut where the factor cannot go."""
        return min(self.upper, self.value + self.tolerance)

    @property
    def relative(self) -> bool:
        """Whether a sensitivity is per relative change, d ln y/d ln theta; else it is per tolerance (a value of about 0
        has no relative change)."""
        return self.name not in ABSOLUTE and abs(self.value) > self.tolerance

    @property
    def step(self) -> float:
        """What a derivative is multiplied by to become a normalised sensitivity: the value, or the tolerance."""
        return abs(self.value) if self.relative else self.tolerance


@dataclass(frozen=True)
class _Kind:
    unit: str
    kind: str
    tolerance: float
    of_value: bool  # whether the default tolerance is a share of the value
    lower: float
    upper: float
    meaning: str


_LARGE = float("inf")


# Default tolerances: what drawings, data sheets and a bench leave open; each can be replaced by the user's own.
_KINDS = {
    "edge_radius": _Kind("m", "length", 3 * MICRON, False, 0.0, _LARGE, "radius of the rounded edges"),
    "clearance": _Kind("m", "length", 0.25, True, 0.05 * MICRON, _LARGE, "radial clearance"),
    "underlap": _Kind("m", "length", 3 * MICRON, False, -_LARGE, _LARGE, "opening between the arc centres at null"),
    "discharge_coefficient": _Kind("dimensionless", "plain number", 0.05, True, 0.01, _LARGE, "C_qmax of the edges"),
    "transition_number": _Kind(
        "dimensionless", "plain number", 0.20, True, 1.0, _LARGE, "lambda_c, laminar to turbulent"
    ),
    "null_bias": _Kind("m", "length", 2 * MICRON, False, -_LARGE, _LARGE, "spool position at hydraulic null"),
    "slot_width": _Kind("m", "length", 0.01, True, 1e-6, _LARGE, "width of all slots of an edge together"),
    "stroke": _Kind("m", "length", 0.02, True, 1e-6, _LARGE, "full stroke; positions are shares of it"),
    "viscosity": _Kind("dimensionless", "plain number", 0.10, True, 0.05, _LARGE, "of the oil, in units of its table"),
    "density": _Kind("dimensionless", "plain number", 0.01, True, 0.05, _LARGE, "of the oil, in units of its table"),
    "temperature": _Kind("K", "temperature", 5.0, False, 180.0, 500.0, "of the oil supplied"),
    "supply_pressure": _Kind("Pa", "pressure", 0.02, True, 1e4, _LARGE, "gauge"),
    "return_pressure": _Kind("Pa", "pressure", 1e5, False, 0.0, _LARGE, "gauge"),
    "heat_retention": _Kind("dimensionless", "plain number", 1.0, False, 0.0, 1.0, "eta: 0 isothermal, 1 adiabatic"),
}


FACTORS = tuple(_KINDS)


def factors_of(
    model: Model,
    temperature: float,
    supply_pressure: float,
    return_pressure: float = 0.0,
    tolerances: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Factor, ...]:
    """Every factor about a model at one operating condition (K, Pa gauge), in the order of `FACTORS`.

    tolerances: the user's own half widths (SI), others by default: edge radius and underlap 3 um, clearance 25 %,
    discharge coefficient 5 %, transition number 20 %, null bias 2 um, slot width 1 %, stroke 2 %, viscosity 10 %
    (ISO 3448 allows as much), density 1 %, temperature 5 K, supply pressure 2 %, return pressure 1 bar, heat retention 1
    (nothing known). Raises ValueError where a name is unknown.
    """
    for name in tolerances:
        if name not in _KINDS:
            raise ValueError(f'no factor "{name}"; {suggestion(name, FACTORS)}')
    values = {
        "heat_retention": 0.0,
        **{name: value for name, value in model.parameters.items() if name in _KINDS},
        "slot_width": model.valve.slot_width,
        "stroke": model.valve.stroke,
        "viscosity": 1.0,
        "density": 1.0,
        "temperature": temperature,
        "supply_pressure": supply_pressure,
        "return_pressure": return_pressure,
    }
    found = []
    absent = absent_parameters(model.valve)
    for name, info in _KINDS.items():
        if name in absent:
            continue
        value = values[name]
        own = info.tolerance * abs(value) if info.of_value else info.tolerance
        found.append(
            Factor(
                name,
                info.unit,
                info.kind,
                value,
                tolerances.get(name, own),
                min(info.lower, value),
                max(info.upper, value),
                info.meaning,
            )
        )
    return tuple(found)


def default_kind(name: str) -> str:
    """The kind of a factor's quantity, as files name it."""
    return _KINDS[name].kind
