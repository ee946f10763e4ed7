"""The instruments of the operating point: thermometer, position transducer, differential pressure gauge."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..conditions import Conditions
from ..effect import AbstractConditionEffect, AbstractReadingEffect, as_amount
from ..oil import Oil


@final
class TemperatureOffset(AbstractConditionEffect):
    """True T = read T + d.

    Source: a thermometer's error, or its distance from the valve.
    Amount d [K], either sign, typical 0.5 to 10. Shows wherever viscosity does: leakage away from null, cold oil most.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        return eqx.tree_at(lambda c: c.temperature, so_far, so_far.temperature + self.amount)


@final
class PositionScale(AbstractConditionEffect):
    """True x = read x (1 + s), before null bias and hysteresis are taken off.

    Source: calibration error of the transducer (gain).
    Amount s > -1 [-], typical 0.005 to 0.05. Shows as a stretched axis: slopes of flow and pressure gain.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        return eqx.tree_at(lambda c: c.position, so_far, so_far.position * (1.0 + self.amount))


@final
class PressureOffset(AbstractConditionEffect, AbstractReadingEffect):
    """Read dP + o: of the load pressure, read (pressure-gain test) or imposed by the gauge (load-flow test).

    Source: zero error of the differential gauge. The gauges of p_A and p_B are others.
    Amount o [Pa], either sign, typical 0.1e5 to 5e5. Shows in the pressure gain, at every position alike.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        if so_far.load_pressure is None:
            return so_far
        return eqx.tree_at(lambda c: c.load_pressure, so_far, so_far.load_pressure - self.amount)

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        return value + self.amount if channel == "load_pressure" else value
