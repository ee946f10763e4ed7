"""A problem fitted or evaluated once: values, residuals, columns."""

import threading
from dataclasses import dataclass

import numpy as np

from .bench_faults import is_fault
from .least_squares import LeastSquaresResult


@dataclass(frozen=True)
class Fit:
    """A fit of a problem with the effects `effects` free: values, residual, columns.

    Rows: the real ones of every channel in turn, then the priors. residual (rows,): whitened, model - reading. columns (rows,
    entries): its derivatives to every parameter and effect of `order`, free or not. values: every entry of `order`. used
    (rows,): rows that the fit saw.
    """

    effects: tuple[str, ...]
    order: tuple[str, ...]
    free: tuple[str, ...]
    values: dict[str, float]
    chi2: float
    residual: np.ndarray
    columns: np.ndarray
    used: np.ndarray
    active: frozenset[str]  # free ones that press against a limit
    converged: bool
    message: str
    solution: LeastSquaresResult
    allowance: float = (
        0.0  # chi-square that its faults of the bench must gain for the many places they were looked for in
    )

    @property
    def physics(self) -> tuple[str, ...]:
        """Its effects without the faults of the bench."""
        return tuple(name for name in self.effects if not is_fault(name))

    @property
    def faults(self) -> tuple[str, ...]:
        return tuple(name for name in self.effects if is_fault(name))

    def column(self, name: str) -> np.ndarray:
        return self.columns[:, self.order.index(name)]

    @property
    def nuisance(self) -> np.ndarray:
        """Columns of what this fit adjusted, those at a limit left out."""
        names = [name for name in self.free if name not in self.active]
        return self.columns[:, [self.order.index(name) for name in names]]

    def linear_losses(self) -> dict[str, float]:
        """Chi-square that the loss of each of its effects would cost, (amount / standard error)^2 by the columns; NaN where they
        say nothing."""
        free = [name for name in self.free if name not in self.active]
        triangle = np.linalg.qr(self.columns[self.used][:, [self.order.index(name) for name in free]], mode="r")
        with np.errstate(divide="ignore", invalid="ignore"):
            try:
                variance = np.sum(np.linalg.inv(triangle) ** 2, axis=1)
            except np.linalg.LinAlgError:
                return {}
            return {n: self.values[n] ** 2 / v for n, v in zip(free, variance, strict=True) if n in self.effects}


_counting = threading.Lock()


@dataclass
class Work:
    """What the refits of a record have taken so far: evaluations of the model with its derivatives, and their cost in those of
    static tests with heat and with every row and port apart."""

    evaluations: int = 0
    cost: float = 0.0

    def add(self, evaluations: int, cost: float) -> None:
        """Count some more; from any thread."""
        with _counting:
            self.evaluations += evaluations
            self.cost += evaluations * cost
