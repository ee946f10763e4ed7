"""How an actuator's performance drifts with temperature, and what of it is the oil's viscosity, density, stiffness or heat."""

from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import (
    Performance,
    null_conditions,
    null_state,
    performance_at,
    without_instruments,
)
from thermohyd.conditions import Conditions
from thermohyd.precision import require_float64
from thermohyd.valve import Valve

from .drift import Drift, thermal_growth
from .varied import LAWS, nominal_values, varied


# The figures of `thermohyd.actuator_performance.Performance` that a user asks for; those that are zero are left out.
PERFORMANCE = {
    "natural_frequency": "rad/s",
    "damping_ratio": "dimensionless",
    "loop_gain": "1/s",
    "stability_ratio": "dimensionless",
    "time_constant": "s",
    "static_error": "m",
    "load_error": "m",
    "null_consumption": "W",
}
_SEEN = ("temperature", *LAWS, "clearance")
_HEATING = 3  # its place among the causes


@eqx.filter_jit
def _figures(valve: Valve, actuator: Actuator, conditions: Conditions) -> tuple[Performance, Performance]:
    """Every figure, and its derivatives to what `_SEEN` names (first axis)."""
    nominal = nominal_values(valve)

    def of(values: Float[Array, " seen"]) -> Performance:
        own, at = varied(valve, conditions, dict(zip(_SEEN, values, strict=True)))
        return performance_at(null_state(own, at), own.stroke, actuator, at.supply_pressure, jnp.asarray(2.0))

    found, push = jax.linearize(of, jnp.stack([nominal[name] for name in _SEEN]))
    return found, jax.lax.map(push, jnp.eye(len(_SEEN)))


def performance_drifts(
    valve: Valve,
    actuator: Actuator,
    temperatures: np.ndarray,
    supply_pressure: float,
    return_pressure: float = 0.0,
) -> dict[str, Drift]:
    """{figure: Drift} of the actuator's performance at null over temperatures [K], at supply and return pressures [Pa].

    The figures are those of `thermohyd.performance`; what the bench's instruments add to the valve is left out, as there.
    Heating is what the oil's viscosity, density, bulk modulus and the clearance leave of the drift: its specific heat, and
    its absolute temperature in throttling and in the isentropic stiffening of the chambers.

    >>> from thermohyd.actuator import seed_actuator
    >>> from thermohyd.identify.sensitivity.subject import seed_model
    >>> from thermohyd.identify.sensitivity.varied import valve_of_model
    >>> found = performance_drifts(valve_of_model(seed_model()), seed_actuator(), np.array([313.15]), 70e5)
    >>> stiff = found["natural_frequency"]
    >>> f"{stiff.value[0]:.0f} rad/s, {100 * stiff.relative[0]:+.2f} %/K, by the modulus {100 * stiff.parts[2, 0] / stiff.value[0]:+.2f}"
    '1204 rad/s, -0.28 %/K, by the modulus -0.28'
    """
    require_float64("sensitivity")
    built = without_instruments(valve)
    kelvin = jnp.asarray(temperatures, dtype=float)
    conditions = null_conditions(kelvin, supply_pressure + 0.0 * kelvin, return_pressure + 0.0 * kelvin)
    value, slopes = _figures(built, actuator, conditions)
    drifts = {}
    for field in fields(value):
        figure, slope = np.asarray(getattr(value, field.name)), np.array(getattr(slopes, field.name))
        if field.name not in PERFORMANCE or not figure.all():
            continue
        parts = slope[1:]
        parts[-1] *= thermal_growth(built)
        parts[_HEATING] = slope[0] - np.delete(parts, _HEATING, axis=0).sum(axis=0)
        drifts[field.name] = Drift(
            field.name, PERFORMANCE[field.name], np.asarray(temperatures, dtype=float), figure, slope[0], parts
        )
    return drifts
