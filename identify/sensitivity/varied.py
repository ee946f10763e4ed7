"""A valve and its operating points with the factors of a study at given values: what every derivative of a study is taken of."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.effects.library import effect_info, with_effects
from thermohyd.identify.fitting.parameters import OF_THE_EDGES
from thermohyd.identify.model.model import Model
from thermohyd.oil import Oil, TemperatureShifts, at_temperature, oil_from_definition
from thermohyd.valve import Valve

from .factors import FACTORS


# The laws of the oil, each of which can be asked to see another temperature than the oil has.
LAWS = ("viscosity_law", "density_law", "bulk_modulus_law", "heat_law")
_IN_VALVE = (*OF_THE_EDGES, "slot_width")


def valve_of_model(model: Model) -> Valve:
    """The simulator's valve of a model: parameters, and those of its effects that act at single operating points.

    Heat is always computed, so that eta can vary; learned terms are no physics and are left out.
    """
    numbers = dict(model.parameters)
    eta = numbers.pop("heat_retention", 0.0)
    valve = Valve(
        oil=oil_from_definition(model.oil),
        stroke=model.valve.stroke,
        slot_width=model.valve.slot_width,
        heat_retention=jnp.asarray(eta),
        land_diameter=None if model.valve.land_diameter is None else jnp.asarray(model.valve.land_diameter),
        null_pressure=model.valve.null_pressure,
        edge_law=model.valve.edge_law,
        **numbers,  # pyright: ignore[reportArgumentType]  # names are those of Valve's fields
    )
    return with_effects(
        valve, {name: a for name, a in model.effects.items() if a != 0.0 and not effect_info(name).of_sweeps}
    )


def nominal_values(valve: Valve) -> dict[str, Array]:
    """{factor or law: value at which nothing is changed}; temperature and pressures are counted from those of the conditions."""
    one, zero = jnp.ones(()), jnp.zeros(())
    return {
        **{name: getattr(valve, name) for name in (*_IN_VALVE, "stroke")},
        "viscosity": one,
        "density": one,
        "temperature": zero,
        "supply_pressure": one,
        "return_pressure": zero,
        "heat_retention": zero if valve.heat_retention is None else valve.heat_retention,
        **dict.fromkeys(LAWS, zero),
    }


def varied(valve: Valve, conditions: Conditions, values: Mapping[str, Float[Array, "..."]]) -> tuple[Valve, Conditions]:
    """The valve and the conditions with factors at `values` (those of `nominal_values` change nothing).

    Each value is a number or has one entry per row. viscosity, density and supply_pressure are factors on what is there;
    temperature [K] and return_pressure [Pa] are added to it; a stroke carries the positions with it. A value of one of
    `LAWS` is added to the temperature [K] that this law alone sees.
    """
    own = [name for name in _IN_VALVE if name in values]
    if own:
        valve = eqx.tree_at(lambda v: [getattr(v, name) for name in own], valve, [values[name] for name in own])
    oil = valve.oil
    if "viscosity" in values:
        factor = values["viscosity"] if oil.viscosity_factor is None else oil.viscosity_factor * values["viscosity"]
        oil = eqx.tree_at(lambda o: o.viscosity_factor, oil, factor, is_leaf=_absent)
    if "density" in values:
        oil = eqx.tree_at(lambda o: o.density_15degC, oil, oil.density_15degC * values["density"])
    changed = eqx.tree_at(lambda v: v.oil, valve, oil)
    if LAWS[0] in values:
        changed = _with_shifts(changed, TemperatureShifts(*[values[law] for law in LAWS]))
    if "heat_retention" in values:
        changed = eqx.tree_at(lambda v: v.heat_retention, changed, values["heat_retention"], is_leaf=_absent)
    c = conditions
    if "stroke" in values:
        c = eqx.tree_at(lambda c: c.position, c, c.position * (values["stroke"] / valve.stroke))
        changed = eqx.tree_at(lambda v: v.stroke, changed, values["stroke"])
    if "temperature" in values:
        c = eqx.tree_at(lambda c: c.temperature, c, c.temperature + values["temperature"])
    if "supply_pressure" in values:
        c = eqx.tree_at(lambda c: c.supply_pressure, c, c.supply_pressure * values["supply_pressure"])
    if "return_pressure" in values:
        c = eqx.tree_at(lambda c: c.return_pressure, c, c.return_pressure + values["return_pressure"])
    return changed, c


def _with_shifts(valve: Valve, shifts: TemperatureShifts) -> Valve:
    """The valve whose oil laws see other temperatures. Leakage stated at one temperature stays what it is there."""
    oil = eqx.tree_at(lambda o: o.shifts, valve.oil, shifts, is_leaf=_absent)
    changed = eqx.tree_at(lambda v: v.oil, valve, oil)
    stated = {i: t for i, effect in enumerate(valve.effects) if (t := type(effect).stated_at) is not None}
    if not stated:
        return changed
    kept = {t: _viscosity_at(valve.oil, t) / _viscosity_at(oil, t) for t in set(stated.values())}
    return eqx.tree_at(
        lambda v: [v.effects[i].amount for i in stated],
        changed,
        [valve.effects[i].amount * kept[t] for i, t in stated.items()],
    )


def _viscosity_at(oil: Oil, temperature: float) -> Float[Array, "..."]:
    return at_temperature(oil, jnp.asarray(temperature)).viscosity


def by_name(values: Float[Array, "factors ..."], names: tuple[str, ...] = FACTORS) -> dict[str, Float[Array, "..."]]:
    """Values in the order of `names` as `varied` takes them."""
    return {name: values[i] for i, name in enumerate(names)}


def _absent(leaf: object) -> bool:
    return leaf is None
