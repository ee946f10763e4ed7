"""The paper's actuator at null over all temperatures: its performance from the gains that the curves hold already."""

from dataclasses import fields

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import NullState, Performance, chamber_modulus, performance_at
from thermohyd.conditions import operating_points
from thermohyd.valve import Valve

from .curves import ETA, SeedCurves, with_heat_by_row


@eqx.filter_jit
def _performance(
    valve: Valve, actuator: Actuator, supply: Array, temperature: Array, known: dict[str, Array]
) -> Performance:
    rows = operating_points(0.0, supply_pressure=supply, temperature=temperature)
    null = NullState(
        flow_gain=known["flow_gain"],
        pressure_gain=known["pressure_gain"],
        flow_pressure_gain=known["flow_pressure_gain"],
        leakage=known["leakage"],
        bulk_modulus=chamber_modulus(with_heat_by_row(valve, known["eta"]), rows, known["pressure"]),
    )
    return performance_at(null, valve.stroke, actuator, supply, jnp.asarray(2.0))


def performance_of(
    curves: SeedCurves, valve: Valve, actuator: Actuator
) -> dict[str, Float[np.ndarray, "model supply t"]]:
    """{name of a figure of `Performance`: its values}, with gamma = 2. Return pressure zero, as in the curves.

    The same as `thermohyd.performance`, without the load flow's Jacobian, which takes longer to trace than all the rest.
    """
    at = curves.at_opening(0.0)
    shape = curves.null_flow_pressure_gain.shape
    eta, supply, temperature = np.meshgrid(ETA, curves.supply, curves.temperature, indexing="ij")
    known = {
        "eta": eta,
        "flow_gain": curves.flow_gain[..., at],
        "pressure_gain": curves.pressure_gain[..., at],
        "flow_pressure_gain": curves.null_flow_pressure_gain,
        "leakage": curves.leakage[..., at],
        "pressure": curves.mean_pressure[..., at],
    }
    flat = {name: jnp.asarray(values.ravel()) for name, values in known.items()}
    found = _performance(valve, actuator, jnp.asarray(supply.ravel()), jnp.asarray(temperature.ravel()), flat)
    found = jax.device_get(found)
    return {field.name: np.asarray(getattr(found, field.name)).reshape(shape) for field in fields(Performance)}
