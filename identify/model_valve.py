"""The simulator's valve for a `Model` and the rows of a test: parameters, effects, and learned terms row by row."""

from dataclasses import asdict, replace

import numpy as np
from jaxtyping import Array, Float

from thermohyd.effects.flowmeter import FLOW_CHANNELS
from thermohyd.effects.registry import effect_info, with_effects
from thermohyd.oil_definition import OilDefinition, kinematic_viscosity_of
from thermohyd.valve import Valve

from .diagnosis.variation_terms import ABSOLUTE, term_values
from .errors import BenchInputError
from .model import Model
from .record import BenchRecord, TestRecord
from .static_model import base_valve, pad, with_parameters


# Applied to the readings of a whole test: it looks back along the sweep.
LAG = "flowmeter_lag"


SAME = 1e-9  # relative: what two files write of one number differs by less
# What of [valve] a prediction uses: the field, its bench unit, and how many of these are in one SI unit.
GEOMETRY = (
    ("stroke", "um", 1e6),
    ("slot_width", "mm", 1e3),
    ("land_diameter", "mm", 1e3),
    ("rated_current", "mA", 1e3),
)
NOT_THE_OIL = ("name", "source", "coldest", "hottest")  # they describe it


def as_in_record(model: Model, record: BenchRecord) -> tuple[Model, tuple[str, ...]]:
    """The model with the oil and the geometry that the record states, and a note for each in which the two differ."""
    changed, notes, oil = {}, [], model.oil
    for name, unit, factor in GEOMETRY:
        stated, fitted = getattr(record.valve, name), getattr(model.valve, name)
        if stated is None or (fitted is not None and _same(stated, fitted)):
            continue
        changed[name] = stated
        if fitted is not None:
            notes.append(
                f"{name}: the record states {stated * factor:.6g} {unit} and gets it; the model was fitted with "
                f"{fitted * factor:.6g} {unit}"
            )
    if record.valve.polarity != model.valve.polarity:
        changed["polarity"] = record.valve.polarity  # of the record's own current
    if not _same_oil(record.oil, model.oil):
        oil = record.oil
        notes.append(f"oil: the record states {_named(oil)} and gets it; the model was fitted with {_named(model.oil)}")
        kept = [name for name in acting_effects(model) if "oil" in effect_info(name).stages]
        if kept:
            notes.append(f"oil: {', '.join(kept)} of the model was found with that other oil and is kept")
    return replace(model, valve=replace(model.valve, **changed), oil=oil), tuple(notes)


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= SAME * max(abs(one), abs(other))


def _same_oil(one: OilDefinition, other: OilDefinition) -> bool:
    others = asdict(other)
    return all(_same(value, others[name]) for name, value in asdict(one).items() if name not in NOT_THE_OIL)


def _named(oil: OilDefinition) -> str:
    return f"{oil.name} ({kinematic_viscosity_of(oil, 313.15) * 1e6:.3g} cSt at 40 degC)"


def valve_without_effects(model: Model, record: BenchRecord) -> Valve:
    """The valve with the model's parameters alone."""
    own = BenchRecord(record.folder, record.name, model.valve, model.oil, record.tests)
    return base_valve(own, model.parameters, heat="heat_retention" in model.free)


def acting_effects(model: Model) -> dict[str, float]:
    """Effects that change something or whose uncertainty counts: an absent one is not even compiled."""
    counted = model.free if model.covariance is not None else ()
    return {name: amount for name, amount in model.effects.items() if amount != 0.0 or name in counted}


def row_terms(model: Model, test: TestRecord) -> dict[str, Float[Array, " padded"]]:
    """{quantity: what its value is multiplied by, or what is added to it [m]} at each padded row, all terms together.

    Raises BenchInputError where the test lacks the column that a term follows.
    """
    found: dict[str, np.ndarray] = {}
    for term in model.learned:
        try:
            change = term_values(term, test, model.oil)
        except ValueError:
            column = "time" if term.variable in ("elapsed", "rate") else term.variable
            raise BenchInputError(
                f"the model's learned term makes {term.quantity} follow {term.variable}, which needs the column "
                f'"{column}"; add it, or take the term out of the model',
                file=test.path,
            ) from None
        if term.quantity in ABSOLUTE:
            found[term.quantity] = found.get(term.quantity, 0.0) + change
        else:
            found[term.quantity] = found.get(term.quantity, 1.0) * (1.0 + change)
    return {quantity: pad(change) for quantity, change in found.items()}


def with_terms(valve: Valve, terms: dict[str, Float[Array, " rows"]]) -> Valve:
    """The valve with learned changes of its quantities, one per row."""
    for quantity, change in terms.items():
        if quantity == "viscosity":
            valve = with_effects(valve, {"viscosity_shift": change - 1.0})
            continue
        own = getattr(valve, quantity)
        changed = own + change if quantity in ABSOLUTE else own * change
        valve = with_parameters(valve, (quantity,), changed[None])
    return valve


def require_columns(model: Model, test: TestRecord, channels: tuple[str, ...]) -> None:
    """Raise BenchInputError where an effect of the model needs a column that the test does not have."""
    acting = acting_effects(model)
    meters = not FLOW_CHANNELS.isdisjoint(channels)
    for name, column, sees in ((LAG, test.time, meters), ("position_lag", test.rate, True)):
        if name in acting and sees and column is None:
            raise BenchInputError(
                f'the model has a {name}, which needs the time of every row: add the column "time", or take the effect '
                "out of the model",
                file=test.path,
            )
