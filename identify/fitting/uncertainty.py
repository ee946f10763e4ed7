"""Covariance of fitted parameters from the scaled Jacobian (QR), with correlated noise, and how well the data tell them apart.

A sandwich (J'J)^-1 J' S J (J'J)^-1 where the noise correlates. A parameter that the data do not determine gets no error bar, and
the reason why. Condition number and weak directions are of the Jacobian with columns of unit length. Noise that is not known is
settled here too, from the residuals, as each channel pays its share of the parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from thermohyd.identify.noise.correlation import NoiseCorrelation, correlated_sum
from thermohyd.identify.noise.level import ChannelNoise, counted_once, reweighted

from .result import Identifiability
from .trust_region import gram_schmidt


Key = tuple[str, str]  # test, channel

# Singular values of the unit-column Jacobian below this share of the largest: the data see a combination only by rounding.
FLAT = 1e-7
# Share of a parameter in a flat unit direction from which on the direction, and not rounding, decides its error bar.
TAKES_PART = 1e-4
MISSES = 4.0  # mean square of a channel's residuals, in variances, from which on a model's slopes are not the curve's


@dataclass(frozen=True)
class Block:
    """Rows of one channel inside the residual vector, how its noise correlates and by how much it exceeds its weight."""

    rows: slice
    sweeps: np.ndarray
    correlation: NoiseCorrelation
    variance: float  # of the whitened residuals; 1 where the weights are the noise's


@dataclass(frozen=True)
class Covariance:
    """`matrix` (p, p) in the parameters' units, zero in rows of parameters without an error bar; `why` names those."""

    matrix: np.ndarray
    why: dict[int, str]
    singular_values: np.ndarray  # of the Jacobian with unit columns, dead ones left out
    alive: np.ndarray  # indices of the parameters that have an error bar


def covariance_of(
    jacobian: np.ndarray, names: tuple[str, ...], active: np.ndarray, blocks: list[Block], exact_rows: slice
) -> Covariance:
    """(J'J)^-1 J' S J (J'J)^-1 over the parameters that the data determine.

    jacobian: (n, p) of the whitened residuals; active: nonzero where a parameter sits at a limit, and is held there.
    S is block diagonal: each channel's variance and correlation; `exact_rows` (the priors) are white with variance 1.
    By QR of the columns scaled to unit length, never through J'J, whose condition is the square.
    """
    why: dict[int, str] = {}
    lengths = np.sqrt(np.sum(jacobian**2, axis=0))
    for i, name in enumerate(names):
        if active[i]:
            why[i] = f"at its {'lower' if active[i] < 0 else 'upper'} bound: held there while the others are estimated"
        elif not np.isfinite(lengths[i]):
            why[i] = "the model's derivative is not finite here"
        elif lengths[i] == 0.0:
            why[i] = f"no reading depends on {name}"
    alive = np.array([i for i in range(len(names)) if i not in why], dtype=int)
    matrix = np.zeros((len(names), len(names)))
    if not len(alive):
        return Covariance(matrix, why, np.zeros(0), alive)
    q, triangle = gram_schmidt(jacobian[:, alive] / lengths[alive])
    left, singular, right = np.linalg.svd(triangle)
    seen = singular >= FLAT * singular[0]
    _name_flat_directions(right[~seen], alive, names, why)
    # Along flat directions nothing is known of the parameters that take part in them, and nothing is lost for the others.
    basis = np.einsum("mi,ik->mk", q, left[:, seen])
    middle = basis[exact_rows].T @ basis[exact_rows]
    for block in blocks:
        middle += block.variance * correlated_sum(basis[block.rows], block.sweeps, block.correlation)
    half = (right[seen].T / singular[seen]) @ np.linalg.cholesky(0.5 * (middle + middle.T))
    half /= lengths[alive, None]
    known = np.array([i not in why for i in alive])
    alive, half = alive[known], half[known]
    matrix[alive[:, None], alive] = half @ half.T
    return Covariance(matrix, why, singular, alive)


def _name_flat_directions(
    directions: np.ndarray, alive: np.ndarray, names: tuple[str, ...], why: dict[int, str]
) -> None:
    """Say of every parameter that takes part in a flat direction (k, p) why it has no error bar."""
    for direction in directions:
        members = [i for i in range(len(alive)) if abs(direction[i]) > TAKES_PART]
        words = ", ".join(f"{direction[i]:+.2g} {names[alive[i]]}" for i in members)
        for i in members:
            why[int(alive[i])] = f"flat direction: the data do not see the combination {words}"


