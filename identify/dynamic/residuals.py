"""Residuals and their columns from a simulator's readings: weighted, masked, whitened if need be, priors last."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..parameters import ParameterPlan
from ..record import DynamicTest
from .simulator import DynamicSimulator, Key


Whiten = Callable[[Key, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Weighing:
    """weight {key: (rows,)}, 1/standard deviation and 0 where a row is masked out; pad: rows that a channel is padded to.

    whiten(key, (entries, rows)): makes correlated noise white along the last axis; None where it is taken for white.
    """

    weight: Mapping[Key, np.ndarray]
    pad: Callable[[int], int] = lambda rows: rows
    whiten: Whiten | None = None


def both_of(
    simulator: DynamicSimulator,
    names: tuple[str, ...],
    effects: tuple[str, ...],
    weighing: Weighing,
    plans: Sequence[ParameterPlan],
) -> Callable[[Any, Any], tuple[Any, Any]]:
    """A function (p, args) -> residuals (m,) and columns (entries, m), as `least_squares.solve` takes it.

    names, effects: what `p` holds. plans: of `names`, for their priors; each makes one row behind all readings.
    """
    value = np.array([plan.prior.value if plan.prior else plan.start for plan in plans])
    tightness = np.array([1.0 / plan.prior.std if plan.prior else 0.0 for plan in plans])

    def both(p: Any, args: Any) -> tuple[Any, Any]:
        del args
        vector = np.asarray(p, dtype=float)
        found = simulator.read(names, effects, vector)
        parts, columns = [], []
        for key, test, reading in readings_of(simulator.tests):
            weight = weighing.weight[key]
            rows = np.concatenate([(found.values[key] - reading)[None], found.slopes[key]]) * weight
            rows = np.where(weight > 0.0, rows, 0.0)  # a masked row may hold NaN
            if weighing.whiten is not None:
                rows = weighing.whiten(key, rows)
            rows = np.pad(rows, ((0, 0), (0, weighing.pad(test.rows) - test.rows)))
            parts.append(rows[0])
            columns.append(rows[1:])
        prior = np.zeros((len(vector), len(plans)))
        prior[: len(plans)] = np.diag(tightness)
        parts.append((vector[: len(plans)] - value) * tightness)
        return jnp.asarray(np.concatenate(parts)), jnp.asarray(np.concatenate([*columns, prior], axis=1))

    return both


def readings_of(tests: Mapping[str, DynamicTest]) -> list[tuple[Key, DynamicTest, np.ndarray]]:
    """Every measured channel: key, test, readings (rows,), in the order of the residuals."""
    return [((name, c.name), test, c.value) for name, test in tests.items() for c in test.channels]
