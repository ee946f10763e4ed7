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

from .optimality import BELIEVE_BELOW, relative_offset, why_not_optimal
from .start_points import screened_starts
from .transforms import Box, Boxes, free_values
from .trust_region import BoxedLevenbergMarquardt, State


# residual(p, args) -> (m,) whitened residuals; p (n,) physical values in the boxes' order, args a pytree of arrays.
Residual = Callable[[jax.Array, Any], jax.Array]

# both(p, args) -> residual (m,) and its columns (n, m) to p, compiled.
Both = Callable[[jax.Array, Any], tuple[jax.Array, jax.Array]]

# Relative offset at which a solve stops; BELIEVE_BELOW is what the verdict demands.
STOP_AT = 1e-7


@dataclass(frozen=True)
class LeastSquaresResult:
    """Where a solve ended. n parameters, m residuals; plain NumPy.

    `active` is -1 where a parameter sits on its lower limit and the gradient pushes outwards, +1 on its upper, else 0.
    `relative_offset` is the distance from first-order optimality in units of the standard errors of the free ones.
    """

    p: np.ndarray
    z: np.ndarray
    start: np.ndarray  # p where the search began
    cost: float  # sum of squared residuals
    residual: np.ndarray
    jacobian: np.ndarray  # (m, n), with respect to p
    active: np.ndarray
    converged: bool
    message: str
    steps: int  # evaluations of residual and Jacobian after the first
    relative_offset: float
    exhausted: bool = False  # the search ended by itself: no step that it could find lowers the cost


@eqx.filter_jit
def _compiled(residual: Residual, boxes: Boxes, z: Any, args: Any, tolerance: Any, max_steps: int) -> Any:
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
    small = jnp.stack([solution.value, physical, slope, state.size])
    return small, state.at.residual, state.at.columns, state.evaluations, state.done


@eqx.filter_jit
def _begin(z: Any, rows: int) -> State:
    return BoxedLevenbergMarquardt().init(None, z, None, None, jax.ShapeDtypeStruct((rows,), z.dtype), None, None)


@eqx.filter_jit
def _advance(boxes: Boxes, z: Any, state: State, residual: Any, columns: Any, tolerance: Any) -> Any:
    """One step of the search from the residual and the physical columns at its trial point."""
    options = {"lower": boxes.lower, "upper": boxes.upper, "tolerance": tolerance}
    columns = columns * boxes.slope(state.trial)[:, None]
    z, state = BoxedLevenbergMarquardt().advance(z, options, state, residual, columns)
    return z, state, boxes.physical(state.trial)


def _step_by_step(both: Both, boxes: Boxes, z: Any, args: Any, tolerance: Any, max_steps: int) -> Any:
    """The same as `_compiled`, driven from the host: what takes long to compile is compiled alone, in a quarter of the time
    that it takes inside a compiled search."""
    trial = boxes.physical(jnp.asarray(z))
    residual, columns = both(trial, args)
    state: State = _begin(jnp.asarray(z), residual.size)
    for step in range(max_steps):
        if step:
            residual, columns = both(trial, args)
        z, state, trial = _advance(boxes, z, state, residual, columns, tolerance)
        if bool(state.done):
            break
    small = jnp.stack([jnp.asarray(z), boxes.physical(jnp.asarray(z)), boxes.slope(jnp.asarray(z)), state.size])
    return small, state.at.residual, state.at.columns, state.evaluations, state.done


