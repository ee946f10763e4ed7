"""A valve as plain numbers: what a fit found or a record states, and what `simulate` needs. No JAX."""

from dataclasses import dataclass, field

import numpy as np

from thermohyd.identify.bench.record import ActuatorData, ValveData
from thermohyd.oil_definition import OilDefinition

from .learned_terms import LearnedTerm
from .typed_terms import TypedTerm


# {test: {quantity: (least, greatest)}} of the rows that a model was fitted to, SI.
Ranges = dict[str, dict[str, tuple[float, float]]]


@dataclass(frozen=True)
class Model:
    """A fitted (or nominal) valve, SI. `covariance` is over `free`, in that order, which may name effects as well.

    actuator, dynamics: the jack as its record describes it, and the parameters of motion; of a record with dynamic tests.
    effects: {name in `thermohyd.effects.library`: amount}. learned: smooth and typed terms, empirical: no cause.
    sensors: {name: gain or zero that a fit found of a sensor}, SI per signal, and signals.
    fitted: where its tests were run (`fitted_range.QUANTITIES`); empty where nobody says.
    """

    valve: ValveData
    oil: OilDefinition
    parameters: dict[str, float]
    free: tuple[str, ...] = ()
    covariance: np.ndarray | None = None
    effects: dict[str, float] = field(default_factory=dict)
    learned: tuple[LearnedTerm | TypedTerm, ...] = ()
    actuator: ActuatorData | None = None
    dynamics: dict[str, float] = field(default_factory=dict)
    fitted: Ranges = field(default_factory=dict)
    sensors: dict[str, float] = field(default_factory=dict)

    def value(self, name: str) -> float:
        """A parameter's value or an effect's amount."""
        for table in (self.effects, self.dynamics, self.sensors):
            if name in table:
                return table[name]
        return self.parameters[name]

    def joint_covariance(self) -> np.ndarray | None:
        """Of `free`, then of the coefficients of every typed term whose own is known; None where the model has none."""
        matrix = self.covariance
        if matrix is None:
            return None
        for term in self.learned:
            if not isinstance(term, TypedTerm) or not term.covariance:
                continue
            none = (0.0,) * len(term.coefficients)
            cross = np.array([term.with_parameters.get(name, none) for name in self.free]).reshape(
                len(self.free), len(none)
            )
            cross = np.concatenate([cross, np.zeros((len(matrix) - len(self.free), len(none)))])
            matrix = np.block([[np.asarray(matrix), cross], [cross.T, np.array(term.covariance)]])
        return matrix


def coefficient_names(number: int, term: TypedTerm) -> tuple[str, ...]:
    """What the coefficients of the model's typed term `number`, from 0, are called."""
    return tuple(f"term {number + 1} coefficient {k + 1}" for k in range(len(term.coefficients)))
