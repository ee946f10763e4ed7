"""The valve: geometry, oil, the identified parameters, how much heat the oil keeps, and the effects that were added."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .conditions import Conditions
from .edge import MeteringEdge
from .effect import (
    AbstractConditionEffect,
    AbstractCrossingEffect,
    AbstractEdgeEffect,
    AbstractEffect,
    AbstractHeatEffect,
    AbstractLineEffect,
    AbstractOilEffect,
    AbstractReadingEffect,
    Coupling,
    Edges,
    in_order,
)
from .oil import Oil


def _as_array(value: float | Array) -> Array:
    return jnp.asarray(value, dtype=jnp.result_type(float))


class Valve(eqx.Module):
    """A four-edge spool valve, second stage (MODEL sections 3 to 5). Lengths in m; every array field is differentiable.

    Edges P-A and B-T open with +x, P-B and A-T with -x: u = U +- (x - x0).

    heat_retention eta: None is the isothermal model (HM, all heat leaves to the body) and costs nothing; 0 is the same
    computed; 1 is the adiabatic model (THM, all heat stays in the oil); between them eta = exp(-NTU).
    """

    oil: Oil
    stroke: Float[Array, ""] = eqx.field(converter=_as_array)
    slot_width: Float[Array, ""] = eqx.field(converter=_as_array)
    edge_radius: Float[Array, ""] = eqx.field(converter=_as_array)
    clearance: Float[Array, ""] = eqx.field(converter=_as_array)
    underlap: Float[Array, ""] = eqx.field(converter=_as_array)
    discharge_coefficient: Float[Array, ""] = eqx.field(converter=_as_array, default=0.7)
    transition_number: Float[Array, ""] = eqx.field(converter=_as_array, default=100.0)
    null_bias: Float[Array, ""] = eqx.field(converter=_as_array, default=0.0)
    heat_retention: Float[Array, ""] | None = None
    land_diameter: Float[Array, ""] | None = None
    effects: tuple[AbstractEffect, ...] = eqx.field(converter=in_order, default=())


def true_conditions(valve: Valve, read: Conditions) -> Conditions:
    """What the valve saw: the instruments' errors undone, the position counted from the hydraulic null."""
    true = read
    for effect in valve.effects:
        if isinstance(effect, AbstractConditionEffect):
            true = effect.true_conditions(true, read)
    return eqx.tree_at(lambda c: c.position, true, true.position - valve.null_bias)


def true_oil(valve: Valve) -> Oil:
    """The oil in the valve, after the effects that change it."""
    oil = valve.oil
    for effect in valve.effects:
        if isinstance(effect, AbstractOilEffect):
            oil = effect.oil(oil)
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
    for effect in valve.effects:
        if isinstance(effect, AbstractReadingEffect):
            value = effect.reading(channel, value, read, true, oil)
    return value
