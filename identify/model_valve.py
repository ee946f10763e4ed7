"""The simulator's valve for a `Model` and the rows of a test: parameters, effects, and learned terms row by row."""

import numpy as np
from jaxtyping import Array, Float

from thermohyd.effects.flowmeter import FLOW_CHANNELS
from thermohyd.effects.registry import with_effects
from thermohyd.valve import Valve

from .diagnosis.variation_terms import ABSOLUTE, term_values
from .errors import BenchInputError
from .model import Model
from .record import BenchRecord, TestRecord
from .static_model import base_valve, pad, with_parameters


# Applied to the readings of a whole test: it looks back along the sweep.
LAG = "flowmeter_lag"


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
