"""The valve: geometry, oil, the identified parameters, how much heat the oil keeps, and the effects that were added."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.effects.effect import (
    AbstractConditionEffect,
    AbstractCrossingEffect,
    AbstractEdgeEffect,
    AbstractEffect,
    AbstractHeatEffect,
    AbstractInflowEffect,
    AbstractLineEffect,
    AbstractNullEffect,
    AbstractOilEffect,
    AbstractReadingEffect,
    AbstractStorageEffect,
    Coupling,
    Edges,
    in_order,
)

from .arguments import (
    ArgumentTypeError,
    as_array,
    as_optional_array,
    check_length,
    check_module,
    check_pressure,
    check_sign,
    check_size,
    check_word,
    described,
)
from .conditions import Conditions
from .edge import EDGE_LAWS, EdgeLaw, MeteringEdge
from .numerics import require_float64
from .oil import Oil


def _in_order(effects: Any) -> Any:
    """The effects in the order in which they act; what is no sequence of effects comes back for the check to name."""
    if isinstance(effects, tuple | list) and all(isinstance(effect, AbstractEffect) for effect in effects):
        return in_order(tuple(effects))
    return effects


def _law(word: Any) -> EdgeLaw:
    """The word itself, checked before anything is made of it."""
    check_word("edge_law", word, EDGE_LAWS)
    return word


class Valve(eqx.Module):
    """A four-edge spool valve, second stage (docs/physics.md section 4). Lengths in m; every array field is differentiable.

    Edges P-A and B-T open with +x, P-B and A-T with -x: u = U +- (x - x0).

    heat_retention eta: None is the isothermal model (HM, all heat leaves to the body) and costs nothing; 0 is the same
    computed; 1 is the adiabatic model (THM, all heat stays in the oil); between them eta = exp(-NTU).
    null_pressure: supply pressure [Pa, gauge] at which null_bias holds; only the effect null_shift_pressure asks for it.

    edge_law: "orifice" (the seed paper's) or "lubrication", which leaves transition_number unused; a choice, not an array.

    Known values are checked as the valve is made, traced ones never: ArgumentValueError for a wrong unit or sign,
    ArgumentTypeError for what is no number or no Oil, RuntimeError in single precision.
    """

    oil: Oil
    stroke: Float[Array, ""] = eqx.field(converter=as_array)
    slot_width: Float[Array, ""] = eqx.field(converter=as_array)
    edge_radius: Float[Array, ""] = eqx.field(converter=as_array)
    clearance: Float[Array, ""] = eqx.field(converter=as_array)
    underlap: Float[Array, ""] = eqx.field(converter=as_array)
    discharge_coefficient: Float[Array, ""] = eqx.field(converter=as_array, default=0.7)
    transition_number: Float[Array, ""] = eqx.field(converter=as_array, default=100.0)
    null_bias: Float[Array, ""] = eqx.field(converter=as_array, default=0.0)
    heat_retention: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    land_diameter: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    effects: tuple[AbstractEffect, ...] = eqx.field(converter=_in_order, default=())
    null_pressure: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    edge_law: EdgeLaw = eqx.field(static=True, converter=_law, default="orifice")

    def __check_init__(self) -> None:
        require_float64("a Valve")
        check_module("oil", self.oil, Oil, "oil_from_definition(oil_preset(...)) makes one")
        check_length("stroke", self.stroke, sign="positive")
        check_length("slot_width", self.slot_width, limit=1.0, unit="mm", sign="positive")
        check_length("edge_radius", self.edge_radius, sign="not negative")
        check_length("clearance", self.clearance, sign="not negative")
        check_length("underlap", self.underlap)
        check_sign("discharge_coefficient", self.discharge_coefficient)
        check_sign("transition_number", self.transition_number)
        check_length("null_bias", self.null_bias)
        if self.heat_retention is not None:
            # A little beyond the ends is allowed: central differences need it.
            check_size("heat_retention", self.heat_retention, -0.01, 1.01, "it is the share of the heat kept, 0 to 1")
        if self.land_diameter is not None:
            check_length("land_diameter", self.land_diameter, limit=1.0, unit="mm", sign="positive")
        if self.null_pressure is not None:
            check_pressure("null_pressure", self.null_pressure, supply=True)
        if not isinstance(self.effects, tuple) or not all(isinstance(e, AbstractEffect) for e in self.effects):
            raise ArgumentTypeError(
                f"effects must be a tuple of effects, not {described(self.effects)}: "
                "thermohyd.effects.library.with_effects(valve, {name: amount}) adds them by name"
            )


def true_conditions(valve: Valve, read: Conditions) -> Conditions:
    """What the valve saw: the instruments' errors undone, the position counted from the hydraulic null.

    The first of every test's steps, and so the place that raises ArgumentTypeError where valve and conditions are not such.
    """
    check_module("the first argument", valve, Valve, "the second one is its operating_points")
    check_module("the second argument", read, Conditions, "operating_points(...) makes them")
    true = read
    for effect in valve.effects:
        if isinstance(effect, AbstractConditionEffect):
            true = effect.true_conditions(true, read)
    return eqx.tree_at(lambda c: c.position, true, true.position - null_bias(valve, true))


def null_bias(valve: Valve, true: Conditions) -> Float[Array, "..."]:
    """Where the hydraulic null lies [m], after the effects that move it."""
    null = valve.null_bias
    for effect in valve.effects:
        if isinstance(effect, AbstractNullEffect):
            null = effect.null_bias(null, true, valve.null_pressure)
    return null


def true_oil(valve: Valve, true: Conditions | None = None) -> Oil:
    """The oil in the valve, after the effects that change it; true: the operating points, where they are known."""
    oil = valve.oil
    for effect in valve.effects:
        if isinstance(effect, AbstractOilEffect):
            oil = effect.oil(oil) if true is None else effect.oil_at(oil, true)
    return oil


def heat_kept(valve: Valve) -> Float[Array, "..."] | None:
    """The share eta of the throttling heat that stays in the oil, effects included; None where no heat is computed."""
    eta = valve.heat_retention
    for effect in valve.effects:
        if isinstance(effect, AbstractHeatEffect):
            eta = effect.heat_retention(jnp.zeros(()) if eta is None else eta)
    return eta


def coupling(valve: Valve) -> Coupling:
    """The effects that tie the balances of the ports together."""
    return Coupling(
        lines=tuple(effect for effect in valve.effects if isinstance(effect, AbstractLineEffect)),
        crossings=tuple(effect for effect in valve.effects if isinstance(effect, AbstractCrossingEffect)),
        storage=tuple(effect for effect in valve.effects if isinstance(effect, AbstractStorageEffect)),
        inflows=tuple(effect for effect in valve.effects if isinstance(effect, AbstractInflowEffect)),
    )


def rowwise(valve: Valve) -> bool:
    """Whether every reading depends on the parameters through its own row only, so that one reverse pass over parameters
    spread over the rows gives the whole Jacobian; where it is false (a flowmeter that lags), use forward mode."""
    return all(type(effect).rowwise for effect in valve.effects)


def metering_edges(valve: Valve, conditions: Conditions) -> Edges:
    """The supply and the return edges, after the effects that change them; `conditions` are the true ones."""
    ideal = MeteringEdge(
        slot_width=valve.slot_width,
        radius=valve.edge_radius,
        clearance=valve.clearance,
        underlap=valve.underlap,
        discharge_coefficient=valve.discharge_coefficient,
        transition_number=valve.transition_number,
        law=valve.edge_law,
    )
    edges = Edges(supply=ideal, return_=ideal)
    for effect in valve.effects:
        if isinstance(effect, AbstractEdgeEffect):
            edges = effect.edges(edges, conditions)
    return edges


def read_out(
    valve: Valve, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
) -> Float[Array, " rows"]:
    """What the bench's instrument says of a channel (leakage_flow, load_pressure, flow, ...); `oil` is the true one."""
    acting = [effect for effect in valve.effects if isinstance(effect, AbstractReadingEffect)]
    for effect in sorted(acting, key=lambda e: e.order if e.reads_at is None else e.reads_at):
        value = effect.reading(channel, value, read, true, oil)
    return value
