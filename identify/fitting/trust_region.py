"""Moré's Levenberg-Marquardt inside a box, as an optimistix solver.

optimistix's own LevenbergMarquardt starts from a damping of one without Marquardt's scaling, knows no bounds and stops
on small steps only. What a fit of weakly determined parameters needs instead: a trust region in column-scaled
variables, so that the weak directions take full Gauss-Newton steps at once; bounds that are reached exactly and left
again when the gradient says so; an end that is judged by orthogonality of residual and Jacobian.

Each linearisation is kept as the triangle of a QR of [J r], by modified Gram-Schmidt without LAPACK; from it come the damped
step, the step inside the box and the full Gauss-Newton step.

Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978 (scaling, trust region, damping, update rules).
Bates and Watts, "A relative offset orthogonality convergence criterion for nonlinear least squares",
Technometrics 23, 1981.
Björck, "Solving linear least squares problems by Gram-Schmidt orthogonalization", BIT 7, 1967: of [J r] it is stable.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree, Scalar


class Linearisation(NamedTuple):
    """The problem at a point as far as a step needs it: R of J = Q R (m, n), c = Q'r, the cost r'r, and m."""

    triangle: Float[Array, "n n"]
    projection: Float[Array, " n"]
    cost: Float[Array, ""]
    rows: Float[Array, ""]


def triangular(columns: Float[Array, "n m"], residual: Float[Array, " m"]) -> tuple[Array, Array]:
    """R (n, n) and Q'r (n,) by modified Gram-Schmidt of [J r].

    Not LAPACK: its threads take 0.1 to 15 ms for 3000 rows where other threads run, this 0.09 ms. Not the normal
    equations: they square the condition number, and a valve's weak directions stand at 1e3 to 1e6.
    """
    n = columns.shape[0]

    def sweep(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        rest, triangle = carry
        length = jnp.sqrt(jnp.sum(rest[k] ** 2))
        unit = rest[k] / jnp.where(length > 0.0, length, 1.0)
        row = jnp.where(jnp.arange(n + 1) >= k, jnp.sum(rest * unit, axis=1), 0.0)
        return rest - row[:, None] * unit, triangle.at[k].set(row)

    start = jnp.concatenate([columns, residual[None, :]]), jnp.zeros((n, n + 1), columns.dtype)
    _, triangle = jax.lax.fori_loop(0, n, sweep, start)
    return triangle[:, :n], triangle[:, n]


def damped_step(triangle: Array, projection: Array, size: Array, radius: Array) -> Array:
    """s minimising |R s + c| under |D s| <= radius, D = diag(size), by Moré's iteration on the singular values."""
    left, values, right = jnp.linalg.svd(triangle / size)
    alive = values > len(size) * jnp.finfo(values.dtype).eps * values[0]
    values, loads = jnp.where(alive, values, 0.0), jnp.where(alive, left.T @ projection, 0.0)
    squares = jnp.where(alive, values**2, 1.0)

    def improve(_: Array, damping: Array) -> Array:
        # Newton on 1/|s|, concave in the damping: from the left it never overshoots the root.
        length = jnp.sqrt(jnp.sum((values * loads / (squares + damping)) ** 2))
        decline = jnp.sum((values * loads) ** 2 / (squares + damping) ** 3)
        more = length**2 / jnp.where(decline > 0.0, decline, 1.0) * (length - radius) / radius
        return damping + jnp.where(length > 1.1 * radius, more, 0.0)

    damping = jax.lax.fori_loop(0, 12, improve, jnp.zeros((), values.dtype))
    return -(right.T @ (values * loads / (squares + damping))) / size


