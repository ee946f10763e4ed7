"""A valve as plain numbers: what a fit found or a record states, and what `simulate` needs. No JAX."""

from dataclasses import dataclass, field

import numpy as np

from ..oil_definition import OilDefinition
from .diagnosis.variation_terms import LearnedTerm
from .record import ValveData


@dataclass(frozen=True)
class Model:
    """A fitted (or nominal) valve, SI. `covariance` is over `free`, in that order, which may name effects as well.

    effects: {name in `thermohyd.effects.registry`: amount}. learned: smooth empirical terms, which are no physics.
    """

    valve: ValveData
    oil: OilDefinition
    parameters: dict[str, float]
    free: tuple[str, ...] = ()
    covariance: np.ndarray | None = None
    effects: dict[str, float] = field(default_factory=dict)
    learned: tuple[LearnedTerm, ...] = ()

    def value(self, name: str) -> float:
        """A parameter's value or an effect's amount."""
        return self.effects[name] if name in self.effects else self.parameters[name]
