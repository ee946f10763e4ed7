"""Least squares inside a box: one compiled solve per residual, and a verdict on the host that trusts no flag."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from thermohyd.precision import require_float64

from .transforms import Box, Boxes, free_values
from .trust_region import BoxedLevenbergMarquardt


# residual(p, args) -> (m,) whitened residuals; p (n,) physical values in the order of the boxes, args a pytree of arrays.
Residual = Callable[[jax.Array, Any], jax.Array]

# Relative offset (Bates and Watts 1981): distance from the optimum in units of the parameters' own standard errors.
STOP_AT = 1e-7
BELIEVE_BELOW = 1e-3  # their criterion: an optimum missed by a thousandth of its standard error
# A column that shrank by this much between its largest and its last value: the search left the region where it acts.
VANISHED = 1e-7


@dataclass(frozen=True)
class LeastSquaresResult:
    """Where a solve ended. n parameters, m residuals; plain NumPy.

    `active` is -1 where a parameter sits on its lower limit and the gradient pushes outwards, +1 on its upper, else 0.
    `relative_offset` is the distance from first-order optimality in units of the standard errors of the free ones.
    """

    p: np.ndarray
    z: np.ndarray
    cost: float  # sum of squared residuals
    residual: np.ndarray
    jacobian: np.ndarray  # (m, n), with respect to p
    active: np.ndarray
    converged: bool
    message: str
    steps: int  # evaluations of residual and Jacobian after the first
    relative_offset: float


@eqx.filter_jit
def _compiled(residual: Residual, boxes: Boxes, z: jax.Array, args: Any, tolerance: jax.Array, max_steps: int) -> Any:
    """The whole solve in one program; `boxes`, `z`, `args` and `tolerance` are data."""
    solution = optx.least_squares(
        lambda z, args: residual(boxes.physical(z), args),
        BoxedLevenbergMarquardt(),
        z,
        args,
        options={"lower": boxes.lower, "upper": boxes.upper, "tolerance": tolerance},
        max_steps=max_steps,
        throw=False,
    )
    state = solution.state
    physical, slope = boxes.physical(solution.value), boxes.slope(solution.value)
    small = jnp.stack([solution.value, physical, slope, state.size, state.held.astype(slope.dtype)])
    return small, state.at.residual, state.at.columns, state.evaluations, state.done


def solve(
    residual: Residual,
    boxes: Sequence[Box],
    args: Any = None,
    start: Sequence[float] | np.ndarray | None = None,
    *,
    tolerance: float = STOP_AT,
    max_steps: int = 500,
) -> LeastSquaresResult:
    """Minimise sum(residual(p, args)**2) over the box, from `start` (n,) or the boxes' own starts.

    Compiles once per `residual` (the same function object), number of boxes and shapes of `args`; other data, starts,
    scales and limits reuse it. Raises RuntimeError in single precision. Never raises for a solve that fails: read
    `converged` and `message`.
    """
    require_float64("a fit")
    names = [box.name for box in boxes]
    z = free_values(boxes, [box.start for box in boxes] if start is None else start)
    out = _compiled(residual, Boxes.of(boxes), jnp.asarray(z), args, jnp.asarray(tolerance), max_steps)
    small, values, columns, evaluations, done = jax.device_get(out)
    z, p, slope, size, held = small
    steps = int(evaluations) - 1
    active = np.where(held > 0, np.where(z >= [box.free(box.upper) for box in boxes], 1, -1), 0)
    offset, step = relative_offset(columns, values, active == 0)
    trouble = _trouble(names, z, values, columns, size, offset, step, bool(done), steps)
    cost = float(np.sum(values**2))
    jacobian = (columns / slope[:, None]).T
    message = trouble or f"converged in {steps} steps"
    if not trouble and offset > BELIEVE_BELOW:
        message += "; the model meets the readings to rounding, so their scatter says nothing about errors"
    return LeastSquaresResult(p, z, cost, values, jacobian, active, not trouble, message, steps, offset)


def relative_offset(columns: np.ndarray, residual: np.ndarray, free: np.ndarray) -> tuple[float, np.ndarray]:
    """Bates and Watts' relative offset over the `free` rows of `columns` (n, m), and the Gauss-Newton step (n,), float64.

    Modified Gram-Schmidt of [J r] once more, in NumPy: an independent look at what the compiled solver reports.
    """
    n, m = columns.shape
    lengths = np.sqrt(np.sum(columns**2, axis=1))
    chosen = np.flatnonzero(free & (lengths > 0.0))
    rest = np.vstack([columns[chosen] / lengths[chosen, None], residual[None, :]])
    count = len(chosen)
    triangle = np.zeros((count, count + 1))
    for k in range(count):
        length = np.sqrt(np.sum(rest[k] ** 2))
        unit = rest[k] / (length if length > 0.0 else 1.0)
        triangle[k, k:] = np.einsum("im,m->i", rest[k:], unit)
        rest[k:] -= triangle[k, k:, None] * unit
    step = np.zeros(n)
    if not count or not np.all(np.isfinite(triangle)):
        return (0.0 if not count else np.inf), step
    left, values, right = np.linalg.svd(triangle[:, :count])
    alive = values > count * np.finfo(float).eps * values[0]
    loads = left.T[alive] @ triangle[:, count]
    step[chosen] = -(right[alive].T @ (loads / values[alive])) / lengths[chosen]
    spread = np.sum(rest[-1] ** 2) / max(m - count, 1)
    return float(np.sqrt(np.sum(loads**2) / max(int(alive.sum()), 1) / max(spread, 1e-300))), step


def _trouble(
    names: list[str],
    z: np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray,
    size: np.ndarray,
    offset: float,
    step: np.ndarray,
    done: bool,
    steps: int,
) -> str:
    """Why this end is no optimum, in words; empty where it is one."""
    if not np.all(np.isfinite(residual)):
        bad = int(np.sum(~np.isfinite(residual)))
        return f"the model gives no finite value at the start for {bad} of {len(residual)} readings"
    rough = [name for name, column in zip(names, columns, strict=True) if not np.all(np.isfinite(column))]
    if rough:
        return f"the model has no finite derivative at the start for {', '.join(rough)}"
    lengths = np.sqrt(np.sum(columns**2, axis=1))
    lost = [name for name, now, most in zip(names, lengths, size, strict=True) if most > 0 and now < VANISHED * most]
    if lost:
        return f"the search ended where the readings no longer depend on {', '.join(lost)}"
    # Where the model meets the data exactly, only rounding is left to be orthogonal: the step then decides.
    if offset <= BELIEVE_BELOW or np.all(np.abs(step) <= 1e-8 * (1.0 + np.abs(z))):
        return ""
    ending = "it cannot get any lower" if done else f"the limit of {steps} steps was reached"
    return f"{ending}, yet the slope is not zero (still {offset:.2g} standard errors from an optimum)"
