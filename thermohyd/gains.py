"""The static gains of a valve by differentiation: K_QX, K_PX, K_QP and their non-dimensional forms (MODEL section 4)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .conditions import Conditions
from .static_tests import control_flow, load_flow, load_pressure
from .valve import Valve


@eqx.filter_jit
def _slope(reading, valve: Valve, conditions: Conditions, field: str) -> Float[Array, " rows"]:
    """d(reading)/d(field of the conditions), row by row: one forward-mode pass, as rows do not depend on each other."""

    def of(value: Float[Array, " rows"]) -> Float[Array, " rows"]:
        return reading(valve, eqx.tree_at(lambda c: getattr(c, field), conditions, value))

    value = getattr(conditions, field)
    return jax.jvp(of, (value,), (jnp.ones_like(value),))[1]


def flow_gain(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """K_QX = dQ/dx of the flow-gain test [m2/s]."""
    return _slope(control_flow, valve, conditions, "position")


def pressure_gain(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """K_PX = d(p_A - p_B)/dx with blocked ports [Pa/m]."""
    return _slope(load_pressure, valve, conditions, "position")


def flow_pressure_gain(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """K_QP = -dQ/dp_L of the load flow [m3/(s Pa)], at `conditions.load_pressure` (0 where there is none)."""
    if conditions.load_pressure is None:
        conditions = eqx.tree_at(
            lambda c: c.load_pressure,
            conditions,
            jnp.zeros_like(conditions.position),
            is_leaf=lambda leaf: leaf is None,
        )
    return -_slope(load_flow, valve, conditions, "load_pressure")


def nondimensional_pressure_gain(
    valve: Valve, conditions: Conditions, nominal_pressure: float | Array
) -> Float[Array, " rows"]:
    """bar K_PX = K_PX X_n / P_n (the seed paper's Eq. 5), X_n the stroke, P_n [Pa] the nominal valve pressure drop."""
    return pressure_gain(valve, conditions) * valve.stroke / nominal_pressure


def nondimensional_flow_gain(
    valve: Valve, conditions: Conditions, nominal_flow: float | Array
) -> Float[Array, " rows"]:
    """bar K_QX = K_QX X_n / Q_n (the seed paper's Eq. 7), Q_n [m3/s] the rated flow."""
    return flow_gain(valve, conditions) * valve.stroke / nominal_flow
