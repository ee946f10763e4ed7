"""A record's valve and actuator as the simulator's modules, with some of their parameters and effects as a vector."""

from collections.abc import Mapping
from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.actuator import Actuator
from thermohyd.effects.registry import with_effects
from thermohyd.valve import Valve

from ..parameters import IN_MOTION
from ..record import ActuatorData, BenchRecord
from ..static_model import base_valve


def actuator_of(data: ActuatorData, rated_current: float | None, values: Mapping[str, float] | None = None) -> Actuator:
    """The simulator's actuator of an `[actuator]` table, with the identified `values` in the place of its own."""
    own = {
        name: getattr(data, name)
        for name in ActuatorData.__dataclass_fields__
        if name != "heat" and getattr(data, name) is not None
    }
    if rated_current is not None:
        own["rated_current"] = rated_current
    own |= {name: value for name, value in (values or {}).items() if name in IN_MOTION}
    return Actuator(**own)


def valve_of(record: BenchRecord, values: Mapping[str, float], effects: Mapping[str, float] | None = None) -> Valve:
    """The record's valve with parameters and held effects."""
    own = {name: value for name, value in values.items() if name not in IN_MOTION}
    return with_effects(base_valve(record, own), dict(effects or {}))


def machine(
    valve: Valve, actuator: Actuator, names: tuple[str, ...], effects: tuple[str, ...], p: Float[Array, " all"]
) -> tuple[Valve, Actuator]:
    """Both with the parameters `names` and the amounts of `effects`, in this order, taken from `p` (all,)."""
    given = {name: p[i] for i, name in enumerate(names)}
    moving = {name: value for name, value in given.items() if name in IN_MOTION}
    still = {name: value for name, value in given.items() if name not in IN_MOTION}
    amounts = {name: jnp.asarray(p[len(names) + i]) for i, name in enumerate(effects)}
    return with_effects(replace(valve, **still), amounts), replace(actuator, **moving)
