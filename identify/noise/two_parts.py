"""Noise of several parts, such as one of its own and one in proportion to the reading, as data sheets of instruments state it.

sigma^2 = s0^2 + (s1 y)^2 (Rocke and Lorenzato, Technometrics 37, 1995). One figure for a flow meter that reads 0.002 l/min + 0.3 % lets
its large readings count two and a half times too much and its small ones a fifteenth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from .correlation import effective_size


# Twice the logarithm of the likelihood that a further part must be worth: chance gives it to one channel in a hundred.
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
    shapes = [np.ones(len(square)), level**2]
    found = parts_of_variance(square, shapes if len(square) >= FEWEST else shapes[:1], known, left)
    return TwoParts(float(np.sqrt(found[0])), float(np.sqrt(found[1])) if len(found) > 1 else 0.0)


def parts_of_variance(
    square: np.ndarray, shapes: Sequence[np.ndarray], known: np.ndarray | None = None, left: np.ndarray | None = None
) -> np.ndarray:
    """Amounts >= 0 of the `shapes` (rows,) of variance behind squared residuals, by restricted likelihood; (shapes,).

    The first always; of the others one at a time the one that is worth most, while it is worth its degree of freedom.
    square, known, left (rows,): as of `two_parts`; `left` may exceed 1, where a row's square is a mean over so many.
    """
    known = np.zeros(len(square)) if known is None else known
    left = np.ones(len(square)) if left is None else left
    total = float(left.sum())
    size = float(left @ square) / total if total > 0.0 else 0.0
    amounts = np.zeros(len(shapes))
    if size <= 0.0:
        return amounts
    scale = np.array([float(np.mean(shape)) for shape in shapes])
    relative = [shape / max(s, 1e-300) for shape, s in zip(shapes, scale, strict=True)]
    seen, extra = square / size, known / size

    def cost(logs: np.ndarray, chosen: list[int]) -> tuple[float, np.ndarray]:
        """Minus twice the log-likelihood per row, and its slope. logs: of the parts' variances, in mean squares."""
        parts = [np.exp(log) * relative[i] for log, i in zip(logs, chosen, strict=True)]
        variance = np.maximum(sum(parts) + extra, 1e-300)
        slope = left * (1.0 / variance - seen / variance**2)
        value = float(left @ (np.log(variance) + seen / variance)) / total
        return value, np.array([float(slope @ part) for part in parts]) / total

    def best(chosen: list[int], start: list[float]) -> tuple[float, np.ndarray]:
        limits = [(2.0 * np.log(LEAST), np.log(100.0))] * len(chosen)
        found = minimize(cost, np.array(start), (chosen,), jac=True, method="L-BFGS-B", bounds=limits)
        return float(found.fun), np.exp(np.asarray(found.x))

    chosen = [0]
    least, found = best(chosen, [0.0])
    while True:
        others = [i for i in range(len(shapes)) if i not in chosen and np.ptp(relative[i]) > 0.0]
        tried = []
        for i in others:
            for start in ([*np.log(found) - 0.7, -0.7], [*np.log(found) - 4.0, 0.0]):
                tried.append((*best([*chosen, i], start), i))
        value, parts, one = min(tried, key=lambda end: end[0], default=(least, found, 0))
        if not tried or parts[-1] <= (2.0 * LEAST) ** 2:
            break
        # Where neighbours remember each other, squares do too: they are worth as much less as there are fewer of them.
        variance = sum(part * relative[i] for part, i in zip(parts, [*chosen, one], strict=True)) + extra
        if total * (least - value) * effective_size(seen / variance) / len(square) <= WORTH:
            break
        least, found, chosen = value, parts, [*chosen, one]
    amounts[chosen] = found * size / scale[chosen]
    return amounts
