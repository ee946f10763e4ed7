"""What a model says of static and of dynamic tests apart, and the units of dynamic predictions: light to import."""

from dataclasses import replace

import numpy as np

from thermohyd.effects.registry import effect_info

from ..errors import BenchInputError
from ..model import Model
from ..record import BenchRecord, DynamicTest


# Bench units of the readings; an absolute ratio and a phase keep SI and degrees.
UNITS = {
    "spool_position": "um",
    "pressure_a": "bar",
    "pressure_b": "bar",
    "piston_position": "mm",
    "piston_velocity": "mm/s",
    "phase": "deg",
}


def unit_of(test: DynamicTest, channel: str) -> str:
    """The unit in which a prediction is written."""
    if channel != "amplitude_ratio":
        return UNITS[channel]
    if not test.absolute:
        return "1"
    per_current = test.command_kind == "current"
    if test.output == "piston_velocity":
        return "m/s/A" if per_current else "1/s"
    return "m/A" if per_current else "1"


def require_actuator(model: Model, record: BenchRecord) -> None:
    """Raise BenchInputError where nobody says which actuator a dynamic record is of."""
    data = record.dynamic
    if data is not None and not data.given and model.actuator is None:
        raise BenchInputError(
            "has dynamic tests but no [actuator], and the model has none either; add [actuator]", file=record.folder
        )


def as_static(model: Model) -> Model:
    """The part of a model that static tests see: without what was identified from motion."""
    moving = {n for n in model.effects if effect_info(n).dynamic} | set(model.dynamics)
    if not moving:
        return model
    keep = [i for i, n in enumerate(model.free) if n not in moving]
    matrix = None if model.covariance is None else model.covariance[np.ix_(keep, keep)]
    effects = {n: a for n, a in model.effects.items() if n not in moving}
    return replace(model, free=tuple(model.free[i] for i in keep), covariance=matrix, effects=effects, dynamics={})
