"""Where the literal Eq. 6 is too coarse: X = X0 tanh(Q/Q0) + X1 tanh(Q/Q1) + k Q, fitted to one flow curve.

Cold oil is laminar over the whole stroke: Q grows as the square of the gap, so X as sqrt(Q), without an asymptote. A second
bend at a larger flow follows that; the curve stays explicit in Q and becomes Eq. 6 where X1 = 0.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .least_squares import solve
from .macro_fit import L_MIN, UM
from .transforms import Box


@dataclass(frozen=True)
class TwoTermFit:
    """values: (X0 [m], Q0 [m3/s], X1 [m], Q1 [m3/s], k [s/m2]); rms and worst error of the opening [m]."""

    values: np.ndarray
    rms: float
    worst: float


def two_term_position(values: np.ndarray | Array, flow: np.ndarray | Array) -> Array:
    """X0 tanh(Q/Q0) + X1 tanh(Q/Q1) + k Q, with values in the order of `TwoTermFit.values`."""
    x0, q0, x1, q1, k = values
    return x0 * jnp.tanh(flow / q0) + x1 * jnp.tanh(flow / q1) + k * jnp.asarray(flow)


def fit_two_terms(position: np.ndarray, flow: np.ndarray) -> TwoTermFit:
    """Least squares in the opening; position [m] counted from null and flow [m3/s] have the same shape (n,)."""
    x, q = UM * np.asarray(position, dtype=float), L_MIN * np.asarray(flow, dtype=float)
    most = float(np.abs(q).max())
    x0, q0, x1, q1, k = _best_of_scan(x, q, np.geomspace(2e-3, 1.0, 28) * most)
    boxes = (
        Box("X0", x0, 10.0),
        Box("Q0", q0, q0, 1e-4 * most, 2.0 * most, logarithmic=True),
        Box("X1", x1, 10.0),
        Box("Q1", q1, q1, 1e-4 * most, 2.0 * most, logarithmic=True),
        Box("k", k, abs(k)),
    )
    found = solve(_residual, boxes, (x, q), max_steps=60)
    to_si = np.array([1.0 / UM, 1.0 / L_MIN, 1.0 / UM, 1.0 / L_MIN, L_MIN / UM])
    worst, rms = float(np.abs(found.residual).max()), float(np.sqrt(np.mean(found.residual**2)))
    return TwoTermFit(found.p * to_si, rms / UM, worst / UM)


def _residual(p: Array, args: tuple[Array, Array]) -> Array:
    x, q = args
    return two_term_position(p, q) - x


def _best_of_scan(x: np.ndarray, q: np.ndarray, scan: np.ndarray) -> tuple[float, float, float, float, float]:
    """The best pair (Q0, Q1) on a grid; the other three are linear."""
    bends = np.tanh(q / scan[:, None])
    first, second = np.triu_indices(len(scan), 1)
    overlap, along, onto = bends @ bends.T, bends @ q, bends @ x
    normal = np.empty((len(first), 3, 3))
    normal[:, 0, 0], normal[:, 1, 1], normal[:, 2, 2] = overlap[first, first], overlap[second, second], q @ q
    normal[:, 0, 1] = normal[:, 1, 0] = overlap[first, second]
    normal[:, 0, 2] = normal[:, 2, 0] = along[first]
    normal[:, 1, 2] = normal[:, 2, 1] = along[second]
    right = np.stack([onto[first], onto[second], np.full(len(first), q @ x)], axis=1)
    linear = np.linalg.solve(normal, right[..., None])[..., 0]
    best = int(np.argmax(np.sum(linear * right, axis=1)))
    x0, x1, k = (float(value) for value in linear[best])
    return x0, float(scan[first[best]]), x1, float(scan[second[best]]), k
