"""Covariance of fitted parameters by QR of the scaled Jacobian, with correlated noise, and who gets no error bar and why."""

from dataclasses import dataclass

import numpy as np

from .noise_correlation import NoiseCorrelation, correlated_sum
from .orthogonal import gram_schmidt


# Singular values of the unit-column Jacobian below this share of the largest: the data see a combination only by rounding.
FLAT = 1e-7
# Share of a parameter in a flat unit direction from which on the direction, and not rounding, decides its error bar.
TAKES_PART = 1e-4


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
