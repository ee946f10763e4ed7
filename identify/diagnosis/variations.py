"""Second tier: which model quantity would have to vary smoothly with which variable for the rest of the gap to close.

A quantity's own column times Legendre polynomials of a variable: after Kristensen, Madsen and Jørgensen (Computers and
Chemical Engineering 28, 2004), who let suspect parameters drift to see where a model is deficient. Empirical: it says
where to look, not why.
"""

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc

from ..noise_correlation import NoiseCorrelation
from .library_fit import LibraryFit, LibraryProblem, Noise
from .projection import Projection
from .result import Variation
from .variation_terms import ABSOLUTE, LearnedTerm, legendre_basis, term_values, variable_values
from .whitening import whiten_on_host, whitening_of


# Quantities by the column of the library that holds their derivative.
COLUMNS = {
    "discharge_coefficient": "discharge_coefficient",
    "transition_number": "transition_number",
    "clearance": "clearance",
    "edge_radius": "edge_radius",
    "underlap": "underlap",
    "null_bias": "null_bias",
    "viscosity": "viscosity_shift",
}
VARIABLES = (
    "spool_position", "opening", "temperature", "supply_pressure", "load_pressure", "flow_number", "direction", "rate",
    "elapsed",
)  # fmt: skip
DEGREE = 3
LEVEL = 1e-3
MOST = 3
CURVE_POINTS = 41
MICRON = 1e-6  # unit of an absolute quantity's coefficients while they are solved for


def variations_of(problem: LibraryProblem, fit: LibraryFit, most: int = MOST) -> tuple[Variation, ...]:
    """The leading smooth variations beside `fit`, those that closes most first; empty where none is beyond chance."""
    base = Projection.beside(fit.nuisance)
    residual = base(fit.residual)
    rows = len(residual)
    found: list[tuple[float, Variation]] = []
    tried = list(_columns(problem, fit))
    for quantity, variable, values, centre, reach, columns in tried:
        left = base(columns)
        own, singular, right = np.linalg.svd(left, full_matrices=False)
        seen = singular > 1e-3 * max(float(np.max(np.linalg.norm(columns, axis=0))), 1e-300)
        if not seen.any():
            continue
        loads = own[:, seen].T @ residual
        gain, rank = float(loads @ loads), int(seen.sum())
        rest = (float(residual @ residual) - gain) / max(rows - base.rank - rank, 1)
        p = min(1.0, len(tried) * float(fdtrc(rank, rows, gain / rank / rest)))
        if p > LEVEL:
            continue
        inverse = right[seen].T / singular[seen]
        coefficients = -(inverse @ loads)
        unit = MICRON if quantity in ABSOLUTE else 1.0
        grid = np.linspace(float(np.min(values)), float(np.max(values)), CURVE_POINTS)
        shapes = legendre_basis(grid, centre, reach, DEGREE)[:, 1 : columns.shape[1] + 1]
        band = np.sqrt(max(rest, 1.0)) * np.linalg.norm(shapes @ inverse, axis=1)
        excess = max(fit.chi2 - rows, gain)
        variation = Variation(
            quantity, variable, "m" if quantity in ABSOLUTE else "1", grid, unit * (shapes @ coefficients), unit * band,
            gain, p, float(np.clip(gain / excess, 0.0, 1.0)), (0.0, *(unit * coefficients)), centre, reach,
        )  # fmt: skip
        found.append((gain - 3.0 * rank, variation))
    found.sort(key=lambda item: -item[0])
    return tuple(variation for _, variation in found[:most])


def _columns(
    problem: LibraryProblem, fit: LibraryFit
) -> Iterator[tuple[str, str, np.ndarray, float, float, np.ndarray]]:
    """(quantity, variable, its values over all rows, centre, reach, whitened columns (rows, degrees)) of every pair."""
    at = _white(problem, fit)
    reference = {"underlap": fit.values["underlap"], "null_bias": fit.values["null_bias"], "oil": problem.record.oil}
    for variable in VARIABLES:
        try:
            of_test = {name: variable_values(variable, test, reference) for name, test in problem.tests.items()}
        except ValueError:  # a column that this record does not have
            continue
        values = np.concatenate([of_test[key[0]] for key in problem.rows()])
        low, high = float(np.min(values)), float(np.max(values))
        if not np.isfinite(high - low) or high - low <= 1e-9 * max(abs(low), abs(high), 1e-300):
            continue
        centre, reach = 0.5 * (low + high), 0.5 * (high - low)
        levels = len(np.unique(np.round((values - centre) / reach, 2)))
        shapes = legendre_basis(values, centre, reach, min(DEGREE, max(levels - 1, 1)))[:, 1:]
        for quantity in COLUMNS:
            yield quantity, variable, values, centre, reach, _times(problem, at, quantity, shapes)


def term_columns(problem: LibraryProblem, fit: LibraryFit, term: LearnedTerm) -> np.ndarray:
    """Whitened columns (rows, degrees) of a term's coefficients but the constant one; absolute ones per micron."""
    reference = {"underlap": term.underlap, "null_bias": term.null_bias, "oil": problem.record.oil}
    values = np.concatenate(
        [variable_values(term.variable, problem.tests[key[0]], reference) for key in problem.rows()]
    )
    shapes = legendre_basis(values, term.centre, term.reach, len(term.coefficients) - 1)[:, 1:]
    if term.quantity not in ABSOLUTE:  # a column holds the slope to the fitted value, which the term multiplies
        now = np.concatenate([term_values(term, problem.tests[key[0]], problem.record.oil) for key in problem.rows()])
        shapes = shapes / (1.0 + now)[:, None]
    columns = _times(problem, _white(problem, fit), term.quantity, shapes)
    return columns if problem.used is None else columns * fit.used[:, None]


def _white(problem: LibraryProblem, fit: LibraryFit) -> LibraryFit:
    """Columns at a fit in units of the noise, not whitened."""
    white = Noise(problem.noise.std, dict.fromkeys(problem.noise.correlation, NoiseCorrelation()))
    return problem.with_noise(white).evaluate(fit.values, fit.effects)


def _times(problem: LibraryProblem, at: LibraryFit, quantity: str, shapes: np.ndarray) -> np.ndarray:
    """A quantity's own column times shapes (readings, degrees), whitened; zero in the rows of priors."""
    size = MICRON if quantity in ABSOLUTE else _size(quantity, at)
    slope = at.column(COLUMNS[quantity]) * size
    block = np.zeros((len(at.residual), shapes.shape[1]))
    first = 0
    for key, place in problem.rows().items():
        count = place.stop - place.start
        filter_ = whitening_of(problem.noise.correlation[key], problem.sweeps(key[0]), count)
        block[place] = whiten_on_host(filter_, slope[place, None] * shapes[first : first + count])
        first += count
    return block


def _size(quantity: str, fit: LibraryFit) -> float:
    """What a relative change of 1 is in the column's own unit."""
    return 1.0 + fit.values.get("viscosity_shift", 0.0) if quantity == "viscosity" else fit.values[quantity]
