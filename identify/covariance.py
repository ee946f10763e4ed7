"""Covariance of fitted parameters by QR of the scaled Jacobian, with correlated noise, and who gets no error bar and why."""

from dataclasses import dataclass

import numpy as np

from .noise_correlation import NoiseCorrelation, correlated_sum


# Singular values of the unit-column Jacobian below this share of the largest: the data see a combination only by rounding.
FLAT = 1e-7


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
    alive: np.ndarray  # indices of the parameters that the decomposition holds


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
    unit = jacobian[:, alive] / lengths[alive]
    singular = np.linalg.svd(unit, compute_uv=False) if len(alive) else np.zeros(0)
    alive, unit = _without_flat_directions(unit, alive, names, why)
    matrix = np.zeros((len(names), len(names)))
    if len(alive):
        q, r = np.linalg.qr(unit)
        middle = q[exact_rows].T @ q[exact_rows]
        for block in blocks:
            middle += block.variance * correlated_sum(q[block.rows], block.sweeps, block.correlation)
        half = np.linalg.solve(r, np.linalg.cholesky(_symmetric(middle)))
        scaled = half @ half.T
        matrix[np.ix_(alive, alive)] = scaled / np.outer(lengths[alive], lengths[alive])
    return Covariance(matrix, why, singular, alive)


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)


def _without_flat_directions(
    unit: np.ndarray, alive: np.ndarray, names: tuple[str, ...], why: dict[int, str]
) -> tuple[np.ndarray, np.ndarray]:
    """Drop parameters that share a flat direction: they have no error bar, the rest keep theirs with them held."""
    if len(alive) < 2:
        return alive, unit
    _, values, right = np.linalg.svd(unit, full_matrices=False)
    involved: set[int] = set()
    for k in np.flatnonzero(values < FLAT * values[0]):
        members = [i for i in range(len(alive)) if abs(right[k, i]) > 0.1]
        words = ", ".join(f"{right[k, i]:+.2f} {names[alive[i]]}" for i in members)
        for i in members:
            why[int(alive[i])] = f"flat direction: the data do not see the combination {words}"
        involved.update(members)
    keep = [i for i in range(len(alive)) if i not in involved]
    return alive[keep], unit[:, keep]
