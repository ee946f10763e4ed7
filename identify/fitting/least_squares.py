"""Minimise a sum of squares inside a box, from one or several starts, and judge on the host whether the end is an optimum.

The search is `trust_region`'s, compiled once per residual; a problem that takes long to compile is driven step by step. No flag
of a solver is trusted: the end is judged in double precision by the relative offset of residual and Jacobian, in standard
errors (Bates and Watts, "A relative offset orthogonality convergence criterion for nonlinear least squares", Technometrics 23,
1981). Further starts are a Latin hypercube around the nominal values, screened by their cost.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from thermohyd.numerics import quickly, require_float64

from .boxes import Box, Boxes, free_values
from .trust_region import (
    BoxedLevenbergMarquardt,
    Linearisation,
    State,
    fall_of_cost,
    gram_schmidt,
    reduced_on_host,
)


# Their criterion, in units of the parameters' own standard errors: an optimum missed by a thousandth of one.
BELIEVE_BELOW = 1e-3
# An end this near to an optimum counts as one too, with a note: a third of an error bar is no reason to give none. No search stops for it.
NEARLY = 0.3
# A column that shrank by this much between its largest and its last value: the search left the region where it acts.
VANISHED = 1e-7


def relative_offset(columns: np.ndarray, residual: np.ndarray, free: np.ndarray) -> tuple[float, np.ndarray]:
    """Bates and Watts' relative offset over the `free` rows of `columns` (n, m), and the Gauss-Newton step (n,).

    QR of [J r] once more, in NumPy: an independent look at what the compiled solver reports.
    """
    n, m = columns.shape
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(residual))):
        return np.inf, np.zeros(n)
    lengths = np.sqrt(np.sum(columns**2, axis=1))
    chosen = np.flatnonzero(free & (lengths > 0.0))
    count = len(chosen)
    _, triangle = gram_schmidt(np.vstack([columns[chosen] / lengths[chosen, None], residual[None, :]]).T)
    step = np.zeros(n)
    if not count:
        return 0.0, step
    left, values, right = np.linalg.svd(triangle[:count, :count])
    alive = values > count * np.finfo(float).eps * values[0]
    loads = left.T[alive] @ triangle[:count, count]
    step[chosen] = -(right[alive].T @ (loads / values[alive])) / lengths[chosen]
    spread = triangle[count, count] ** 2 / max(m - count, 1)
    return float(np.sqrt(np.sum(loads**2) / max(int(alive.sum()), 1) / max(spread, 1e-300))), step


def why_not_optimal(
    names: list[str],
    z: np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray,
    size: np.ndarray,
    offset: float,
    step: np.ndarray,
    done: bool,
    steps: int,
    believe: float = BELIEVE_BELOW,
) -> str:
    """Why this end is no optimum, in words; empty where it is one: within `believe` standard errors."""
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
    if offset <= believe or np.all(np.abs(step) <= 1e-8 * (1.0 + np.abs(z))):
        return ""
    ending = "it cannot get any lower" if done else f"the limit of {steps} steps was reached"
    return f"{ending}, yet the slope is not zero (still {offset:.2g} standard errors from an optimum)"


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


@quickly
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


# residual(p, args) -> (m,) whitened residuals; p (n,) physical values in the boxes' order, args a pytree of arrays.
Residual = Callable[[jax.Array, Any], jax.Array]

# both(p, args) -> residual (m,) and its columns (n, m) to p (n,), NumPy or `Columns`.
Both = Callable[[np.ndarray, Any], tuple[Any, Any]]


class Columns:
    """Columns (n, m) that are worked out when they are asked for: a search needs those of its free variables at every trial, and the others
    where it ends. In NumPy's hands it is an array; `columns[numbers]` gives some of them."""

    def __init__(self, count: int, work_out: Callable[[np.ndarray], np.ndarray]) -> None:
        """work_out: numbers (k,) of columns -> (k, m)."""
        self._count, self._work_out = count, work_out

    def __getitem__(self, numbers: np.ndarray) -> np.ndarray:
        return self._work_out(np.asarray(numbers, dtype=int))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        found = self._work_out(np.arange(self._count))
        return found if dtype is None else found.astype(dtype, copy=False)


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
    nearly: bool = False  # not converged, and only for a slope of `NEARLY` standard errors at most