# Collinearity above which a combination is called weak: Brun et al. (Water Resources Research 37, 2001) found 10 to 15.
WEAK = 10.0
STRONGLY_CORRELATED = 0.9
WORTH_NAMING = 0.3  # share of a parameter in a unit direction


def identifiability(
    jacobian: np.ndarray, scales: np.ndarray, names: tuple[str, ...], correlation: np.ndarray, why: dict[int, str]
) -> Identifiability:
    """Condition number and weak directions of the Jacobian (n, p) of whitened residuals, columns of unit length.

    The condition number is that of unit columns, so that it speaks of trade-offs and not of units. A direction is given
    in the parameters' natural steps `scales` (p,), normalised: "edge_radius and underlap trade off: +0.71 -0.70".
    """
    lengths = np.sqrt(np.sum(jacobian**2, axis=0))
    seen = np.flatnonzero((lengths > 0.0) & np.isfinite(lengths))
    sentences = [f"{names[i]} has no error bar: {reason}" for i, reason in sorted(why.items())]
    if len(seen) == 0:
        return Identifiability(float("inf"), (), (), tuple(sentences))
    _, triangle = gram_schmidt(jacobian[:, seen] / lengths[seen])
    _, values, right = np.linalg.svd(triangle)
    condition = float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")
    weak = []
    for k in reversed(range(len(values))):
        collinearity = 1.0 / values[k] if values[k] > 0.0 else np.inf
        if collinearity < WEAK:
            continue
        direction = right[k] / lengths[seen] / scales[seen]
        direction = direction / np.sqrt(np.sum(direction**2))
        weak.append(_trade_off([names[i] for i in seen], direction, collinearity))
    for i in range(len(names)):
        for j in range(i):
            if abs(correlation[i, j]) > STRONGLY_CORRELATED:
                way = "rise together" if correlation[i, j] > 0.0 else "trade off"
                sentences.append(f"{names[j]} and {names[i]} {way} (correlation {correlation[i, j]:+.2f})")
    return Identifiability(condition, tuple(float(v) for v in values), tuple(weak), tuple(sentences))


def _trade_off(names: list[str], direction: np.ndarray, collinearity: float) -> str:
    """One sentence on a combination of parameters that moves the readings little."""
    order = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) >= WORTH_NAMING]
    if direction[order[0]] < 0.0:
        direction = -direction
    shares = " ".join(f"{direction[i]:+.2f}" for i in order)
    if len(order) == 1:
        return f"{names[order[0]]} is weakly determined: {shares} (collinearity {collinearity:.0f})"
    listed = ", ".join(names[i] for i in order[:-1]) + f" and {names[order[-1]]}"
    return f"{listed} trade off: {shares} (collinearity {collinearity:.0f})"


def settled_noise(
    noise: Mapping[Key, ChannelNoise],
    rows: Mapping[Key, slice],
    residual: np.ndarray,
    jacobian: np.ndarray,
    position: np.ndarray | None = None,
) -> dict[Key, ChannelNoise]:
    """Noise re-estimated from whitened residuals, where it is not known; each channel pays its share of the parameters.

    rows: of each channel in `residual` (n,) and in `jacobian` (n, p), whose columns are in the parameters' natural steps.
    position (n,): the residuals' slopes to the position [1/m], by which its errors count; None: by those of neighbouring rows, as where
    a model misses a channel by far: its slopes are not the curve's there.
    """
    leverage = leverage_of(jacobian)
    found = {}
    for key, own in rows.items():
        there, misfit = noise[key], residual[own] * noise[key].used
        if position is not None and float(np.mean((misfit / there.std) ** 2)) < MISSES:
            there = there.by_slopes(position[own] * there.used)
        found[key] = reweighted(there, misfit, np.maximum(1.0 - leverage[own], 0.05))
    return counted_once(found)


def largest_change(before: Mapping[Key, ChannelNoise], after: Mapping[Key, ChannelNoise]) -> float:
    """Largest relative change of any row's standard deviation."""
    return max(float(np.max(np.abs(after[key].used / before[key].used - 1.0))) for key in before)


def leverage_of(jacobian: np.ndarray) -> np.ndarray:
    """Diagonal of the hat matrix (rows,): how much of a parameter each reading uses up."""
    q, r = np.linalg.qr(jacobian)
    alive = np.abs(np.diag(r)) > 1e-12 * max(float(np.max(np.abs(np.diag(r)))), 1e-300)
    return np.sum(q[:, alive] ** 2, axis=1)