def solve(
    residual: Residual | None,
    boxes: Sequence[Box],
    args: Any = None,
    start: Sequence[float] | np.ndarray | None = None,
    *,
    tolerance: float = STOP_AT,
    max_steps: int = 500,
    both: Both | None = None,
    believe: float = BELIEVE_BELOW,
) -> LeastSquaresResult:
    """Minimise sum(residual(p, args)**2) over the box, from `start` (n,) or the boxes' own starts.

    Compiles once per `residual` (the same function object), number of boxes and shapes of `args`; other data, starts,
    scales and limits reuse it.
    The search stops at the relative offset `tolerance`, or where it cannot get lower. `both`: residual and columns of the
    same problem, compiled by the caller, for one that takes long to compile; the search then runs on the host. `believe`:
    the relative offset up to which an end counts as an optimum, larger where the model is known to a solver's tolerance.
    Raises RuntimeError in single precision. Never raises for a solve that fails: read `converged` and `message`.
    """
    require_float64("a fit")
    names = [box.name for box in boxes]
    began = np.array([box.start for box in boxes] if start is None else start, dtype=float)
    if both is None:
        assert residual is not None
        out = _compiled(residual, Boxes.of(boxes), free_values(boxes, began), args, np.asarray(tolerance), max_steps)
    else:
        out = _step_by_step(both, Boxes.of(boxes), free_values(boxes, began), args, np.asarray(tolerance), max_steps)
    small, values, columns, evaluations, done = jax.device_get(out)
    z, p, slope, size = small
    steps = int(evaluations) - 1
    active = _limits_pressed(boxes, z, columns, values)
    offset, step = relative_offset(columns, values, active == 0)
    trouble = why_not_optimal(names, z, values, columns, size, offset, step, bool(done), steps, believe)
    cost = float(np.sum(values**2))
    jacobian = (columns / slope[:, None]).T
    message = trouble or f"converged in {steps} steps"
    if not trouble and offset > believe:
        message += "; the model meets the readings to rounding, so their scatter says nothing about errors"
    return LeastSquaresResult(
        p, z, began, cost, values, jacobian, active, not trouble, message, steps, offset, bool(done)
    )


def _limits_pressed(boxes: Sequence[Box], z: np.ndarray, columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """-1 or +1 where z sits on its lower or upper limit and the cost would fall beyond it, else 0."""
    slope = np.einsum("im,m->i", columns, residual)
    low = (z <= [box.free(box.lower) for box in boxes]) & (slope > 0.0)
    high = (z >= [box.free(box.upper) for box in boxes]) & (slope < 0.0)
    return high.astype(int) - low.astype(int)


def multi_start(
    residual: Residual,
    boxes: Sequence[Box],
    args: Any = None,
    starts: Sequence[np.ndarray] = (),
    *,
    count: int = 4,
    candidates: int = 16,
    tolerance: float = STOP_AT,
    believe: float = BELIEVE_BELOW,
    progress: Callable[[str], None] | None = None,
) -> list[LeastSquaresResult]:
    """Solve from `starts` (default: the boxes' own) and from the best screened candidates, `count` solves in all.

    All outcomes, the best first: converged before not converged, then by cost. One compiled solve in a Python loop, so
    that one bad start cannot spoil the others and each can be reported. Candidates are a Latin hypercube with a fixed
    seed, ranked by one evaluation of their cost; those without a finite cost are dropped.
    """
    require_float64("a fit")
    begin = list(starts) or [np.array([box.start for box in boxes])]
    missing = count - len(begin)
    if missing > 0:
        begin += screened_starts(residual, boxes, args, begin[0], candidates)[:missing]
    outcomes = []
    for number, start in enumerate(begin[: max(count, 1)], start=1):
        if progress is not None:
            progress(f"start {number} of {min(len(begin), max(count, 1))}")
        outcomes.append(
            solve(
                residual,
                boxes,
                args,
                start,
                tolerance=tolerance,
                believe=believe,
            )
        )
    return sorted(outcomes, key=lambda o: (not o.converged, o.cost if np.isfinite(o.cost) else np.inf))


def near_best(outcomes: Sequence[LeastSquaresResult], difference: float = 0.1) -> list[LeastSquaresResult]:
    """The converged outcomes whose cost lies within `difference` (in chi-square) of the best one's."""
    ended = [outcome for outcome in outcomes if outcome.converged]
    lowest = min((outcome.cost for outcome in ended), default=np.inf)
    return [outcome for outcome in ended if outcome.cost <= lowest + difference]
