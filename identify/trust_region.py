"""Moré's Levenberg-Marquardt inside a box, as an optimistix solver.

optimistix's own LevenbergMarquardt starts from a damping of one without Marquardt's scaling, knows no bounds and stops
on small steps only. What a fit of weakly determined parameters needs instead: a trust region in column-scaled
variables, so that the weak directions take full Gauss-Newton steps at once; bounds that are reached exactly and left
again when the gradient says so; an end that is judged by orthogonality of residual and Jacobian.

Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978 (scaling, trust region, update rules).
Bates and Watts, "A relative offset orthogonality convergence criterion for nonlinear least squares",
Technometrics 23, 1981.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int, PyTree, Scalar

from .linearised import Linearisation, boxed_step, linearise, offset_and_step, triangular


class State(eqx.Module):
    """What `BoxedLevenbergMarquardt` carries from one evaluation to the next."""

    first: Bool[Array, ""]
    trial: Float[Array, " n"]
    predicted: Float[Array, ""]  # decrease of the cost that the linearisation promises for `trial`
    at: Linearisation
    size: Float[Array, " n"]  # Marquardt's scaling: largest column norms so far
    radius: Float[Array, ""]
    offset: Float[Array, ""]
    evaluations: Int[Array, ""]
    done: Bool[Array, ""]
    result: optx.RESULTS


class BoxedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Each step is one evaluation of residual and Jacobian together: nine trials of ten are accepted, so evaluating
    them apart would cost more, and would compile the model twice.

    `options` holds the limits `lower` and `upper` (n,) and the relative offset `tolerance` at which to stop.
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
            trial=y,
            predicted=zero,
            at=Linearisation(
                jnp.zeros(m, kind), jnp.zeros((n, m), kind), jnp.zeros((n, n), kind), jnp.zeros(n, kind), zero
            ),
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
        z, new = self.advance(y, options, state, residual, columns)
        return z, new, aux

    def advance(
        self, y: Array, options: dict[str, Any], state: State, residual: Array, columns: Array
    ) -> tuple[Array, State]:
        """Judge the trial by its residual and columns, and make the next one."""
        cost = jnp.sum(residual**2)
        finite = jnp.isfinite(cost) & jnp.all(jnp.isfinite(columns))
        # (r - s)(r + s) loses less than r^2 - s^2 when the two are nearly equal.
        gained = jnp.sum((state.at.residual - residual) * (state.at.residual + residual))
        # Below this the costs cannot tell the points apart any more, and the linearisation is the better judge.
        hush = 1e-12 * state.at.cost
        blind = (state.predicted <= hush) & (jnp.abs(gained) <= 100.0 * hush)
        ratio = jnp.where(blind, 1.0, gained / jnp.where(state.predicted > 0.0, state.predicted, 1.0))
        accept = state.first | (finite & (state.predicted > 0.0) & (ratio > 1e-4))
        ratio = jnp.where(finite, ratio, -1.0)

        def take() -> Linearisation:
            triangle, projection = triangular(columns, residual)
            # A start without finite values is refused on the host; LAPACK's SVD may not return from them.
            sound = lambda values: jnp.where(finite, values, 0.0)
            return Linearisation(residual, columns, sound(triangle), sound(projection), cost)

        at = jax.lax.cond(accept, take, lambda: state.at)
        z = jnp.where(accept, state.trial, y)
        norms = jnp.sqrt(jnp.sum(at.triangle**2, axis=0))
        size = jnp.maximum(state.size, norms)
        used = jnp.where(size > 0.0, size, 1.0)

        moved = jnp.sqrt(jnp.sum((used * (state.trial - y)) ** 2))
        reach = jnp.sqrt(jnp.sum((used * z) ** 2))
        start_radius = self.first_radius * jnp.where(reach > 0.0, reach, 1.0)
        radius = jnp.where(ratio < 0.25, 0.5 * jnp.minimum(moved, state.radius), state.radius)
        radius = jnp.where(ratio > 0.75, jnp.maximum(2.0 * moved, state.radius), radius)
        radius = jnp.where(state.first, start_radius, radius)

        lower, upper = options["lower"], options["upper"]
        gradient = at.triangle.T @ at.projection
        held = ((z <= lower) & (gradient >= 0.0)) | ((z >= upper) & (gradient <= 0.0))
        offset, newton = offset_and_step(at, held, used)
        small = jnp.all(jnp.abs(newton) <= self.atol + self.rtol * jnp.abs(z))
        # Once the costs are blind, an offset that no longer falls is all that rounding allows.
        stuck = accept & blind & ~state.first & (offset >= state.offset)
        lost = radius <= 1e-14 * reach
        step = boxed_step(z, at, used, radius, lower, upper, held)
        after = at.triangle @ step + at.projection
        failed = state.first & ~finite
        new = State(
            first=jnp.array(False),
            trial=jnp.clip(z + step, lower, upper),
            predicted=jnp.sum((at.projection - after) * (at.projection + after)),
            at=at,
            size=size,
            radius=radius,
            offset=offset,
            evaluations=state.evaluations + 1,
            done=failed | (accept & ((offset <= options["tolerance"]) | small | stuck)) | lost,
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
