"""Global sensitivity by sampling: Sobol indices (SALib), and derivative-based measures that bound the total index.

A Sobol index is the share of an output's variance that an input brings, alone or with all its interactions. The derivative-based
measure is the mean square of a derivative over the tolerances.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


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
    """((2 + inputs) base, inputs) points of the unit cube: Saltelli's scheme on a scrambled Sobol sequence."""
    from SALib.sample import sobol

    return sobol.sample(_problem(inputs), base, calc_second_order=False, seed=seed)


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

    >>> points = sobol_samples(2, 256)
    >>> values = (points[:, 0] + 2.0 * points[:, 1])[:, None]  # additive: the variances are 1 and 4 to each other
    >>> found = sobol_indices(values, ("a", "b"), ("sum",))
    >>> bool(abs(found.first - [[0.2, 0.8]]).max() < 0.02)
    True
    """
    from SALib.analyze import sobol

    count, each = len(inputs), len(inputs) + 2
    shape = (len(outputs), count)
    found = {key: np.zeros(shape) for key in ("S1", "S1_conf", "ST", "ST_conf")}
    if progress is not None:
        progress("Sobol indices")
    for i in range(len(outputs)):
        column = np.ascontiguousarray(values[:, i])
        if not np.ptp(column) > 1e-9 * np.max(np.abs(column)):
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a factor without any influence is no mistake
            indices = sobol.analyze(
                _problem(count),
                column,
                calc_second_order=False,
                num_resamples=RESAMPLES,
                conf_level=CONFIDENCE,
                seed=seed + 1,  # 0 would mean none
            )
        for key, table in found.items():
            table[i] = indices[key]
    # The plain samples are the first and the last of every block; the others differ from them in one input.
    plain = np.concatenate([values[0::each], values[each - 1 :: each]])
    return SobolIndices(
        inputs,
        outputs,
        found["S1"],
        found["S1_conf"],
        found["ST"],
        found["ST_conf"],
        plain.mean(axis=0),
        plain.var(axis=0),
        len(values),
        len(values) // each,
    )


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


def _problem(inputs: int) -> dict:
    return {"num_vars": inputs, "names": [f"x{i}" for i in range(inputs)], "bounds": [[0.0, 1.0]] * inputs}


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