@quickly
def _compiled(residual: Residual, boxes: Boxes, z: Any, args: Any, tolerance: Any, max_steps: int, enough: Any) -> Any:
    """The whole solve in one program; all but `residual` and `max_steps` are data."""
    solution = optx.least_squares(
        lambda z, args: residual(boxes.physical(z), args),
        BoxedLevenbergMarquardt(),
        z,
        args,
        options={"lower": boxes.lower, "upper": boxes.upper, "tolerance": tolerance, "enough": enough},
        max_steps=max_steps,
        throw=False,
    )
    state = solution.state
    physical, slope = boxes.physical(solution.value), boxes.slope(solution.value)
    small = jnp.stack([solution.value, physical, slope, state.size])
    return small, state.residual, state.columns, state.evaluations, state.done


# A search is left where it is once this many more steps, each as good as the better of its last two, would not bring what is asked of
# it: as many as a short look has (`search.GLANCE`). Steps grow smaller as a rule.
FURTHER = 15


def not_worth_while(costs: Sequence[float], goal: float, worth: float) -> bool:
    """Whether a search that went down through these costs will not come to `goal`, or will not fall by another `worth`."""
    if len(costs) < 3:
        return False
    return FURTHER * max(costs[-3] - costs[-2], costs[-2] - costs[-1]) < max(costs[-1] - goal, worth)


# Variables of a search that is driven from the host come in multiples of this, so that all searches share few programs.
VARIABLES = 8


@quickly
def _begin(z: Any) -> State:
    return BoxedLevenbergMarquardt().init(None, z, None, None, jax.ShapeDtypeStruct((0,), z.dtype), None, None)


@quickly
def _advance(
    boxes: Boxes, z: Any, state: State, gained: Any, finite: Any, reduced: Linearisation, tolerance: Any, enough: Any
) -> Any:
    """One step of the search from the linearisation at its trial point: (z, state, the next trial, its physical slopes)."""
    options = {"lower": boxes.lower, "upper": boxes.upper, "tolerance": tolerance, "enough": enough}
    z, state = BoxedLevenbergMarquardt().advance(z, options, state, gained, finite, lambda: reduced)
    return z, state, boxes.physical(state.trial), boxes.slope(state.trial)


