"""Derivative-based global measures: the mean square of each derivative over the tolerances, a bound on the total index."""

from dataclasses import dataclass

import numpy as np


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
