"""Effects as a user writes them, in a module of their own: the package knows nothing of this file."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.dynamics.machine import AbstractForceEffect
from thermohyd.effects.effect import AbstractReadingEffect, as_amount
from thermohyd.effects.effect_info import EffectInfo
from thermohyd.effects.library import register_effect, unregister_effect
from thermohyd.oil import Oil


@final
class MeterTare(AbstractReadingEffect):
    """Leakage meter: Q + k P_s, at every oil temperature alike. Amount k >= 0 [m3/(s Pa)]."""

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        return value + self.amount * read.supply_pressure if channel == "leakage_flow" else value


@final
class LoadDrag(AbstractForceEffect):
    """The load moves through a fluid: F = k v |v|. Amount k >= 0 [N s2/m2]."""

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def force(self, velocity: Float[Array, ""]) -> Float[Array, ""]:
        return self.amount * velocity * abs(velocity)


METER_TARE = EffectInfo(
    name="meter_tare",
    effect=MeterTare,
    unit="m3/(s Pa)",
    lower=0.0,
    upper=1e-10,
    typical=(1e-14, 1e-12),
    scale=1e-13,
    shows=("leakage",),
    sentence="the leakage meter's zero moves with the supply pressure",
    caveat="a look at the meter with its valve shut tells",
)
LOAD_DRAG = EffectInfo(
    name="load_drag",
    effect=LoadDrag,
    unit="N s2/m2",
    lower=0.0,
    upper=1e8,
    typical=(1e3, 1e5),
    scale=1e4,
    shows=("step",),
    sentence="the load moves through a fluid that slows it down",
    shown=("kN/(m/s)^2", 1e-3),
)


@contextmanager
def registered(*infos: EffectInfo) -> Iterator[None]:
    """The library with these effects, and without them again."""
    for info in infos:
        register_effect(info)
    try:
        yield
    finally:
        for info in infos:
            unregister_effect(info.name)
