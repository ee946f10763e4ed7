"""Second tier: which model quantity would have to vary smoothly with which variable for the rest of the gap to close.

A quantity's own column times Legendre polynomials of a variable: after Kristensen, Madsen and Jørgensen (Computers and
Chemical Engineering 28, 2004), who let suspect parameters drift to see where a model is deficient. Empirical: it says
where to look, not why.
"""

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc

from .library_fit import Key, LibraryFit, LibraryProblem
from .projection import Projection
from .record_noise import NoiseFound
from .result import Variation
from .variation_terms import ABSOLUTE, legendre_basis, variable_values
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


def variations_of(
    problem: LibraryProblem, fit: LibraryFit, noise: dict[Key, NoiseFound], most: int = MOST
) -> tuple[Variation, ...]:
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
    white = problem.with_noise(first_noise_of(problem))
    at = white.evaluate(fit.values, fit.effects)
    reference = {name: fit.values[name] for name in ("underlap", "null_bias")}
    tests = problem.tests
    rows = problem.rows()
    for variable in VARIABLES:
        try:
            of_test = {
                name: variable_values(variable, test, {**reference, "oil": problem.record.oil})
                for name, test in tests.items()
            }
        except ValueError:  # a column that this record does not have
            continue
        values = np.concatenate([of_test[key[0]] for key in rows])
        low, high = float(np.min(values)), float(np.max(values))
        if not np.isfinite(high - low) or high - low <= 1e-9 * max(abs(low), abs(high), 1e-300):
            continue
        centre, reach = 0.5 * (low + high), 0.5 * (high - low)
        levels = len(np.unique(np.round((values - centre) / reach, 2)))
        degree = min(DEGREE, max(levels - 1, 1))
        shapes = legendre_basis(values, centre, reach, degree)[:, 1:]
        for quantity, column in COLUMNS.items():
            if column not in at.order:
                continue
            size = MICRON if quantity in ABSOLUTE else _size(quantity, fit)
            slope = at.column(column) * size
            block = np.zeros((len(at.residual), degree))
            first = 0
            for key, place in rows.items():
                count = place.stop - place.start
                own = slope[place, None] * shapes[first : first + count]
                filter_ = whitening_of(problem.noise.correlation[key], problem.sweeps(key[0]), count)
                block[place] = whiten_on_host(filter_, own)
                first += count
            yield quantity, variable, values, centre, reach, block


def _size(quantity: str, fit: LibraryFit) -> float:
    """What a relative change of 1 is in the column's own unit."""
    return 1.0 + fit.values.get("viscosity_shift", 0.0) if quantity == "viscosity" else fit.values[quantity]
