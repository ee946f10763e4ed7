"""What a fit left uncertain, propagated: samples of the parameters' posterior, in directions that are independent."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ..model import Model
from .factors import FACTORS, Factor


@dataclass(frozen=True)
class Posterior:
    """A Gaussian posterior of some factors (SI): mean, standard deviations, and its principal directions.

    directions: (directions, factors), unit vectors in units of each factor's standard deviation, the most uncertain one
    first; spread: (directions,), standard deviation along each. Independent of each other, as the factors are not.
    """

    factors: tuple[Factor, ...]
    mean: np.ndarray
    std: np.ndarray
    directions: np.ndarray
    spread: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Each direction by its largest parts: "0.72 underlap - 0.69 edge_radius"."""
        return tuple(_words(row, self.factors) for row in self.directions)

    def samples(self, unit: np.ndarray) -> np.ndarray:
        """(samples, factors) from points (samples, directions) of the unit cube, cut where a factor cannot go."""
        normal = ndtri(np.clip(unit, 1e-12, 1.0 - 1e-12))
        values = self.mean + self.std * ((normal * self.spread) @ self.directions)
        return np.clip(values, [f.lower for f in self.factors], [f.upper for f in self.factors])

    def slopes(self, slopes: np.ndarray) -> np.ndarray:
        """Derivatives (..., factors, outputs) as derivatives to the directions' standard normals (..., directions, outputs)."""
        return np.einsum("df,...fo->...do", self.spread[:, None] * self.directions * self.std, slopes)


def posterior_of(model: Model, factors: tuple[Factor, ...]) -> Posterior | None:
    """The posterior in a model's covariance, of the factors that it names with an error; None where there is none."""
    if model.covariance is None:
        return None
    std = np.sqrt(np.diag(model.covariance))
    rows = [i for i, name in enumerate(model.free) if name in FACTORS and std[i] > 0.0]
    if not rows:
        return None
    by_name = {factor.name: factor for factor in factors}
    own = tuple(by_name[model.free[i]] for i in rows)
    correlation = model.covariance[np.ix_(rows, rows)] / np.outer(std[rows], std[rows])
    values, vectors = np.linalg.eigh(correlation)
    order = np.argsort(-values)
    vectors = vectors[:, order] * np.sign(vectors[np.argmax(np.abs(vectors), axis=0)[order], order])
    mean = np.array([factor.value for factor in own])
    return Posterior(own, mean, std[rows], vectors.T, np.sqrt(np.maximum(values[order], 0.0)))


def _words(direction: np.ndarray, factors: tuple[Factor, ...]) -> str:
    order = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) >= 0.3][:3]
    words = ""
    for i in order:
        sign = ("-" if direction[i] < 0 else "") if not words else (" - " if direction[i] < 0 else " + ")
        words += f"{sign}{abs(direction[i]):.2f} {factors[i].name}"
    return words
