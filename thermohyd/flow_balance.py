"""Roots of flow balances of bounded cost, differentiated implicitly: one monotone scalar per element, or a few coupled per row.

Scalars by bracketed Newton, coupled balances by damped Newton.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float


# Port pressures between P_t and P_s are written p = P_t + (P_s - P_t)/(1 + exp(-q)). At |q| = 40 the smaller drop is
# 4e-18 of the whole; no valve within a stroke of its null comes near it.
BRACKET = 40.0
# Largest Newton step in q; together with the bracket it makes the iteration safe from any start. A mass flow grows with
# its drop between linearly (laminar) and as the square root (turbulent), so the balance's slope in q lies between -1 and
# -1/2 and a full Newton step overshoots at most twofold: clipping it short (at 3) costs two more iterations.
LONGEST_STEP = 12.0
# From q = 0, over 20,000 operating points of 400 valves drawn from the whole parameter box, isothermal and adiabatic:
# 4 steps leave 3e-5 of the leakage, 5 leave 2e-10, 6 only rounding.
NEWTON_STEPS = 6

Elementwise = Callable[[Float[Array, "..."]], Float[Array, "..."]]


def value_and_slope(fn: Callable[[Array], Any], q: Float[Array, "..."]) -> tuple[Any, Any]:
    """f(q) and df/dq of an elementwise function, by one forward-mode pass."""
    return jax.jvp(fn, (q,), (jnp.ones_like(q),))


def falling_root(fn: Elementwise, start: Float[Array, "..."], steps: int = NEWTON_STEPS) -> Float[Array, "..."]:
    """The root in [-40, 40] of each element of a falling elementwise function.

    A fixed number of Newton steps, each clipped and held inside the bracket that the signs seen so far leave (by
    bisection where Newton would leave it). Derivatives, forward and reverse and of any order, are those of the root
    (implicit function theorem), not of the iteration.
    """

    def solve(fn: Elementwise, q: Float[Array, "..."]) -> Float[Array, "..."]:
        def step(_: ArrayLike, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            q, low, high = state
            value, slope = value_and_slope(fn, q)
            low = jnp.where(value > 0.0, q, low)
            high = jnp.where(value < 0.0, q, high)
            trial = q - jnp.clip(value / slope, -LONGEST_STEP, LONGEST_STEP)
            inside = (trial >= low) & (trial <= high)
            return jnp.where(inside, trial, 0.5 * (low + high)), low, high

        limit = jnp.full_like(q, BRACKET)
        return jax.lax.fori_loop(0, steps, step, (q, -limit, limit))[0]

    def tangent_solve(linear: Elementwise, y: Float[Array, "..."]) -> Float[Array, "..."]:
        return y / linear(jnp.ones_like(y))

    return jax.lax.custom_root(fn, start, solve, tangent_solve)


# The unknowns -> what is out of balance there, and the state.
Balance = Callable[[Float[Array, "..."]], tuple[Float[Array, "..."], Any]]


def state_at_root(balance: Balance, start: Float[Array, "..."]) -> Any:
    """The state where a falling elementwise balance is 0, found as `falling_root` finds it.

    Derivatives, of any order, take one derivative of the balance for root and state together; a state computed behind `falling_root`
    takes one each, which was a third of a program of a static test, and of its time.
    """
    return _state_at_root(eqx.filter_closure_convert(balance, start), start)


@eqx.filter_custom_jvp
def _state_at_root(balance: Balance, start: Float[Array, "..."]) -> Any:
    return balance(falling_root(lambda q: balance(q)[0], start))[1]


@_state_at_root.def_jvp
def _state_at_root_jvp(primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    """d state = own + state_q dq, dq = -moved/imbalance_q: what each is moved by at the root that was found."""
    balance, start = primals
    q = falling_root(lambda q: balance(q)[0], start)
    _, (slope, along) = value_and_slope(balance, q)
    (_, state), (moved, own) = eqx.filter_jvp(lambda balance: balance(q), (balance,), tangents[:1])
    # None: of what nothing that is given moves.
    by_root = jnp.zeros_like(q) if moved is None else moved / slope
    follow = lambda along, own: -along * by_root if own is None else own - along * by_root
    return state, jax.tree.map(follow, along, own)


# An evaluation either continues with a full Newton step or halves the last one; no more than this, and none once every row is done.
STEPS = 12
# Longest move of any unknown in one step; unknowns are scaled so that 1 is a large change of each.
LONGEST_COUPLED_STEP = 3.0
# A step leaves at least this share of the room that is left (see `coupled_root`).
ROOM_KEPT = 0.25
# A row whose balances all hold to this is not moved, so that a coupling of strength zero leaves the uncoupled root alone.
BALANCED = 1e-13
# Below this a full step squares the imbalance, unless only rounding is left: a row that it does not help is done.
NEARLY_BALANCED = 1e-10
# A row whose imbalances stay larger has no root that was found. Of 15,360 extreme rows of a load flow (any load up to 1.3
# times the supply, coupling up to its limits) 74 end above it, 59 of these above 0.01, and 4 between 1e-9 and it; where the
# oil keeps half of its heat or all of it, and some rows have no steady state, 255 and 392 end above it.
ROOT = 1e-6

Unknowns = Float[Array, "unknowns ..."]
Coupled = Callable[[Unknowns], Unknowns]


def _columns(linear: Coupled, like: Unknowns) -> Float[Array, "unknowns unknowns ..."]:
    """Columns of a map that is linear and acts row by row: one product per unknown, for all rows at once."""
    k = like.shape[0]
    units = jnp.eye(k).reshape(k, k, *(1,) * (like.ndim - 1))
    return jax.vmap(linear)(jnp.broadcast_to(units, (k, *like.shape)))


def eliminate(columns: Float[Array, "unknowns unknowns ..."], right: Unknowns) -> Unknowns:
    """x with A x = right, row by row, A[i, j] = columns[j, i]; the axes behind broadcast.

    Gaussian elimination in the given order. It needs no pivoting: a port's own pressure dominates its balance, and what
    is left for the lines is one plus the losses' positive slopes, and stages in time have a matrix without zero minors.
    """
    k = right.shape[0]
    a = [[columns[j, i] for j in range(k)] for i in range(k)]
    b = [right[i] for i in range(k)]
    for i in range(k):
        for below in range(i + 1, k):
            factor = a[below][i] / a[i][i]
            a[below] = [a[below][j] - factor * a[i][j] if j > i else a[below][j] for j in range(k)]
            b[below] = b[below] - factor * b[i]
    x = list(b)
    for i in reversed(range(k)):
        known = sum((a[i][j] * x[j] for j in range(i + 1, k)), start=jnp.zeros(()))
        x[i] = (b[i] - known) / a[i][i]
    return jnp.stack(x)


def coupled_root(
    fn: Coupled, start: Unknowns, room: Callable[[Unknowns], Float[Array, "..."]] | None = None, steps: int = STEPS
) -> Unknowns:
    """The root of k balances in k unknowns for each row; arrays of shape (k, rows), a row depends on itself only.

    From the best point so far a Newton step, then its half, quarter ... until the largest imbalance falls; all rows go on until
    the last of them is done, or after `steps` evaluations. `room`, affine in the unknowns, is positive where the balances make
    sense, and stays so. A row whose root is not found becomes NaN. Derivatives, forward and reverse and of any order, are those of
    the root (implicit function theorem), not of the iteration.
    """

    def solve(fn: Coupled, z: Unknowns) -> Unknowns:
        def goes_on(state: tuple[Array, Array, Array, Array, Array]) -> Array:
            count, _, size, _, share = state
            done = (size <= BALANCED) | ((share < 1.0) & (size <= NEARLY_BALANCED))
            return (count < steps) & ~jnp.all(done)

        def step(state: tuple[Array, Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
            count, best, size, move, share = state
            trial = best + share * move
            value, push = jax.linearize(fn, trial)
            trial_size = jnp.max(jnp.abs(value), axis=0)
            newton = -eliminate(_columns(push, trial), value)
            fit = LONGEST_COUPLED_STEP / jnp.maximum(jnp.max(jnp.abs(newton), axis=0), LONGEST_COUPLED_STEP)
            if room is not None:
                now = room(trial)
                used = jnp.maximum(now - room(trial + newton), 1e-300)
                fit = jnp.minimum(fit, (1.0 - ROOM_KEPT) * now / used)
            newton = jnp.where(trial_size > BALANCED, newton * fit, 0.0)
            better = trial_size < size  # false where it is not a number
            return (
                count + 1,
                jnp.where(better, trial, best),
                jnp.where(better, trial_size, size),
                jnp.where(better, newton, move),
                jnp.where(better, 1.0, 0.5 * share),
            )

        rows = z.shape[1:]
        state = (jnp.asarray(0), z, jnp.full(rows, jnp.inf), jnp.zeros_like(z), jnp.ones(rows))
        _, best, size, move, share = jax.lax.while_loop(goes_on, step, state)
        # The last full step has not been looked at, but near the root it is the best one: it squares the imbalance.
        ahead = share == 1.0
        found = size < jnp.where(ahead, ROOT**0.5, ROOT)
        return jnp.where(found, jnp.where(ahead, best + move, best), jnp.nan)

    def tangent_solve(linear: Coupled, y: Unknowns) -> Unknowns:
        return eliminate(_columns(linear, y), y)

    return jax.lax.custom_root(fn, start, solve, tangent_solve)
