"""Performance figures and their derivatives with respect to everything, in one compiled call."""

import re
from dataclasses import fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from .actuator import Actuator
from .actuator_performance import (
    Performance,
    null_conditions,
    null_state,
    performance_at,
    with_heat,
    without_instruments,
)
from .arguments import Heat
from .conditions import Conditions
from .numerics import kept
from .valve import Valve


CONDITIONS = ("temperature", "supply_pressure", "return_pressure")
Named = dict[str, Array]


class PerformanceDerivatives(eqx.Module):
    """Performance figures with their derivatives.

    value: the figures. parameter: {name: value, SI}. slopes: every figure's derivatives per SI unit, in the order of `parameter`
    along a leading axis; `derivative(name)` picks one parameter's.
    Names: "temperature", "supply_pressure", "return_pressure", "valve.edge_radius", "valve.heat_retention" (where heat is
    computed), "valve.effects.eccentricity", "oil.viscosity_a", "actuator.piston_area" and so on, one per scalar field.
    """

    value: Performance
    parameter: Named
    slopes: Performance

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.parameter)

    def derivative(self, name: str) -> Performance:
        """d(figure)/d(parameter), every figure. Raises ValueError for an unknown name."""
        place = self.names.index(name)
        return jax.tree.map(lambda slope: slope[place], self.slopes)

    def elasticity(self, name: str) -> Performance:
        """d ln(figure)/d ln(parameter), every figure: per cent of the figure per per cent of the parameter."""
        share = self.parameter[name]
        return jax.tree.map(lambda slope, figure: share * slope / figure, self.derivative(name), self.value)


def _scalars(module: Any, prefix: str) -> Named:
    found = {f"{prefix}.{field.name}": getattr(module, field.name) for field in fields(module)}
    return {name: value for name, value in found.items() if eqx.is_array(value) and value.ndim == 0}


def _effect_names(valve: Valve) -> list[str]:
    """The effects' names as `thermohyd.effects` has them: their classes' names in lower case with underscores."""
    return [re.sub(r"(?<!^)(?=[A-Z])", "_", type(effect).__name__).lower() for effect in valve.effects]


def named_parameters(valve: Valve, actuator: Actuator, conditions: Conditions) -> Named:
    """{name: value} of all that a performance figure may depend on; the conditions have the shape (rows,), the rest ()."""
    amounts = {
        f"valve.effects.{name}": effect.amount
        for name, effect in zip(_effect_names(valve), valve.effects, strict=True)
        if effect.amount.ndim == 0
    }
    named = {name: getattr(conditions, name) for name in CONDITIONS} | amounts
    named |= _scalars(valve, "valve") | _scalars(valve.oil, "oil") | _scalars(actuator, "actuator")
    del named["valve.null_bias"]  # a loop finds the null wherever it is
    return dict(sorted(named.items()))  # the order in which JAX passes a dictionary on


def _with_named(
    valve: Valve, actuator: Actuator, conditions: Conditions, named: Named
) -> tuple[Valve, Actuator, Conditions]:
    def of(prefix: str) -> Named:
        return {name[len(prefix) :]: value for name, value in named.items() if name.startswith(prefix)}

    amounts = of("valve.effects.")
    effects = tuple(
        replace(effect, amount=amounts.get(name, effect.amount))
        for name, effect in zip(_effect_names(valve), valve.effects, strict=True)
    )
    own = {name: value for name, value in of("valve.").items() if "." not in name}
    valve = replace(valve, **own, effects=effects, oil=replace(valve.oil, **of("oil.")))
    return valve, replace(actuator, **of("actuator.")), replace(conditions, **{n: named[n] for n in CONDITIONS})


@kept
def _all(
    valve: Valve, actuator: Actuator, conditions: Conditions, gamma: Float[Array, ""]
) -> tuple[Performance, Performance]:
    """The figures, and their derivatives with a leading axis for the parameters.

    That axis stays: hundreds of small results would each be compiled with much of the whole program.
    """
    named = named_parameters(valve, actuator, conditions)

    def figures(named: Named) -> Performance:
        v, a, c = _with_named(valve, actuator, conditions, named)
        return performance_at(null_state(v, c), v.stroke, a, c.supply_pressure, gamma)

    # A row depends on its own conditions only, so one tangent serves a condition of all rows.
    units = jnp.eye(len(named))
    tangents = {
        name: jnp.broadcast_to(unit.reshape(-1, *(1,) * named[name].ndim), (len(named), *named[name].shape))
        for name, unit in zip(named, units, strict=True)
    }
    return jax.vmap(lambda tangent: jax.jvp(figures, (named,), (tangent,)), out_axes=(None, 0))(tangents)


def performance_with_derivatives(
    valve: Valve,
    actuator: Actuator,
    *,
    temperature: ArrayLike,
    supply_pressure: ArrayLike,
    return_pressure: ArrayLike = 0.0,
    heat: Heat | float | Array | None = None,
    gamma: float = 2.0,
) -> PerformanceDerivatives:
    """`performance`, and the derivative of every figure with respect to conditions, geometry, effects, oil and actuator.

    Same arguments as `performance`; figures and derivatives have the conditions' common shape. Forward mode, one program.
    Where no heat is computed (the valve's own None), eta is not among the parameters: give heat=0.0 for its derivative at
    the isothermal model. Nor is the null bias: the loop finds the null.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd import performance_with_derivatives, seed_actuator
    >>> from thermohyd.seed_paper import seed_valve
    >>> found = performance_with_derivatives(seed_valve(), seed_actuator(), temperature=313.15, supply_pressure=70e5)
    >>> print(f"{found.value.null_consumption:.2f} W, {found.derivative('temperature').null_consumption:+.2f} W/K")
    15.93 W, +0.48 W/K
    >>> print(f"{found.elasticity('valve.clearance').null_consumption:.2f} % of it per % of the clearance")
    0.66 % of it per % of the clearance
    """
    temperature, supply, back = jnp.broadcast_arrays(
        *(jnp.asarray(a, dtype=jnp.result_type(float)) for a in (temperature, supply_pressure, return_pressure))
    )
    built = with_heat(without_instruments(valve), heat)
    conditions = null_conditions(temperature, supply, back)
    value, slopes = _all(built, actuator, conditions, jnp.asarray(gamma, dtype=jnp.result_type(float)))
    named = named_parameters(built, actuator, conditions)
    shape = temperature.shape
    return PerformanceDerivatives(
        value=jax.tree.map(lambda leaf: leaf.reshape(shape), value),
        parameter={name: leaf.reshape(shape) if leaf.ndim else leaf for name, leaf in named.items()},
        slopes=jax.tree.map(lambda leaf: leaf.reshape(-1, *shape), slopes),
    )
