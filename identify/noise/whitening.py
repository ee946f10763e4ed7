"""Make correlated noise white: the innovations of AR(1) plus white noise along every sweep, as data of a compiled fit.

Kalman, "A new approach to linear filtering and prediction problems", 1960: y_t minus its prediction from the rows
before, over the prediction's standard deviation, is white. Linear in y, so it acts on residuals and Jacobians alike.
Then readings that share errors of what was logged beside them: gauges of one row, and rows of one smooth sweep.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import solve_banded
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from thermohyd.numerics import linear_recursion

from .correlation import NoiseCorrelation


LEAST = 1e-12  # of a row's variance, remembered: what is predicted of it is then nothing
# Of a row's variance, the least that any mixture of its gauges keeps: their clocks and filters are never quite alike.
LEAST_APART = 0.01
UNFELT = 1e-3  # of a row's variance: an error that makes no more is taken for the row's own


class Whitening(eqx.Module):
    """Per row: prediction x_(t+1) = keep x_t + learn y_t, innovation (y_t - x_t) weight_t; a sweep starts with x = 0."""

    keep: Float[Array | np.ndarray, " rows"]
    learn: Float[Array | np.ndarray, " rows"]
    weight: Float[Array | np.ndarray, " rows"]


def whitening_of(
    correlation: NoiseCorrelation,
    sweeps: np.ndarray,
    padded: int,
    used: np.ndarray | None = None,
    memory: np.ndarray | None = None,
) -> Whitening:
    """The filter for rows (n,) whose sweeps (n,) follow one another, with pads that pass through behind them.

    used (n,): of the others nothing is learned and nothing is left, as a reading left out is no reading of 0. memory (n,): what
    part of each row's variance is the noise that `correlation` speaks of; the rest is a row's own. None: all of it.
    """
    keep, learn, weight = np.zeros(padded), np.zeros(padded), np.ones(padded)
    share, phi = correlation.share, correlation.phi
    if share > 0.0 and phi > 0.0:
        rows = len(sweeps)
        starts = np.flatnonzero(np.append(True, sweeps[1:] != sweeps[:-1]))
        place = np.arange(rows) - np.repeat(starts, np.diff(np.append(starts, rows)))
        size = np.full(rows, np.sqrt(share)) if memory is None else np.sqrt(np.maximum(share * memory, LEAST))
        if (used is None or used.all()) and memory is None:
            longest = int(place.max()) + 1
            gain, spread = (values[place] for values in _gains(size[:longest], phi, np.ones(longest)))
        else:
            gain, spread = _gains(size, phi, np.ones(rows) if used is None else used, place == 0)
        ahead = np.append(size[1:], size[-1])
        keep[:rows] = phi * ahead / size * (1.0 - gain * size)
        learn[:rows] = phi * ahead * gain
        weight[:rows] = 1.0 / spread
        # What a sweep's last row has learned must not reach the next sweep.
        ends = np.append(starts[1:] - 1, rows - 1)
        keep[ends] = learn[ends] = 0.0
    if used is not None:
        weight[: len(used)] *= used
    return Whitening(keep, learn, weight)


def _gains(
    size: np.ndarray, phi: float, used: np.ndarray, starts: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Kalman gain of the remembered part, of variance 1, and standard deviation of the innovation at each row (rows,).

    size (rows,): of that part in a row of variance 1; starts (rows,): of sweeps, by default one.
    """
    length = len(used)
    gain, spread = np.empty(length), np.empty(length)
    variance = 1.0  # of the remembered part, given the rows before
    for i in range(length):
        if starts is not None and starts[i]:
            variance = 1.0
        total = size[i] ** 2 * (variance - 1.0) + 1.0
        gain[i], spread[i] = (size[i] * variance / total if used[i] else 0.0), np.sqrt(total)
        variance = phi**2 * variance * (1.0 - gain[i] * size[i]) + 1.0 - phi**2
    return gain, spread


def whiten(filter_: Whitening, values: Float[Array, "*columns rows"]) -> Float[Array, "*columns rows"]:
    """Innovations along the last axis, whose recursion is linear."""
    learned = linear_recursion(jnp.asarray(filter_.keep), jnp.asarray(filter_.learn) * values)
    predicted = jnp.concatenate([jnp.zeros_like(values[..., :1]), learned[..., :-1]], axis=-1)
    return (values - predicted) * filter_.weight


@dataclass(frozen=True)
class HostWhitening:
    """The same filter in NumPy, laid out once for what is whitened many times: called with (rows,) or (rows, columns).

    band (2, rows): of the recursion; None where nothing is remembered.
    """

    learn: np.ndarray
    weight: np.ndarray
    band: np.ndarray | None

    @classmethod
    def of(cls, filter_: Whitening) -> "HostWhitening":
        learn, weight = np.asarray(filter_.learn), np.asarray(filter_.weight)
        band = np.stack([np.ones(len(learn)), -np.asarray(filter_.keep)]) if np.any(learn) else None
        return cls(learn, weight, band)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        weight = self.weight.reshape(-1, *[1] * (values.ndim - 1))
        if self.band is None:
            return values * weight
        # predicted_(t+1) - keep_t predicted_t = learn_t y_t: one forward substitution, as no entry of the band exceeds the diagonal.
        ahead = np.zeros_like(values, dtype=float)
        ahead[1:] = (values.T * self.learn).T[:-1]
        predicted = solve_banded((1, 0), self.band, ahead, check_finite=False)
        return (values - predicted) * weight


