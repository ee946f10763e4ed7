"""Global sensitivity by sampling: Sobol indices (scipy.stats), and derivative-based measures that bound the total index.

A Sobol index is the share of an output's variance that an input brings, alone or with all its interactions. The derivative-based
measure is the mean square of a derivative over the tolerances.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.stats import qmc


CONFIDENCE = 0.95
RESAMPLES = 100


@dataclass(frozen=True)
class SobolIndices:
    """First-order and total indices, (outputs, inputs), each with the half width of its 95 % bootstrap interval.

    mean, variance: (outputs,) over the samples. evaluations: of the function, (2 + inputs) x base.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    first: np.ndarray
    first_ci: np.ndarray
    total: np.ndarray
    total_ci: np.ndarray
    mean: np.ndarray
    variance: np.ndarray
    evaluations: int
    base: int


def base_of(evaluations: int, inputs: int) -> int:
    """The largest power of two whose study of so many inputs needs at most so many evaluations, and at least 8."""
    return max(8, 1 << max(0, (evaluations // (inputs + 2)).bit_length() - 1))


def sobol_samples(inputs: int, base: int, seed: int = 0) -> np.ndarray:
    """((2 + inputs) base, inputs) points of the unit cube: Saltelli's scheme on a scrambled Sobol sequence.

    In blocks of 2 + inputs rows: a point of the first sample, the same with one coordinate after the other from the second
    sample, and the point of the second.
    """
    first, second = np.split(qmc.Sobol(2 * inputs, rng=seed).random(base), 2, axis=1)
    mixed = [np.where(np.arange(inputs) == i, second, first) for i in range(inputs)]
    return np.stack([first, *mixed, second], axis=1).reshape(-1, inputs)


def sobol_indices(
    values: np.ndarray,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> SobolIndices:
    """Indices from `values` (samples, outputs) at the points of `sobol_samples`. Estimators: Saltelli et al. 2010
    (doi:10.1016/j.cpc.2009.09.018), the total one after Jansen; an output without variance has indices 0.

    Intervals are normal ones from resampled blocks: the bias-corrected ones of SciPy leave out one block after the other,
    which takes minutes here.

    >>> points = sobol_samples(2, 256)
    >>> values = (points[:, 0] + 2.0 * points[:, 1])[:, None]  # additive: the variances are 1 and 4 to each other
    >>> found = sobol_indices(values, ("a", "b"), ("sum",))
    >>> bool(abs(found.first - [[0.2, 0.8]]).max() < 0.02)
    True
    """
    if progress is not None:
        progress("Sobol indices")
    count = len(inputs)
    base = len(values) // (count + 2)
    blocks = values.T.reshape(len(outputs), base, count + 2)
    flat = ~(np.ptp(values, axis=0) > 1e-9 * np.max(np.abs(values), axis=0))
    found = _indices(blocks, flat)
    random = np.random.default_rng(seed)
    again = np.stack([_indices(blocks[:, random.integers(base, size=base)], flat) for _ in range(RESAMPLES)])
    first_ci, total_ci = stats.norm.ppf(0.5 + 0.5 * CONFIDENCE) * np.std(again, axis=0, ddof=1)
    plain = blocks[:, :, [0, -1]].reshape(len(outputs), -1)
    return SobolIndices(
        inputs, outputs, found[0], first_ci, found[1], total_ci, plain.mean(axis=1), plain.var(axis=1), len(values), base
    )  # fmt: skip


def _indices(blocks: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """(2, outputs, inputs) first and total indices of values in blocks (outputs, base, 2 + inputs), 0 where `flat`."""
    parts = {"f_A": blocks[..., 0], "f_B": blocks[..., -1], "f_AB": np.moveaxis(blocks[..., 1:-1], -1, 0)}
    found = stats.sobol_indices(func=parts, n=blocks.shape[1])
    shape = (len(blocks), blocks.shape[2] - 2)
    both = np.stack([np.reshape(index, shape) for index in (found.first_order, found.total_order)])
    return np.where(flat[:, None], 0.0, both)


def total_along(curves: np.ndarray, inputs: int) -> np.ndarray:
    """(inputs, columns) total indices of many outputs at once, without intervals: of a curve's every position."""
    each = inputs + 2
    first, last = curves[0::each], curves[each - 1 :: each]
    variance = np.var(np.concatenate([first, last]), axis=0)
    alive = variance > 1e-18 * np.max(np.abs(curves), axis=0) ** 2
    out = np.zeros((inputs, curves.shape[1]))
    for i in range(inputs):
        unexplained = 0.5 * np.mean((first - curves[i + 1 :: each]) ** 2, axis=0)
        out[i] = np.where(alive, unexplained / np.where(alive, variance, 1.0), 0.0)
    return out


@dataclass(frozen=True)
class DerivativeMeasures:
    """Derivative-based measures nu = E[(dy/dx)^2], (outputs, inputs) in (unit of y/unit of x)^2, and what they bound.

    bound: C nu/Var(y) >= the total Sobol index, C the input's Poincare constant (Lamboni et al. 2013,
    doi:10.1016/j.matcom.2012.02.006); bound_ci: half width of its 95 % interval. mean_slope: E[dy/dx], whose sign says
    which way the input acts.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    nu: np.ndarray
    mean_slope: np.ndarray
    bound: np.ndarray
    bound_ci: np.ndarray
    samples: int


def uniform_constant(width: np.ndarray) -> np.ndarray:
    """Poincare constant of a uniform distribution of this width: (width/pi)^2. That of a Gaussian is its variance."""
    return (width / np.pi) ** 2


def derivative_measures(
    slopes: np.ndarray,
    variance: np.ndarray,
    constants: np.ndarray,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
) -> DerivativeMeasures:
    """From slopes (samples, inputs, outputs) at independent samples, the outputs' variance (outputs,) and the inputs'
    Poincare constants (inputs,).

    >>> points = np.random.default_rng(0).random((4096, 2))
    >>> slopes = np.stack([np.ones(4096), 2.0 * points[:, 1]], axis=1)[:, :, None]  # of y = a + b^2
    >>> variance = np.array([1 / 12 + 4 / 45])
    >>> found = derivative_measures(slopes, variance, uniform_constant(np.ones(2)), ("a", "b"), ("y",))
    >>> bool((found.bound >= [[1 / 12 / variance[0], 4 / 45 / variance[0]]]).all())  # above the total indices
    True
    """
    square = slopes**2
    scale = constants[:, None] / np.where(variance > 0.0, variance, np.inf)
    spread = np.std(square, axis=0, ddof=1) / np.sqrt(len(slopes))
    return DerivativeMeasures(
        inputs,
        outputs,
        square.mean(axis=0).T,
        slopes.mean(axis=0).T,
        (scale * square.mean(axis=0)).T,
        (1.96 * scale * spread).T,
        len(slopes),
    )
