"""How the figures of a valve and of its actuator drift with temperature, and which law of oil or clearance causes how much of it.

The laws are the oil's viscosity, density, stiffness and heat, and the thermal growth of the clearance; the parts add up to the drift.
"""

from dataclasses import dataclass, fields

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import Performance, null_conditions, null_state, performance_at, without_instruments
from thermohyd.conditions import Conditions
from thermohyd.effects.edges import REFERENCE_TEMPERATURE
from thermohyd.numerics import quickly, require_float64
from thermohyd.valve import Valve, metering_edges

from .curves import COLUMNS, nominal_rows, slopes_at
from .static_figures import ASIDE
from .varied import LAWS, nominal_values, varied


# What a drift is put down to, in the order of `Drift.parts`.
CAUSES = ("viscosity", "density", "bulk modulus", "heating", "clearance")
FIGURES = {
    "null_leakage": "m3/s",
    "open_leakage": "m3/s",
    "null_flow_gain": "m2/s",
    "null_pressure_gain": "Pa/m",
    "null_flow_pressure_gain": "m3/(s Pa)",
    "full_flow": "m3/s",
}
OPEN = 0.49  # of the stroke
_ROWS = 5  # null, to either side of it, open, full


@dataclass(frozen=True)
class Drift:
    """One figure over temperature: value and d/dT, (temperatures,) each, SI.

    parts: (causes, temperatures), what of d/dT is the oil's kinematic viscosity, its density, its bulk modulus, its heat
    (specific heat and expansion in throttling) and the clearance's own growth (effects on the edges). They add up
    to `slope` exactly.
    """

    name: str
    unit: str
    temperature: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    parts: np.ndarray
    causes: tuple[str, ...] = CAUSES

    @property
    def relative(self) -> np.ndarray:
        """d ln(figure)/dT [1/K]."""
        return self.slope / self.value


def temperature_drifts(
    valve: Valve, temperatures: np.ndarray, supply_pressure: float, return_pressure: float = 0.0
) -> dict[str, Drift]:
    """{figure: Drift} of leakage (null, and over the lands at 49 % of the stroke), K_QX, K_PX and K_QP at the hydraulic
    null and the flow at full stroke, over temperatures [K], at supply and return pressures [Pa].

    K_QP is K_QX/K_PX, which it is at the null. Gains are taken over 0.02 % of the stroke.

    >>> from thermohyd.identify.sensitivity.source import seed_model
    >>> from thermohyd.identify.sensitivity.varied import valve_of_model
    >>> leak = temperature_drifts(valve_of_model(seed_model()), np.array([313.15]), 70e5)["null_leakage"]
    >>> f"{100 * leak.relative[0]:.2f} %/K"
    '3.03 %/K'
    >>> bool(np.isclose(leak.parts.sum(axis=0)[0], leak.slope[0], rtol=1e-12))
    True
    """
    require_float64("sensitivity")
    stroke = float(valve.stroke)
    x, t = (
        a.reshape(-1)
        for a in np.meshgrid(
            stroke * np.array([0.0, -ASIDE, ASIDE, OPEN, 1.0]), np.asarray(temperatures, dtype=float), indexing="ij"
        )
    )
    values = np.array(nominal_rows(valve, len(x)))
    values[COLUMNS.index("null_bias")] = 0.0
    at = np.full(len(x), supply_pressure), np.full(len(x), return_pressure)
    readings, slopes = slopes_at(valve, x, *at, t, values)
    growth = thermal_growth(valve)
    parts = [slopes[:, COLUMNS.index(law)] for law in LAWS] + [growth * slopes[:, COLUMNS.index("clearance")]]
    columns = np.stack([readings, slopes[:, COLUMNS.index("temperature")], *parts])
    leakage, load, flow = np.moveaxis(
        columns.reshape(len(columns), 3, _ROWS, -1), 1, 0
    )  # (value, d/dT, parts...) first
    over = 2.0 * ASIDE * stroke
    flow_gain, pressure_gain = (flow[:, 2] - flow[:, 1]) / over, (load[:, 2] - load[:, 1]) / over
    found = {
        "null_leakage": leakage[:, 0],
        "open_leakage": leakage[:, 3],
        "null_flow_gain": flow_gain,
        "null_pressure_gain": pressure_gain,
        "null_flow_pressure_gain": _quotient(flow_gain, pressure_gain),
        "full_flow": flow[:, 4],
    }
    kelvin = np.asarray(temperatures, dtype=float)
    return {name: Drift(name, FIGURES[name], kelvin, c[0], c[1], c[2:]) for name, c in found.items()}


