"""The p-value of the largest of many correlated scores, by Westfall and Young's single-step max-T.

The directions of all candidates are known, so the joint law of their scores under "no effect" is normal with a known
correlation and is simulated, not bounded. It is one-sided where the sign of an effect is known.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri, stdtr


DRAWS = 20_000  # of the largest score: the level of the search, 0.005, is then known to 10 %
SEED = 20110913
SMALLEST = 1e-300  # a p-value of exactly 0 says more than any noise model knows


@dataclass(frozen=True)
class MaxT:
    """The law of the largest score: `draws` sorted, `count` directions."""

    draws: np.ndarray
    count: int

    @classmethod
    def of(cls, directions: np.ndarray, one_sided: np.ndarray, draws: int = DRAWS) -> "MaxT":
        """directions (rows, k): orthonormalised scores' unit vectors; one_sided (k,): only a positive score counts."""
        count = directions.shape[1]
        if not count:
            return cls(np.zeros(0), 0)
        correlation = directions.T @ directions
        values, vectors = np.linalg.eigh(correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        normal = np.random.default_rng(SEED).standard_normal((draws, count)) @ root.T
        scores = np.where(one_sided, normal, np.abs(normal))
        return cls(np.sort(scores.max(axis=1)), count)

    def p_value(self, score: float, two_sided: bool = True) -> float:
        """Probability that the largest score of a record without any effect reaches `score`.

        Beyond the simulated draws, where they are too few to count, the bound of Bonferroni.
        """
        if not self.count:
            return 1.0
        over = len(self.draws) - int(np.searchsorted(self.draws, score))
        bound = self.count * (2.0 if two_sided else 1.0) * float(ndtr(-score))
        p = min(bound, 1.0) if over < 20 else min(over / len(self.draws), bound, 1.0)
        return max(p, SMALLEST)

    def critical(self, level: float) -> float:
        """The score that a record without any effect exceeds with probability `level`."""
        if not self.count:
            return np.inf
        place = int(np.ceil((1.0 - level) * len(self.draws))) - 1
        return float(self.draws[min(max(place, 0), len(self.draws) - 1)])


@dataclass(frozen=True)
class NoiseFreedom:
    """From how many readings the noise is known that scores are counted in: what was estimated is not known.

    channel (rows,): number of each row's channel. degrees_of_freedom (channels,): of its noise, infinite where it was stated.
    """

    channel: np.ndarray
    degrees_of_freedom: np.ndarray

    def along(self, direction: np.ndarray, used: np.ndarray) -> float:
        """Degrees of freedom of the noise that a score along a unit direction (rows used,) is counted in.

        Satterthwaite, Biometrics Bulletin 2, 1946: every channel by its share of the direction.
        """
        share = np.bincount(self.channel[used], weights=direction**2, minlength=len(self.degrees_of_freedom))
        return self._of(share)

    @property
    def of_all(self) -> float:
        """The same of the chi-square of all rows."""
        return self._of(np.bincount(self.channel, minlength=len(self.degrees_of_freedom)) / len(self.channel))

    def _of(self, share: np.ndarray) -> float:
        spread = float(np.sum(share**2 / self.degrees_of_freedom))
        return 1.0 / spread if spread > 0.0 else np.inf


def normal_score(t: float, degrees_of_freedom: float) -> float:
    """The normal score as rare as Student's t of some degrees of freedom: noise that was estimated is not known."""
    if not np.isfinite(degrees_of_freedom) or degrees_of_freedom > 1e4:
        return t
    tail = float(stdtr(degrees_of_freedom, -abs(t)))
    return float(np.sign(t) * (-ndtri(max(tail, 1e-300))))
