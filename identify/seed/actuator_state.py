"""The paper's actuator at null over all models, pressures and temperatures of the curves."""

from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import Performance, performance
from thermohyd.valve import Valve

from .curves import ETA, SeedCurves


def performance_of(curves: SeedCurves, valve: Valve, actuator: Actuator) -> dict[str, np.ndarray]:
    """{name of a figure of `Performance`: its values (model, supply, temperature)}, gamma = 2, return pressure zero."""
    temperature, supply = jnp.asarray(curves.temperature), jnp.asarray(curves.supply)[:, None]
    found = [
        jax.device_get(
            performance(valve, actuator, temperature=temperature, supply_pressure=supply, heat=jnp.asarray(eta))
        )
        for eta in ETA
    ]
    return {field.name: np.stack([getattr(model, field.name) for model in found]) for field in fields(Performance)}
