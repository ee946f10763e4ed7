"""How an effect joins the model: by wrapping one stage of the computation, never by touching the core law.

A static test runs through fixed stages. An effect is a frozen Module that transforms what passes at its stage; which
effects a valve has is known while tracing, so one that is absent is not even compiled.

    conditions as read -> [conditions] -> [null] -> oil -> [oil] -> edges -> [edges] ->
        balance <-> [lines, crossing, inflow, storage] -> [readings]

The stages are abstract classes with one method each; a concrete effect is final and carries one `amount` (neutral 0).
It belongs to one stage, or to two where one instrument both sets an operating point and reads (`pressure_offset`).
Two more stages, of an actuator in motion, are in `thermohyd.dynamics.machine`.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.edge import MeteringEdge
from thermohyd.oil import Oil


class Edges(eqx.Module):
    """The four edges as two pairs: P-A with P-B, and A-T with B-T. Fields of shape (2, 1) tell port A from port B."""

    supply: MeteringEdge
    return_: MeteringEdge


def as_amount(value: float | Array) -> Array:
    """Converter of an effect's amount: a float array of the default precision."""
    return jnp.asarray(value, dtype=jnp.result_type(float))


class AbstractEffect(eqx.Module):
    """One physical effect with one parameter whose neutral value, 0, switches it off exactly.

    The amount is one number, or one per row of a test (a smooth term, a derivative taken row by row).
    `order`: among the effects of a stage, lower ones act first; effects of equal order commute.
    `rowwise`: whether a reading still depends on the parameters through its own row only (see `valve.rowwise`).
    `stage`: where it acts. `dynamic`: whether only an actuator in motion shows it.
    `small_signal`: whether it has a small-signal response; what passes no small motion at all has none.
    `remembers`: whether, in motion, it goes with which way the spool's command went last, which the machine then keeps in a state.
    `stated_at`: temperature [K] at which the amount holds, where the oil's viscosity carries it to others.
    """

    amount: eqx.AbstractVar[Float[Array, "..."]]
    order: ClassVar[int] = 0
    rowwise: ClassVar[bool] = True
    stage: ClassVar[str] = ""
    dynamic: ClassVar[bool] = False
    small_signal: ClassVar[bool] = True
    remembers: ClassVar[bool] = False
    stated_at: ClassVar[float | None] = None


def in_order(effects: tuple[AbstractEffect, ...]) -> tuple[AbstractEffect, ...]:
    """The same effects in the order in which they act, however they were listed: equal sets share a compiled program."""
    return tuple(sorted(effects, key=lambda effect: (type(effect).order, type(effect).__name__)))


class AbstractConditionEffect(AbstractEffect):
    """What was read is not what the valve saw: the instruments of the operating point."""

    stage: ClassVar[str] = "conditions"

    @abc.abstractmethod
    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        """The conditions `so_far`, corrected for one more effect; `read`: as the instruments gave them."""


class AbstractNullEffect(AbstractEffect):
    """The hydraulic null lies elsewhere than the valve's own `null_bias` says."""

    stage: ClassVar[str] = "null"

    @abc.abstractmethod
    def null_bias(
        self, own: Float[Array, "..."], true: Conditions, null_pressure: Float[Array, "..."] | None
    ) -> Float[Array, "..."]:
        """x0 [m] after one more effect; null_pressure: P_s [Pa, gauge] at which the valve's own x0 holds, None: not stated."""


class AbstractOilEffect(AbstractEffect):
    """The oil is not the one in the table."""

    stage: ClassVar[str] = "oil"

    @abc.abstractmethod
    def oil(self, nominal: Oil) -> Oil: ...

    def oil_at(self, nominal: Oil, true: Conditions) -> Oil:
        """The same where the operating points are known, which an effect may follow: of static tests."""
        del true
        return self.oil(nominal)


class AbstractHeatEffect(AbstractEffect):
    """The oil keeps more of its throttling heat than the valve's own `heat_retention` says."""

    stage: ClassVar[str] = "heat"

    @abc.abstractmethod
    def heat_retention(self, own: Float[Array, "..."]) -> Float[Array, "..."]: ...


class AbstractEdgeEffect(AbstractEffect):
    """The edges differ from the ideal ones; `conditions` are the true ones."""

    stage: ClassVar[str] = "edges"

    @abc.abstractmethod
    def edges(self, ideal: Edges, conditions: Conditions) -> Edges: ...


class AbstractLineEffect(AbstractEffect):
    """Pressure lost between the gauges and the edges, and so a balance of ports and lines together."""

    stage: ClassVar[str] = "lines"

    @abc.abstractmethod
    def losses(
        self, supply_flow: Float[Array, "..."], return_flow: Float[Array, "..."]
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """(drop of the supply, rise of the return) [Pa] at volume flows [m3/s] counted at the gauges, of either sign."""


class AbstractCrossingEffect(AbstractEffect):
    """A path between the ports A and B past the spool, and so a balance of both ports together."""

    stage: ClassVar[str] = "crossing"

    @abc.abstractmethod
    def conductance(self, oil: Oil, conditions: Conditions) -> Float[Array, "..."]:
        """G [m3/(s Pa)] of the volume flow G (p_A - p_B); true oil and true conditions."""


class AbstractInflowEffect(AbstractEffect):
    """A flow that enters a port by no edge: a leak to or from outside, at the port's own pressure."""

    stage: ClassVar[str] = "inflow"

    @abc.abstractmethod
    def inflow(self, pressure: Float[Array, "2 rows"], oil: Oil, conditions: Conditions) -> Float[Array, "2 #rows"]:
        """Volume flows [m3/s] into the ports A and B from outside, below 0: out of them, each counted at its port.

        pressure: of both ports [Pa]. A port's flow may follow that port's own pressure, and must not rise faster with it than
        the edges drain; conditions: the true ones.
        """


class AbstractStorageEffect(AbstractEffect):
    """Oil that a blocked port stores as its pressure rises, and so a balance of each port along the time of a sweep.

    `substeps`: how many steps the time between two rows is cut into where that is needed most; of several effects the most count.
    """

    stage: ClassVar[str] = "storage"
    rowwise: ClassVar[bool] = False
    substeps: eqx.AbstractVar[int]

    @abc.abstractmethod
    def compliance(self) -> Float[Array, "2 #rows"]:
        """dV/dp [m3/Pa] of what is stored at the ports A and B."""


class Coupling(eqx.Module):
    """The effects that tie a valve's balances together: ports to lines, to each other, to what they were before."""

    lines: tuple[AbstractLineEffect, ...]
    crossings: tuple[AbstractCrossingEffect, ...]
    storage: tuple[AbstractStorageEffect, ...] = ()
    inflows: tuple[AbstractInflowEffect, ...] = ()


class AbstractReadingEffect(AbstractEffect):
    """Flow that passes beside the valve, or the instrument that reads it; rows in sweep order, `oil` the true one.

    `instrument`: it is the bench's, and stays there when the valve goes to an actuator. `reads_at`: its place among the
    effects on readings, where that is not `order` (conditions are corrected in the opposite order of what read them).
    One that is not row by row is a filter along the runs: linear in `value` and without change to a constant, so that a
    fit may let it act after all others and send the derivatives through it; of `true` and `oil` it makes no use.
    """

    stage: ClassVar[str] = "readings"
    instrument: ClassVar[bool] = False
    reads_at: ClassVar[int | None] = None

    @abc.abstractmethod
    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]: ...
