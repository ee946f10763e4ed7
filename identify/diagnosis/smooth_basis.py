"""Smooth curves over a record's conditions: what a misfit of no known cause would look like, and a test for it."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.special import fdtrc

from ..record import DynamicTest, TestRecord
from .library_fit import Key, LibraryFit, LibraryProblem
from .projection import Projection
from .whitening import whiten_on_host, whitening_of


DEGREE = 5
DEGREE_IN_TIME, MOST_RUNS_APART = 9, 4


def smooth_columns(test: TestRecord) -> np.ndarray:
    """(rows, k): Legendre polynomials over the position, alone and times temperature, supply pressure and direction.

    The position counts by its rank: a bench puts its points where the curve moves. Over time, run by run, in motion.
    """
    if isinstance(test, DynamicTest):
        return smooth_in_time(test)
    order = np.argsort(np.argsort(test.spool_position, kind="stable"), kind="stable")
    place = 2.0 * order / max(test.rows - 1, 1) - 1.0
    shapes = legendre.legvander(place, DEGREE)
    factors: list[np.ndarray] = [np.ones(test.rows)]
    for column in (test.temperature, test.supply_pressure, test.load_pressure):
        scaled = _scaled(column)
        if scaled is not None:
            factors.append(scaled)
            if len(np.unique(np.round(scaled, 1))) > 2:
                factors.append(scaled**2)
    blocks = [shapes * factor[:, None] for factor in factors]
    if len(np.unique(test.direction)) > 1:
        blocks.append(shapes[:, :4] * test.direction[:, None])
        rate = _scaled(None if test.rate is None else np.abs(test.rate))
        if rate is not None:
            blocks.append(shapes[:, :2] * (test.direction * rate)[:, None])
    return np.concatenate(blocks, axis=1)


def smooth_in_time(test: DynamicTest) -> np.ndarray:
    """(rows, k): Legendre polynomials over each run's rows; runs beyond the first few share theirs."""
    degree = DEGREE_IN_TIME if test.frequency is None else DEGREE
    shared = np.minimum(test.run, MOST_RUNS_APART - 1)
    columns = np.zeros((test.rows, (degree + 1) * (int(shared.max()) + 1)))
    for code in np.unique(test.run):
        rows = np.flatnonzero(test.run == code)
        rank = np.argsort(np.argsort(test.place[rows], kind="stable"), kind="stable")
        first = int(shared[rows[0]]) * (degree + 1)
        columns[rows, first : first + degree + 1] = legendre.legvander(2.0 * rank / max(len(rows) - 1, 1) - 1.0, degree)
    return columns


def _scaled(column: np.ndarray | None) -> np.ndarray | None:
    """From -1 to 1; None where it does not vary."""
    if column is None:
        return None
    low, high = float(np.min(column)), float(np.max(column))
    if high - low <= 1e-3 * max(abs(high), abs(low), 1e-300):
        return None
    return 2.0 * (column - low) / (high - low) - 1.0


def smooth_block(problem: LibraryProblem, rows: int) -> np.ndarray:
    """Smooth columns of every channel, whitened like a residual of `rows` rows (priors last, untouched)."""
    where = problem.rows()
    blocks = []
    for key, place in where.items():
        columns = whitened(problem, key, smooth_columns(problem.tests[key[0]]))
        block = np.zeros((rows, columns.shape[1]))
        block[place] = columns
        blocks.append(block)
    return np.concatenate(blocks, axis=1)


def whitened(problem: LibraryProblem, key: Key, columns: np.ndarray) -> np.ndarray:
    """Columns (rows, k) over a channel's rows, in shares of its noise, whitened as its residuals are."""
    test = problem.tests[key[0]]
    weight = 1.0 / problem.noise.std[key]
    filter_ = whitening_of(problem.noise.correlation[key], problem.sweeps(key[0]), test.rows)
    return whiten_on_host(filter_, columns * weight[:, None])


@dataclass(frozen=True)
class LackOfFit:
    """F test of smooth curves beside a fitted model."""

    p_value: float
    chi2: float  # that the curves would take off
    freedom: int


def lack_of_fit(problem: LibraryProblem, fit: LibraryFit, block: np.ndarray, scale: float = 1.0) -> LackOfFit:
    """Whether smooth curves over the conditions still explain something beside `fit`; the rest measures the noise."""
    used = fit.used
    base = Projection.beside(fit.nuisance[used])
    residual = base(fit.residual[used])
    more = Projection.beside(base(block[used]))
    taken = float(np.sum((more.q.T @ residual) ** 2))
    rest = float(np.sum(residual**2)) - taken
    freedom = len(residual) - base.rank - more.rank
    if more.rank == 0 or freedom < 10:
        return LackOfFit(1.0, taken, more.rank)
    noise = max(rest / freedom, scale**2 * 0.5)
    return LackOfFit(float(fdtrc(more.rank, freedom, taken / more.rank / noise)), taken, more.rank)