def boxed_step(
    z: Array, linearised: Linearisation, size: Array, radius: Array, lower: Array, upper: Array, held: Array
) -> Array:
    """A damped step; a variable that would leave the box stops on its wall and the others are solved again."""
    fixed = jnp.where(held, 0.0, jnp.nan)

    def solve(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        fixed, _, _ = state
        still = ~jnp.isnan(fixed)
        known = jnp.where(still, fixed, 0.0)
        step = damped_step(
            jnp.where(still, 0.0, linearised.triangle),
            linearised.projection + linearised.triangle @ known,
            size,
            radius,
        )
        step = jnp.where(still, known, step)
        wall = jnp.clip(z + step, lower, upper) - z
        out = ~still & ((z + step < lower) | (z + step > upper))
        return jnp.where(out, wall, fixed), step, jnp.any(out)

    _, step, _ = jax.lax.while_loop(lambda state: state[2], solve, (fixed, jnp.zeros_like(z), jnp.array(True)))
    return step


def offset_and_step(linearised: Linearisation, held: Array, size: Array) -> tuple[Array, Array, Array]:
    """Bates and Watts' relative offset of the free variables, their full Gauss-Newton step, and the cost that it promises."""
    triangle = jnp.where(held, 0.0, linearised.triangle)
    # Held columns leave a triangle of lower rank in which only part of c belongs to the free ones: that part is U'c.
    left, values, right = jnp.linalg.svd(triangle / size)
    alive = values > len(size) * jnp.finfo(values.dtype).eps * values[0]
    loads = jnp.where(alive, left.T @ linearised.projection, 0.0)
    step = -(right.T @ (loads / jnp.where(alive, values, 1.0))) / size
    count = jnp.maximum(jnp.sum(alive.astype(values.dtype)), 1.0)
    explained = jnp.sum(loads**2)
    rest = jnp.maximum(linearised.cost - explained, 0.0) / jnp.maximum(linearised.rows - count, 1.0)
    tiny = jnp.finfo(values.dtype).tiny
    return jnp.sqrt(explained / count / jnp.maximum(rest, tiny)), step, linearised.cost - explained


def linearise(fn: Any, z: Array, args: Any) -> tuple[Array, Array, Any]:
    """Residual (m,), the Jacobian's columns (n, m) by forward mode, and aux, with one evaluation of the primal."""
    push = lambda direction: jax.jvp(lambda y: fn(y, args), (z,), (direction,), has_aux=True)
    return jax.vmap(push, out_axes=(None, 0, None))(jnp.eye(z.size, dtype=z.dtype))


def fall_of_cost(before: Array | np.ndarray, after: Array | np.ndarray) -> Any:
    """r'r - s's of two residuals, as (r - s)'(r + s): it loses less where the two are nearly equal."""
    return ((before - after) * (before + after)).sum()


def reduced_on_host(columns: np.ndarray, residual: np.ndarray, size: int) -> Linearisation:
    """The linearisation of columns (n, m) and residual (m,), with columns of zeros up to `size`; zeros where they are not finite."""
    n, m = columns.shape
    triangle, projection = np.zeros((size, size)), np.zeros(size)
    cost = np.sum(residual**2)
    if np.isfinite(cost) and np.all(np.isfinite(columns)):
        _, whole = gram_schmidt(np.vstack([columns, residual]).T)
        triangle[:n, :n], projection[:n] = whole[:n, :n], whole[:n, n]
    numbers: tuple[Any, ...] = (
        triangle,
        projection,
        np.asarray(cost),
        np.asarray(float(m)),
    )  # a compiled step takes NumPy as it is
    return Linearisation(*numbers)


TRUSTED = 1.0  # relative offset, in standard errors, from which on the linearisation says where a search will end
NEAR = 5.0  # times the offset at which a search stops: from there on it ends with the first trial that fails


class State(eqx.Module):
    """What `BoxedLevenbergMarquardt` carries from one evaluation to the next.

    residual, columns: of the last accepted point; empty where who evaluates the model keeps them.
    """

    first: Bool[Array, ""]
    accepted: Bool[Array, ""]  # whether the last trial was taken
    trial: Float[Array, " n"]
    predicted: Float[Array, ""]  # decrease of the cost that the linearisation promises for `trial`
    residual: Float[Array, " m"]
    columns: Float[Array, "n m"]  # J transposed: its columns lie contiguous in memory
    linearised: Linearisation
    size: Float[Array, " n"]  # Marquardt's scaling: largest column norms so far
    radius: Float[Array, ""]
    offset: Float[Array, ""]
    evaluations: Int[Array, ""]
    done: Bool[Array, ""]
    result: optx.RESULTS


class BoxedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Each step is one evaluation of residual and Jacobian together: nine trials of ten are accepted, so evaluating
    them apart would cost more, and would compile the model twice.

    `options` holds the limits `lower` and `upper` (n,) and the relative offset `tolerance` at which to stop. `enough`: a search
    that is as near its optimum as `TRUSTED` ends, too, where it promises no lower cost than this.
    """

    rtol: float = 1e-12  # of z: for data that the model meets exactly, where the offset has no meaning
    atol: float = 1e-12
    norm: Callable[[PyTree], Scalar] = optx.max_norm
    # Times |D z|. The low end of Moré's range: with 1 to 100 two of NIST's 54 starts run away from the optimum.
    # Shrinking by a half and doubling likewise solved more of them, in fewer steps, than a quarter or fourfold.
    first_radius: float = 0.1

    def init(self, fn: Any, y: Any, args: Any, options: Any, f_struct: Any, aux_struct: Any, tags: Any) -> State:
        n, m, kind = y.size, f_struct.size, y.dtype
        zero = jnp.zeros((), kind)
        return State(
            first=jnp.array(True),
            accepted=jnp.array(False),
            trial=y,
            predicted=zero,
            residual=jnp.zeros(m, kind),
            columns=jnp.zeros((n, m), kind),
            linearised=Linearisation(jnp.zeros((n, n), kind), jnp.zeros(n, kind), zero, zero),
            size=jnp.zeros(n, kind),
            radius=zero,
            offset=jnp.array(jnp.inf, kind),
            evaluations=jnp.array(0),
            done=jnp.array(False),
            result=optx.RESULTS.successful,
        )

    def step(
        self, fn: Any, y: Any, args: Any, options: dict[str, Any], state: State, tags: Any
    ) -> tuple[Array, State, Any]:
        residual, columns, aux = linearise(fn, state.trial, args)
        cost = jnp.sum(residual**2)
        finite = jnp.isfinite(cost) & jnp.all(jnp.isfinite(columns))

        def reduced() -> Linearisation:
            triangle, projection = triangular(columns, residual)
            # A start without finite values is refused on the host; LAPACK's SVD may not return from them.
            sound = lambda values: jnp.where(finite, values, 0.0)
            rows = jnp.asarray(residual.size, dtype=cost.dtype)
            return Linearisation(sound(triangle), sound(projection), cost, rows)

        z, new = self.advance(y, options, state, fall_of_cost(state.residual, residual), finite, reduced)
        kept = lambda now, before: jnp.where(new.accepted, now, before)
        new = eqx.tree_at(
            lambda s: (s.residual, s.columns), new, (kept(residual, state.residual), kept(columns, state.columns))
        )
        return z, new, aux

    def advance(
        self,
        y: Array,
        options: dict[str, Any],
        state: State,
        gained: Array,
        finite: Array,
        reduced: Callable[[], Linearisation],
    ) -> tuple[Array, State]:
        """Judge the trial, and make the next one.

        gained: the fall of the cost to the trial (`fall_of_cost`); finite: whether all of its residual and columns are; reduced:
        its linearisation, asked for where the trial is taken.
        """
        # Below this the costs cannot tell the points apart any more, and the linearisation is the better judge.
        resolution = 1e-12 * state.linearised.cost
        blind = (state.predicted <= resolution) & (jnp.abs(gained) <= 100.0 * resolution)
        ratio = jnp.where(blind, 1.0, gained / jnp.where(state.predicted > 0.0, state.predicted, 1.0))
        accept = state.first | (finite & (state.predicted > 0.0) & (ratio > 1e-4))
        ratio = jnp.where(finite, ratio, -1.0)
        linearised = jax.lax.cond(accept, reduced, lambda: state.linearised)
        z = jnp.where(accept, state.trial, y)
        norms = jnp.sqrt(jnp.sum(linearised.triangle**2, axis=0))
        size = jnp.maximum(state.size, norms)
        used = jnp.where(size > 0.0, size, 1.0)

        moved = jnp.sqrt(jnp.sum((used * (state.trial - y)) ** 2))
        reach = jnp.sqrt(jnp.sum((used * z) ** 2))
        start_radius = self.first_radius * jnp.where(reach > 0.0, reach, 1.0)
        radius = jnp.where(ratio < 0.25, 0.5 * jnp.minimum(moved, state.radius), state.radius)
        radius = jnp.where(ratio > 0.75, jnp.maximum(2.0 * moved, state.radius), radius)
        radius = jnp.where(state.first, start_radius, radius)

        lower, upper = options["lower"], options["upper"]
        gradient = linearised.triangle.T @ linearised.projection
        held = ((z <= lower) & (gradient >= 0.0)) | ((z >= upper) & (gradient <= 0.0))
        offset, newton, promised = offset_and_step(linearised, held, used)
        hopeless = accept & (offset <= TRUSTED) & (promised >= options["enough"])
        small = jnp.all(jnp.abs(newton) <= self.atol + self.rtol * jnp.abs(z))
        # Once the costs are blind, an offset that no longer falls is all that rounding allows.
        stuck = accept & blind & ~state.first & (offset >= state.offset)
        lost = radius <= 1e-14 * reach
        # So near the optimum a trial that fails says that the model is not known any better: no shorter step will do.
        settled = ~accept & (offset <= NEAR * options["tolerance"])
        step = boxed_step(z, linearised, used, radius, lower, upper, held)
        after = linearised.triangle @ step + linearised.projection
        failed = state.first & ~finite
        predicted = jnp.sum((linearised.projection - after) * (linearised.projection + after))
        # Where trials fail at every length the model has a kink. A shorter one that promises no more than the offset at which a
        # search stops leaves unclaimed is not worth its evaluation.
        unclaimed = (linearised.cost - promised) * (options["tolerance"] / offset) ** 2
        fruitless = ~accept & (predicted <= unclaimed)
        new = State(
            first=jnp.array(False),
            accepted=accept,
            trial=jnp.clip(z + step, lower, upper),
            predicted=predicted,
            residual=state.residual,
            columns=state.columns,
            linearised=linearised,
            size=size,
            radius=radius,
            offset=offset,
            evaluations=state.evaluations + 1,
            done=failed
            | (accept & ((offset <= options["tolerance"]) | small | stuck))
            | lost
            | settled
            | fruitless
            | hopeless,
            result=optx.RESULTS.successful,
        )
        return z, new

    def terminate(
        self, fn: Any, y: Any, args: Any, options: Any, state: State, tags: Any
    ) -> tuple[Bool[Array, ""], optx.RESULTS]:
        return state.done, state.result

    def postprocess(
        self, fn: Any, y: Any, aux: Any, args: Any, options: Any, state: State, tags: Any, result: Any
    ) -> tuple[Any, Any, dict[str, Any]]:
        return y, aux, {}


def gram_schmidt(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Q (m, n) with orthonormal columns and R (n, n) with Q R = columns (m, n); a zero column gives a zero column of Q.

    Modified Gram-Schmidt: Q departs from orthogonality by the condition number times 1e-16, R is as good as
    Householder's (Björck, BIT 7, 1967). For six columns it is as fast as LAPACK on a quiet machine, and does not fall
    from 0.1 to 16 ms, as threaded LAPACK does, when other threads want the same cores.
    """
    q = np.array(columns.T, dtype=float, order="C")
    n = len(q)
    r = np.zeros((n, n))
    for k in range(n):
        r[k, k] = np.sqrt(np.sum(q[k] ** 2))
        q[k] /= r[k, k] if r[k, k] > 0.0 else 1.0
        r[k, k + 1 :] = np.einsum("im,m->i", q[k + 1 :], q[k])
        q[k + 1 :] -= r[k, k + 1 :, None] * q[k]
    return q.T, r
