"""What the free parameters leave of a signature: least-squares projection by orthogonal columns, never normal equations.

Gram-Schmidt and not LAPACK, whose threads wait for one another where other threads run (see `orthogonal`).
"""

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
        basis = np.empty((columns.shape[1], len(columns)))
        count = 0
        for column in columns.T:
            length = float(np.linalg.norm(column))
            if not length > 0.0:
                continue
            unit = column / length
            for _ in range(2):  # twice is enough (Kahan, in Parlett, "The Symmetric Eigenvalue Problem", 1980)
                unit = unit - basis[:count].T @ (basis[:count] @ unit)
            left = float(np.linalg.norm(unit))
            if left > DEPENDENT:
                basis[count] = unit / left
                count += 1
        return cls(basis[:count].T)

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
