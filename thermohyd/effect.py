"""How an effect joins the model: by wrapping one stage of the computation, never by touching the core law.

A static test runs through fixed stages. An effect is a frozen Module that belongs to exactly one of them and transforms
what passes there; which effects a valve has is known while tracing, so one that is absent is not even compiled.

    conditions as read -> [conditions] -> oil -> [oil] -> edges -> [edges] -> balance <-> [passages, ports] -> reading -> [readings]

The stages are abstract classes with one method each; a concrete effect is final and carries one `amount` (neutral 0).
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from .conditions import Conditions
from .edge import MeteringEdge
from .oil import Oil


class Edges(eqx.Module):
    """The four edges as two pairs: P-A with P-B, and A-T with B-T. Fields of shape (2, 1) tell port A from port B."""

    supply: MeteringEdge
    return_: MeteringEdge


class AbstractEffect(eqx.Module):
    """One physical effect with one parameter whose neutral value, 0, switches it off exactly."""

    amount: eqx.AbstractVar[Float[Array, ""]]


class AbstractConditionEffect(AbstractEffect):
    """What was read is not what the valve saw: the instruments of the operating point."""

    @abc.abstractmethod
    def true_conditions(self, read: Conditions) -> Conditions: ...


class AbstractOilEffect(AbstractEffect):
    """The oil is not the one in the table."""

    @abc.abstractmethod
    def oil(self, nominal: Oil) -> Oil: ...


class AbstractEdgeEffect(AbstractEffect):
    """The edges differ from the ideal ones; `conditions` are the true ones."""

    @abc.abstractmethod
    def edges(self, ideal: Edges, conditions: Conditions) -> Edges: ...


class AbstractReadingEffect(AbstractEffect):
    """Flow that passes beside the valve, or the instrument that reads it; `conditions` are as read, in sweep order."""

    @abc.abstractmethod
    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]: ...
