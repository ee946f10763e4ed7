"""Errors of the bench's instruments: thermometer, position transducer, differential pressure gauge, flowmeter.

A flowmeter acts on every flow channel: first its lag, then its scale, then its offset.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.numerics import linear_recursion
from thermohyd.oil import Oil

from .effect import AbstractConditionEffect, AbstractReadingEffect, as_amount


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


PRESSURE_CHANNELS = frozenset({"load_pressure", "pressure_a", "pressure_b"})


@final
class LoadPressureScale(AbstractConditionEffect, AbstractReadingEffect):
    """Read dP (1 + s), before the gauge's offset: of the load pressure, read or imposed, or of p_A and p_B where both are read.

    Source: calibration error of the pressure gauge (gain), stated as a share of the reading.
    Amount s > -1 [-], typical 0.002 to 0.03. Shows in the pressure gain, in proportion to it.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 10  # of an imposed pressure the offset comes off first
    reads_at: ClassVar[int | None] = -10

    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        if so_far.load_pressure is None:
            return so_far
        return eqx.tree_at(lambda c: c.load_pressure, so_far, so_far.load_pressure / (1.0 + self.amount))

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        return value * (1.0 + self.amount) if channel in PRESSURE_CHANNELS else value


FLOW_CHANNELS = frozenset({"leakage_flow", "supply_flow", "flow"})


@final
class FlowmeterOffset(AbstractReadingEffect):
    """Read Q + q0.

    Source: zero error of the meter, stated as a share of full scale.
    Amount q0 [m3/s], either sign, typical 1e-8 to 1e-6. Shows in the leakage and the flow, at every position alike.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 30
    instrument: ClassVar[bool] = True

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        return value + self.amount if channel in FLOW_CHANNELS else value


@final
class FlowmeterScale(AbstractReadingEffect):
    """Read Q (1 + s).

    Source: calibration error of the meter (viscosity, K-factor).
    Amount s > -1 [-], typical 0.002 to 0.05. Shows in the leakage and the flow, in proportion to them.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 20
    instrument: ClassVar[bool] = True

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        return value * (1.0 + self.amount) if channel in FLOW_CHANNELS else value


def behind_meter(
    flow: Float[Array, " rows"],
    lag: Float[Array, ""],
    time: Float[Array, " rows"],
    run: Float[Array, " rows"] | None,
) -> Float[Array, " rows"]:
    """What a meter of first order shows of a flow: lag [s], time [s]; each run on its own, steady at its start.

    Linear in the flow, and a constant passes unchanged: it may act before or after the meter's scale and offset.
    """
    dt, same_run = jnp.diff(time), jnp.ones(flow.shape[0] - 1, dtype=bool)
    if run is not None:
        same_run = jnp.diff(run) == 0.0
    passes = dt > 0.0
    span = jnp.where(passes, dt, 1.0)
    # Far below dt, where exp(-dt/tau) and its derivative are 0, tau may stand for a larger one: tau = 0 is no pole.
    exponent = span / jnp.maximum(lag, 1e-3 * span)
    held = jnp.where(lag > 0.0, 1.0, 0.0)
    decay = jnp.where(same_run, jnp.where(passes, jnp.exp(-exponent), held), 0.0)
    trail = jnp.where(same_run, jnp.where(passes, -jnp.expm1(-exponent) * lag / span, held), 0.0)
    deviation = linear_recursion(decay, -trail * jnp.diff(flow))
    return flow + jnp.concatenate([jnp.zeros(1), deviation])


@final
class FlowmeterLag(AbstractReadingEffect):
    """tau dQ_read/dt = Q - Q_read along every run, exact for a flow that is linear between rows; a run starts steady.

    Source: a first-order instrument (damping of the meter, volume of its line). The rows of a run stand together, in the
    order of time; rows at one and the same time read alike. The deviation d = Q_read - Q obeys
    d_i = a d_(i-1) - (1 - a) tau (Q_i - Q_(i-1))/dt with a = exp(-dt/tau), a linear recursion.
    Amount tau >= 0 [s], typical 0.05 to 2. Shows as a loop in flow and leakage that widens with the rate of the sweep.
    A reading depends on the rows before it: not row by row. Raises ValueError where the conditions have no time.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    order: ClassVar[int] = 10
    instrument: ClassVar[bool] = True
    rowwise: ClassVar[bool] = False

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        if channel not in FLOW_CHANNELS:
            return value
        if read.time is None:
            raise ValueError("flowmeter_lag needs conditions with the time of every row")
        return behind_meter(value, self.amount, read.time, read.run)
