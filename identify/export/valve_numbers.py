"""A model as the numbers that the C sources know: each with unit, description and value; what stays on the bench; what is refused.

No JAX: a model.json becomes C without it.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, effect_info
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.model.model import Model


if TYPE_CHECKING:
    from thermohyd.effects.effect_info import EffectInfo


OIL = {
    "viscosity_a": ("1", "Walther's A: log10 log10(nu/cSt + 0.7) = A - B log10(T/K)"),
    "viscosity_b": ("1", "Walther's B"),
    "density": ("kg/m3", "Density of the oil at 15 degC, without pressure"),
    "expansion": ("1/K", "Thermal expansion at 15 degC"),
    "bulk_modulus": ("Pa", "Bulk modulus at 15 degC, without pressure"),
    "tait_slope": ("1", "Growth of the bulk modulus with the pressure"),
    "bulk_modulus_decay": ("1/K", "Relative fall of the bulk modulus with temperature"),
    "specific_heat": ("J/(kg.K)", "Specific heat at 15 degC"),
    "specific_heat_slope": ("J/(kg.K2)", "Growth of the specific heat with temperature"),
}
PARAMETERS = {
    "slot_width": ("m", "Width of an edge, all its slots together"),
    "edge_radius": ("m", "Radius of the metering edges"),
    "clearance": ("m", "Radial clearance of the spool"),
    "underlap": ("m", "Opening of every edge with the spool at null"),
    "discharge_coefficient": ("1", "Discharge coefficient of turbulent flow"),
    "transition_number": ("1", "Where laminar flow through an open edge becomes turbulent"),
    "null_bias": ("m", "Position of the hydraulic null"),
    "heat_retention": ("1", "Share of the throttling heat that stays in the oil: 0 isothermal, 1 adiabatic"),
    "null_pressure": ("Pa", "Supply pressure at which the null bias holds"),
}
SOURCES, VALVE, PLAY, COMMAND, BENCH = "sources", "valve", "play", "command", "bench"  # `EffectInfo.elsewhere`
NOT_TOGETHER = (
    "; the C sources solve heat and such a path each by itself: take one of them out of model.json, or export tables"
)


@dataclass(frozen=True)
class Number:
    """One parameter of the C sources. unit: as FMI writes it."""

    name: str
    value: float
    unit: str
    description: str


@dataclass(frozen=True)
class ValveNumbers:
    """numbers: in the order of the C struct. left_out: effects of the model that stay on the bench. driven_by_current: the input
    is a current [A] instead of a position."""

    numbers: tuple[Number, ...]
    left_out: tuple[str, ...]
    driven_by_current: bool

    def value(self, name: str) -> float:
        return next(number.value for number in self.numbers if number.name == name)


def valve_numbers(model: Model, *, current: bool = False) -> ValveNumbers:
    """The numbers of a model. current: the spool is commanded by a current, as the bench's rated current has it.

    Raises BenchInputError, in one sentence, where the model holds what the C sources cannot express.
    """
    acting = expressible(model, {name: info for name, info in EFFECTS.items() if info.elsewhere})
    valve = model.valve
    heat = model.parameters.get("heat_retention", 0.0)
    inside = [name for name in acting if EFFECTS[name].elsewhere in (SOURCES, VALVE)]
    heat += sum(acting[name] for name in inside if EFFECTS[name].adds_to == "heat_retention")
    tied = [name for name in inside if heat != 0.0 and EFFECTS[name].coupled]
    if tied:
        raise BenchInputError(f"the oil keeps heat, and {tied[0]} ties the ports together{NOT_TOGETHER}")
    if current and valve.rated_current is None:
        raise BenchInputError(
            "the valve has no rated_current; write it into the valve of model.json, or export it by position"
        )
    given = {**model.parameters, "slot_width": valve.slot_width, "null_pressure": valve.null_pressure or 0.0}
    numbers = [Number(name, float(given.get(name, 0.0)), unit, words) for name, (unit, words) in PARAMETERS.items()]
    numbers += oil_numbers(model)
    numbers += [
        effect_number(name, acting.get(name, 0.0))
        for name, info in EFFECTS.items()
        if info.elsewhere in (SOURCES, VALVE)
    ]
    numbers.append(edge_law_number(model))
    scale = 1.0
    if current and valve.rated_current is not None:
        scale = valve.stroke * valve.polarity / valve.rated_current
    numbers.append(
        Number("position_per_input", scale, "m/A" if current else "1", "Spool position per unit of the input")
    )
    return ValveNumbers(all_finite(numbers), left_on_the_bench(acting), current)


def expressible(model: Model, known: dict[str, "EffectInfo"]) -> dict[str, float]:
    """{effect of the model: amount} without those of amount 0, all among `known`, whose physics has C sources or stays on the bench.

    Raises BenchInputError for another effect, a learned term, and a null that moves from where nobody says.
    """
    acting = {name: amount for name, amount in model.effects.items() if amount != 0.0}
    unknown = [name for name in acting if name not in known]
    if unknown and unknown[0] in DYNAMIC_EFFECTS:
        raise BenchInputError(
            f"the model holds the effect {unknown[0]}, which only motion shows; export the servo, or take it out of model.json"
        )
    if unknown:
        raise BenchInputError(
            f"the model holds the effect {unknown[0]}, for which there are no C sources; take it out of model.json, or export tables"
        )
    if model.learned:
        raise BenchInputError(
            "the model holds a learned term, which is empirical and has no C sources; take it out of model.json, or export tables"
        )
    moves_null = [name for name in acting if model.valve.null_pressure is None and "null" in known[name].stages]
    if moves_null:
        raise BenchInputError(
            f"{moves_null[0]} needs null_pressure, the supply pressure at which the null bias holds; write it into the valve of model.json"
        )
    return acting


def oil_numbers(model: Model) -> list[Number]:
    """Of the oil, as the sources name them."""
    numbers = [Number(name, float(getattr(model.oil, name)), unit, words) for name, (unit, words) in OIL.items()]
    own = float(model.oil.pressure_viscosity)
    return [*numbers, Number("oil_pressure_viscosity", own, "1/Pa", "Growth of the viscosity with the pressure")]


def edge_law_number(model: Model) -> Number:
    law = 1.0 if model.valve.edge_law == "lubrication" else 0.0
    return Number("edge_law", law, "1", "0: orifice in series with its land; 1: film of lubrication theory")


def all_finite(numbers: list[Number]) -> tuple[Number, ...]:
    """The numbers; raises BenchInputError for one that is none."""
    for number in numbers:
        if not math.isfinite(number.value):
            raise BenchInputError(f"{number.name} of the model is no finite number; correct it in model.json")
    return tuple(numbers)


def left_on_the_bench(effects: Iterable[str]) -> tuple[str, ...]:
    """Of these effects those of instruments and of the bench's lines: the valve elsewhere has none of them."""
    return tuple(name for name in effects if name in EFFECTS and EFFECTS[name].elsewhere == BENCH)


def effect_number(name: str, amount: float) -> Number:
    info: EffectInfo = effect_info(name)
    return Number(name, float(amount), info.unit, f"Effect: {info.sentence}")
