"""Where the information on each parameter sits: Fisher information per point, what the other parameters take included."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Measurements:
    """Points that were or could be measured, with what each says of the free parameters.

    test, temperature [K], supply_pressure [Pa], position [m]: (points,). columns: (points, parameters), derivative of the
    reading in units of its own noise, per SI unit of the parameter: g with Fisher information g g^T.
    """

    parameters: tuple[str, ...]
    test: np.ndarray
    temperature: np.ndarray
    supply_pressure: np.ndarray
    position: np.ndarray
    columns: np.ndarray

    def at(self, rows: np.ndarray) -> "Measurements":
        """Some of the points."""
        parts = (self.test, self.temperature, self.supply_pressure, self.position, self.columns)
        return Measurements(self.parameters, *(part[rows] for part in parts))


def fisher_information(columns: np.ndarray) -> np.ndarray:
    """(parameters, parameters): sum of g g^T over the points."""
    return columns.T @ columns


def covariance_of(information: np.ndarray) -> np.ndarray:
    """The inverse of an information matrix, scaled so that parameters of any size come out; infinite where it is singular."""
    size = np.sqrt(np.diag(information))
    if not np.all(size > 0.0):
        return np.full_like(information, np.inf)
    scaled = information / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] < 1e-13:
        return np.full_like(information, np.inf)
    return np.linalg.inv(scaled) / np.outer(size, size)


def marginal_stds(information: np.ndarray) -> np.ndarray:
    """Standard deviation of each parameter with all the others unknown too."""
    return np.sqrt(np.diag(covariance_of(information)))


def shares(columns: np.ndarray, information: np.ndarray | None = None) -> np.ndarray:
    """(points, parameters): which share of the information on each parameter a point carries, the loss to the others included.

    With C the inverse of the whole information, a point's share is (C g)_i^2/C_ii: its part in the marginal variance of
    parameter i. Without a prior in `information` (default: the points' own) the shares of all points add up to 1.

    >>> slope = np.linspace(-1.0, 1.0, 5)
    >>> line = np.stack([np.ones(5), slope], axis=1)  # offset and slope of a straight line
    >>> found = shares(line)
    >>> [[round(float(share), 2) for share in row] for row in found]  # the ends tell the slope, all points the offset
    [[0.2, 0.4], [0.2, 0.1], [0.2, 0.0], [0.2, 0.1], [0.2, 0.4]]
    """
    covariance = covariance_of(fisher_information(columns) if information is None else information)
    if not np.all(np.isfinite(covariance)):
        return np.full(columns.shape, np.nan)
    return (columns @ covariance) ** 2 / np.diag(covariance)
