"""Where else a fit may start: a screened Latin hypercube around the nominal values."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .transforms import Box, free_values


SEED = 20110913
# Candidates lie within so many scales of the nominal: a box is what is possible, the scale what is likely.
REACH = 5.0


def candidate_starts(boxes: Sequence[Box], centre: np.ndarray, count: int) -> np.ndarray:
    """A Latin hypercube (count, n) of physical starts around `centre` (n,), inside the box."""
    generator = np.random.default_rng(SEED)
    middle = free_values(boxes, centre)
    low = np.maximum([box.free(box.lower) for box in boxes], middle - REACH)
    high = np.minimum([box.free(box.upper) for box in boxes], middle + REACH)
    # By hand, because importing scipy.stats.qmc costs more than the whole fit.
    cells = np.column_stack([generator.permutation(count) for _ in boxes])
    places = low + (high - low) * (cells + generator.random(cells.shape)) / count
    return np.array([[box.value(z) for box, z in zip(boxes, row, strict=True)] for row in places])


@eqx.filter_jit
def _costs(residual: Callable[[jax.Array, Any], jax.Array], points: Any, args: Any) -> jax.Array:
    return jax.lax.map(lambda p: jnp.sum(residual(p, args) ** 2), points)


def screened_starts(
    residual: Callable[[jax.Array, Any], jax.Array], boxes: Sequence[Box], args: Any, centre: np.ndarray, count: int
) -> list[np.ndarray]:
    """The candidates with a finite cost, the cheapest first; one or two are not worth compiling a screening for."""
    points = candidate_starts(boxes, centre, count)
    if count <= 2:
        return list(points)
    costs = np.asarray(_costs(residual, points, args))
    order = [i for i in np.argsort(costs, kind="stable") if np.isfinite(costs[i])]
    return [points[i] for i in order]
