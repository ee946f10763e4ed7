"""What the free parameters leave of a signature: least-squares projection by QR, never through normal equations."""

from dataclasses import dataclass

import numpy as np


# A column that keeps less than this of its length beside the others adds nothing but rounding.
DEPENDENT = 1e-7


@dataclass(frozen=True)
class Projection:
    """P = I - Q Q' beside nuisance columns; `q` (rows, k) orthonormal."""

    q: np.ndarray

    @classmethod
    def beside(cls, columns: np.ndarray) -> "Projection":
        """Columns (rows, k), of any scale; dependent ones are dropped."""
        lengths = np.sqrt(np.sum(columns**2, axis=0))
        kept = columns[:, lengths > 0.0] / lengths[lengths > 0.0]
        if not kept.shape[1]:
            return cls(np.zeros((len(columns), 0)))
        left, singular, _ = np.linalg.svd(kept, full_matrices=False)
        return cls(left[:, singular > DEPENDENT * singular[0]])

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """P values for (rows,) or (rows, k); twice, because once leaves rounding of the order of the input."""
        once = values - self.q @ (self.q.T @ values)
        return once - self.q @ (self.q.T @ once)

    @property
    def rank(self) -> int:
        return self.q.shape[1]

    def with_columns(self, columns: np.ndarray) -> "Projection":
        """The projection beside these columns too."""
        more = Projection.beside(self(columns))
        return Projection(np.concatenate([self.q, more.q], axis=1))