def whiten_on_host(filter_: Whitening, values: np.ndarray) -> np.ndarray:
    """The same in NumPy, (rows,) or (rows, columns), for what never enters a compiled fit."""
    return HostWhitening.of(filter_)(values)


@dataclass(frozen=True)
class SharedError:
    """The error of one input that several readings of a test have in common.

    moved (gauges, rows): what one standard deviation of it makes of their whitened residuals. covariance (rows, rows): of any unit, of
    the error from row to row; None: each row has one of its own.
    """

    moved: np.ndarray
    covariance: np.ndarray | None = None

    def correlation(self, felt: np.ndarray) -> np.ndarray | None:
        """From row to row (rows, rows), of rows that feel it (rows,)."""
        if self.covariance is None:
            return None
        size = np.sqrt(np.diag(self.covariance))
        size = np.where(size > 0.0, size, 1.0)
        found = self.covariance / np.outer(size, size) * np.outer(felt, felt)
        found[np.diag_indices_from(found)] = 1.0
        return found


@dataclass(frozen=True)
class Decorrelation:
    """Readings that share errors made independent of each other. matrix (readings, readings): symmetric."""

    matrix: csr_array

    @classmethod
    def of(cls, readings: int, tests: Iterable[tuple[list[slice], list[SharedError]]]) -> "Decorrelation | None":
        """tests: where the gauges of each stand among the readings, and the errors that they share. None: no test shares any.

        By the inverse square root of the covariance of rows that hang together, which moves every residual as little as can be (Kessy,
        Lewin and Strimmer, The American Statistician 72, 2018: ZCA).
        """
        tests = list(tests)
        if not tests:
            return None
        alone = np.ones(readings)
        entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        for places, errors in tests:
            felt = np.sum([np.max(error.moved**2, axis=0) for error in errors], axis=0) > UNFELT
            along = [error.correlation(felt) for error in errors]
            both = list(zip(errors, along, strict=True))
            for rows in _rows_together(felt, [found for found in along if found is not None]):
                root = _inverse_root([(error.moved[:, rows], found) for error, found in both], rows)
                number = np.concatenate([place.start + rows for place in places], axis=1)
                alone[number] = 0.0
                row = np.broadcast_to(number[:, :, None], root.shape)
                entries.append((root.ravel(), row.ravel(), np.swapaxes(row, 1, 2).ravel()))
        left = np.flatnonzero(alone)
        entries.append((alone[left], left, left))
        value, row, column = (np.concatenate(part) for part in zip(*entries, strict=True))
        return cls(csr_array((value, (row, column)), shape=(readings, readings)))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Whitened values (..., readings and what stands behind them), of which the readings change."""
        found, readings = values.copy(), len(self.matrix.indptr) - 1
        found[..., :readings] = (self.matrix @ values[..., :readings].T).T
        return found

    @property
    def members(self) -> tuple[np.ndarray, np.ndarray]:
        """Those that each reading is mixed of (readings, k), and with which factors (readings, k)."""
        count = np.diff(self.matrix.indptr)
        row = np.repeat(np.arange(len(count)), count)
        place = np.arange(len(row)) - self.matrix.indptr[row]
        members, shares = np.zeros((2, len(count), int(count.max())))
        members[row, place], shares[row, place] = self.matrix.indices, self.matrix.data
        return members.astype(int), shares


def _rows_together(felt: np.ndarray, correlations: list[np.ndarray]) -> Iterator[np.ndarray]:
    """Rows that feel an error, by groups that share one: (groups, rows of each), all groups of one size at once."""
    tied = sum(map(csr_array, correlations), csr_array((len(felt), len(felt))))
    _, group = connected_components(tied, directed=False)
    size = np.bincount(group)
    order, first = np.argsort(group, kind="stable"), np.cumsum(size) - size
    for length in np.unique(size).tolist():
        rows = order[first[size == length][:, None] + np.arange(length)]
        if (feeling := felt[rows].any(axis=1)).any():
            yield rows[feeling]


def _inverse_root(errors: list[tuple[np.ndarray, np.ndarray | None]], rows: np.ndarray) -> np.ndarray:
    """(groups, n, n) of the covariance of gauges x rows of each group, each of variance 1. errors: what each makes of residuals
    (gauges, groups, rows), and its correlation; rows (groups, rows)."""
    groups, length = rows.shape
    n = len(errors[0][0]) * length
    covariance = np.zeros((groups, n, n))
    for moved, correlation in errors:
        alike = np.eye(length)[None] if correlation is None else correlation[rows[:, :, None], rows[:, None, :]]
        together = moved.transpose(1, 0, 2).reshape(groups, n)
        gauges = n // length
        covariance += together[:, :, None] * together[:, None, :] * np.tile(alike, (1, gauges, gauges))
    covariance[:, np.arange(n), np.arange(n)] = 1.0
    values, vectors = np.linalg.eigh(covariance)
    return (vectors / np.sqrt(np.maximum(values, LEAST_APART))[:, None, :]) @ np.swapaxes(vectors, 1, 2)