def thermal_growth(valve: Valve) -> float:
    """How the clearance grows with the temperature [m/K] at 40 degC: what effects on the edges make of it, 0 without any."""

    def clearance(temperature: Array) -> Array:
        zero = jnp.zeros(1)
        edges = metering_edges(valve, Conditions(zero, zero, zero, temperature[None]))
        return 0.5 * jnp.sum(edges.supply.clearance + edges.return_.clearance)

    return float(jax.jvp(clearance, (jnp.asarray(REFERENCE_TEMPERATURE),), (jnp.ones(()),))[1])


def _quotient(above: np.ndarray, below: np.ndarray) -> np.ndarray:
    """(value, derivatives...) of a quotient of two such stacks."""
    value = above[0] / below[0]
    return np.concatenate([value[None], (above[1:] - value * below[1:]) / below[0]])


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
OF_THE_VALVE = ("null_consumption",)  # those that no jack is in
_SEEN = ("temperature", *LAWS, "clearance")
_HEATING = 3  # its place among the causes


@quickly
def _figures(valve: Valve, actuator: Actuator, conditions: Conditions) -> tuple[Performance, Performance]:
    """Every figure, and its derivatives to what `_SEEN` names (first axis)."""
    nominal = nominal_values(valve)

    def of(values: Float[Array, " seen"]) -> Performance:
        moved, where = varied(valve, conditions, dict(zip(_SEEN, values, strict=True)))
        return performance_at(null_state(moved, where), moved.stroke, actuator, where.supply_pressure, jnp.asarray(2.0))

    figures, push = jax.linearize(of, jnp.stack([nominal[name] for name in _SEEN]))
    return figures, jax.lax.map(push, jnp.eye(len(_SEEN)))


def performance_drifts(
    valve: Valve,
    actuator: Actuator | None,
    temperatures: np.ndarray,
    supply_pressure: float,
    return_pressure: float = 0.0,
) -> dict[str, Drift]:
    """{figure: Drift} of the actuator's performance at null over temperatures [K], at supply and return pressures [Pa].

    The figures are those of `thermohyd.performance`, without a jack or of an unequal one those that no jack is in; what the
    bench's instruments add to the valve is left out, as there.
    Heating is what the oil's viscosity, density, bulk modulus and the clearance leave of the drift: its specific heat, and
    its absolute temperature in throttling and in the isentropic stiffening of the chambers.

    >>> from thermohyd.actuator import seed_actuator
    >>> from thermohyd.identify.sensitivity.source import seed_model
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
    names = OF_THE_VALVE
    if actuator is not None and actuator.symmetric:
        names = tuple(PERFORMANCE)
    else:
        actuator = Actuator()  # what is left does not depend on it
    value, slopes = _figures(built, actuator, conditions)
    drifts = {}
    for field in fields(value):
        figure, slope = np.asarray(getattr(value, field.name)), np.array(getattr(slopes, field.name))
        if field.name not in names or not figure.all():
            continue
        parts = slope[1:]
        parts[-1] *= thermal_growth(built)
        parts[_HEATING] = slope[0] - np.delete(parts, _HEATING, axis=0).sum(axis=0)
        drifts[field.name] = Drift(
            field.name, PERFORMANCE[field.name], np.asarray(temperatures, dtype=float), figure, slope[0], parts
        )
    return drifts
