"""Valves, oils and operating points that the tests of the simulator share."""

import jax.numpy as jnp
import numpy as np

from thermohyd.conditions import Conditions
from thermohyd.oil import Oil, oil_from_definition
from thermohyd.oil_definition import OilDefinition, walther_coefficients
from thermohyd.valve import Valve


STROKE = 213e-6
NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")


def seed_oil_definition() -> OilDefinition:
    a, b = walther_coefficients([233.15, 343.15], [4000e-6, 30e-6])
    return OilDefinition(a, b)


def seed_oil() -> Oil:
    return oil_from_definition(seed_oil_definition())


def valve_of(values, eta: float | None = None, oil: Oil | None = None) -> Valve:
    """A valve on the seed body with parameters in the order of NAMES."""
    fields = {name: values[i] for i, name in enumerate(NAMES)}
    return Valve(
        oil=seed_oil() if oil is None else oil,
        stroke=STROKE,
        slot_width=12e-3,
        heat_retention=None if eta is None else jnp.asarray(eta),
        null_pressure=100e5,
        **fields,
    )


def seed_valve(eta: float | None = None, **changes) -> Valve:
    """The paper's valve (docs/physics.md section 1)."""
    values = dict(zip(NAMES, (15e-6, 2e-6, 15e-6, 0.7, 100.0, 0.0), strict=True)) | changes
    return valve_of([values[name] for name in NAMES], eta)


def temperature_at(centistokes: float) -> float:
    """Temperature [K] at which the seed oil has a kinematic viscosity, from its D341 law."""
    oil = seed_oil_definition()
    return float(10 ** ((oil.viscosity_a - np.log10(np.log10(centistokes + 0.7))) / oil.viscosity_b))


def random_parameters(rng: np.random.Generator) -> np.ndarray:
    low = [0.0, 0.5e-6, -20e-6, 0.5, 30.0, -5e-6]
    high = [30e-6, 8e-6, 25e-6, 0.8, 300.0, 5e-6]
    return rng.uniform(low, high)


def random_conditions(rng: np.random.Generator, rows: int, load: bool = False) -> Conditions:
    supply = rng.uniform(30e5, 280e5, rows)
    back = rng.uniform(0.0, 10e5, rows)
    x = STROKE * rng.uniform(-1.0, 1.0, rows) * rng.uniform(0.0, 1.0, rows)
    return Conditions(
        position=jnp.asarray(x),
        supply_pressure=jnp.asarray(supply),
        return_pressure=jnp.asarray(back),
        temperature=jnp.asarray(rng.uniform(233.15, 373.15, rows)),
        load_pressure=jnp.asarray((supply - back) * rng.uniform(-0.9, 0.9, rows)) if load else None,
    )
