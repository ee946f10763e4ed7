"""Noise of two parts, one of its own and one in proportion to the reading, as data sheets of instruments state it. NumPy and SciPy only.

sigma^2 = s0^2 + (s1 y)^2 (Rocke and Lorenzato, Technometrics 37, 1995). One figure for a flow meter that reads 0.002 l/min + 0.3 % lets
its large readings count two and a half times too much and its small ones a fifteenth.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from .correlation import effective_size


# Twice the logarithm of the likelihood that a second part must be worth: chance gives it to one channel in a hundred.
WORTH = 6.0
LEAST = 1e-4  # of the noise: the smallest part that is told from none
FEWEST = 40  # rows


@dataclass(frozen=True)
class TwoParts:
    """own: standard deviation of every reading [SI]; share: of the reading's size, that of the part in proportion to it."""

    own: float
    share: float

    def std(self, level: np.ndarray) -> np.ndarray:
        """Of readings of this size (rows,), SI."""
        return np.hypot(self.own, self.share * level)

    def times(self, factor: float) -> "TwoParts":
        """Both parts larger by a factor."""
        return TwoParts(factor * self.own, factor * self.share)


def two_parts(
    square: np.ndarray, level: np.ndarray, known: np.ndarray | None = None, left: np.ndarray | None = None
) -> TwoParts:
    """The parts behind squared residuals by restricted likelihood; one alone where the second is not worth it.

    square (rows,): residuals squared, each over the share of it that a fit has left. level (rows,): size of each reading, SI. known
    (rows,): variance that each row has beside these parts. left (rows,): that share, by which a row counts; None: 1.
    """
    known = np.zeros(len(square)) if known is None else known
    left = np.ones(len(square)) if left is None else left
    total = float(left.sum())
    size = float(left @ square) / total if total > 0.0 else 0.0
    height = float(np.sqrt(np.mean(level**2))) if len(level) else 0.0
    if size <= 0.0:
        return TwoParts(0.0, 0.0)
    relative, extra = (level / height) ** 2 if height > 0.0 else np.zeros(len(level)), known / size
    seen = square / size

    def cost(logs: np.ndarray, shapes: list[np.ndarray]) -> tuple[float, np.ndarray]:
        """Minus twice the log-likelihood per row, and its slope. logs: of the parts' variances, in mean squares."""
        parts = [np.exp(log) * shape for log, shape in zip(logs, shapes, strict=True)]
        variance = sum(parts) + extra
        slope = left * (1.0 / variance - seen / variance**2)
        value = float(left @ (np.log(variance) + seen / variance)) / total
        return value, np.array([float(slope @ part) for part in parts]) / total

    def best(shapes: list[np.ndarray], start: list[float]) -> tuple[float, np.ndarray]:
        limits = [(2.0 * np.log(LEAST), np.log(100.0))] * len(shapes)
        found = minimize(cost, np.array(start), (shapes,), jac=True, method="L-BFGS-B", bounds=limits)
        return float(found.fun), np.exp(0.5 * np.asarray(found.x))

    flat = np.ones(len(square))
    one, alone = best([flat], [0.0])
    if len(square) >= FEWEST and np.ptp(relative) > 0.0:
        both, parts = min(
            (best([flat, relative], start) for start in ([-0.7, -0.7], [-4.0, 0.0])), key=lambda end: end[0]
        )
        # Where neighbours remember each other, squares do too: they are worth as much less as there are fewer of them.
        square_of_noise = seen / (parts[0] ** 2 + parts[1] ** 2 * relative + extra)
        worth = total * (one - both) * effective_size(square_of_noise) / len(square)
        if worth > WORTH and parts[1] > 2.0 * LEAST:
            return TwoParts(float(parts[0]) * np.sqrt(size), float(parts[1]) * np.sqrt(size) / height)
    return TwoParts(float(alone[0]) * np.sqrt(size), 0.0)