def _step_by_step(
    both: Both,
    boxes: Sequence[Box],
    z: np.ndarray,
    args: Any,
    tolerance: Any,
    max_steps: int,
    enough: Any,
    goal: float,
    worth: float,
) -> Any:
    """The same as `_compiled`, driven from the host: what takes long to compile is compiled alone, in a quarter of the time
    that it takes inside a compiled search. Rows and held variables are no matter of the step: one small program serves all."""
    moving = np.array([i for i, box in enumerate(boxes) if not box.held], dtype=int)
    n = len(moving)
    size = max(-(-n // VARIABLES), 1) * VARIABLES
    idle = Box("", 0.0, 1.0, 0.0, 0.0, held=True)
    own = Boxes.of([*(boxes[i] for i in moving), *[idle] * (size - n)])
    everything = Boxes.of(boxes)
    free: Any = np.append(np.asarray(z, dtype=float)[moving], np.zeros(size - n))
    p, slope = everything.physical(np.asarray(z, dtype=float)), own.slope(free)
    state: State = _begin(free)
    kept: tuple[np.ndarray, Any] | None = None
    costs: list[float] = []
    for _ in range(max_steps):
        residual, columns = both(p.copy(), args)
        residual, freed = np.asarray(residual), np.asarray(columns[moving])
        gained = np.asarray(0.0 if kept is None else fall_of_cost(kept[0], residual))
        reduced = reduced_on_host(freed * slope[:n, None], residual, size)
        finite = np.asarray(np.all(np.isfinite(residual)) and np.all(np.isfinite(freed)))
        free, state, trial, slopes = _advance(own, free, state, gained, finite, reduced, tolerance, enough)
        accepted, done, trial, slope = jax.device_get((state.accepted, state.done, trial, slopes))
        if kept is None or accepted:
            kept = residual, columns
            costs.append(float(residual @ residual))
        p[moving] = trial[:n]
        if done or not_worth_while(costs, goal, worth):
            break
    assert kept is not None
    end = np.array(z, dtype=float)
    end[moving] = np.asarray(free)[:n]
    residual, columns = kept
    columns = np.asarray(columns) * everything.slope(end)[:, None]
    lengths = np.sqrt(np.sum(columns**2, axis=1))
    lengths[moving] = np.asarray(state.size)[:n]
    small = np.stack([end, everything.physical(end), everything.slope(end), lengths])
    return small, residual, columns, state.evaluations, state.done


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
    enough: float = np.inf,
    goal: float = np.inf,
    worth: float = 0.0,
) -> LeastSquaresResult:
    """Minimise sum(residual(p, args)**2) over the box, from `start` (n,) or the boxes' own starts.

    Compiles once per `residual` (the same function object), number of boxes and shapes of `args`; other data, starts,
    scales and limits reuse it.
    The search stops at the relative offset `tolerance`, or where it cannot get lower. `both`: residual and columns of the
    same problem, compiled by the caller, for one that takes long to compile; the search then runs on the host. `believe`:
    the relative offset up to which an end counts as an optimum, larger where the model is known to a solver's tolerance.
    enough: the cost below which a search must promise to end, or it is given up on the way. goal: likewise, by how fast it goes
    down, whether or not it is near an optimum; worth: the fall for which alone it goes on (`not_worth_while`); both of a search
    on the host.
    Raises RuntimeError in single precision. Never raises for a solve that fails: read `converged` and `message`.
    """
    require_float64("a fit")
    began = np.array([box.start for box in boxes] if start is None else start, dtype=float)
    begin, limits = free_values(boxes, began), (np.asarray(tolerance), max_steps, np.asarray(enough))
    if both is None:
        assert residual is not None
        out = _compiled(residual, Boxes.of(boxes), begin, args, *limits)
    else:
        out = _step_by_step(both, boxes, begin, args, *limits, goal, worth)
    return judged(boxes, began, jax.device_get(out), believe)


def judged(boxes: Sequence[Box], began: np.ndarray, out: Any, believe: float = BELIEVE_BELOW) -> LeastSquaresResult:
    """What a search left, and whether its end is an optimum.

    out: z, p, dp/dz and the largest column lengths (4, n); residual (m,); its columns to z (n, m); evaluations; done. NumPy.
    """
    names = [box.name for box in boxes]
    small, values, columns, evaluations, done = out
    z, p, slope, size = small
    steps = int(evaluations) - 1
    active = _limits_pressed(boxes, z, columns, values)
    offset, step = relative_offset(columns, values, active == 0)
    trouble = why_not_optimal(names, z, values, columns, size, offset, step, bool(done), steps, believe)
    almost = trouble and not why_not_optimal(names, z, values, columns, size, offset, step, bool(done), steps, NEARLY)
    cost = float(np.sum(values**2))
    jacobian = (columns / slope[:, None]).T
    message = trouble or f"converged in {steps} steps"
    if not trouble and offset > believe:
        message += "; the model meets the readings to rounding, so their scatter says nothing about errors"
    return LeastSquaresResult(
        p, z, began, cost, values, jacobian, active, not trouble, message, steps, offset, bool(done), bool(almost)
    )


def as_converged(result: LeastSquaresResult) -> LeastSquaresResult:
    """The same result, believed where only a slope of `NEARLY` standard errors at most is in the way; its message says so."""
    if result.converged or not result.nearly:
        return result
    message = f"converged to {result.relative_offset:.2g} standard errors in {result.steps} steps"
    return replace(result, converged=True, message=message)


def _limits_pressed(boxes: Sequence[Box], z: np.ndarray, columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """-1 or +1 where z sits on its lower or upper limit and the cost would fall beyond it, else 0."""
    slope = np.einsum("im,m->i", columns, residual)
    low = (z <= [box.free(box.lower) for box in boxes]) & (slope > 0.0)
    high = (z >= [box.free(box.upper) for box in boxes]) & (slope < 0.0)
    return high.astype(int) - low.astype(int)


# `solve` with its first four arguments and `tolerance`, `believe`, `enough` by name.
Solver = Callable[..., LeastSquaresResult]


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
    solver: Solver = solve,
) -> list[LeastSquaresResult]:
    """Solve from `starts` (default: the boxes' own) and from the best screened candidates, `count` solves in all.

    All outcomes, the best first: converged before not converged, then by cost. One compiled solve in a Python loop, so
    that one bad start cannot spoil the others and each can be reported. Candidates are a Latin hypercube with a fixed
    seed, ranked by one evaluation of their cost; those without a finite cost are dropped. solver: `solve`, or what calls it.
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
            solver(
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
