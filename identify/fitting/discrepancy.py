"""What a model misses, as a part of the error of its readings: smooth curves of unknown size beside the noise, never a part of the model.

A gauge with little noise must not dictate a fit that it does not fit (Kennedy and O'Hagan, Journal of the Royal Statistical Society
B 63, 2001; Brynjarsdottir and O'Hagan, Inverse Problems 30, 2014). NumPy only.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np


# Of the noise: a curve that small changes no reading.
NOTHING = 1e-6


@dataclass(frozen=True)
class Discrepancy:
    """columns (rows, curves): whitened as a fit's residual is, the rows of priors 0, each for one standard deviation of its curve.

    Residuals then have the covariance 1 + columns columns'.
    """

    columns: np.ndarray

    @cached_property
    def parts(self) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal directions (rows, k), and what share of each goes."""
        left, size, _ = np.linalg.svd(self.columns, full_matrices=False)
        seen = size > NOTHING
        return left[:, seen], 1.0 - 1.0 / np.sqrt(1.0 + size[seen] ** 2)

    def whitened(self, values: np.ndarray) -> np.ndarray:
        """Values (..., rows) times the inverse root of that covariance."""
        left, share = self.parts
        return values - ((values @ left) * share) @ left.T
