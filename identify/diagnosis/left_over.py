"""Test what a diagnosed model still misses: smooth curves over a record's conditions, by an F test, and what they would mean.

Three steps. Legendre polynomials over the conditions, and a shift of the position from spot to spot, which a winding makes and no such
polynomial follows, stand for a misfit of no known cause (`misfit_left`). A quantity's own
column times Legendre polynomials of a variable asks which quantity of the model would have to vary with what for the gap to
close (`variations_of`): after Kristensen, Madsen and Jørgensen (Computers and Chemical Engineering 28, 2004), who let suspect
parameters drift to see where a model is deficient. Where the user asks for it, `learn` adds the leading variation to the model
and fits its coefficients with everything else. All of it is empirical: it says where to look, not why.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from scipy.special import fdtrc

from thermohyd.effects.library import factor_on
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.problem import Key, Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.learned_terms import ABSOLUTE, LearnedTerm, legendre_basis, term_values, variable_values
from thermohyd.identify.model.typed_terms import lines_between
from thermohyd.identify.noise.whitening import whiten_on_host

from .result import Variation
from .screening import LEAST_KEPT, Projection


# Bends of a curve over a sweep, and of one over time, where a step's answer rings: each column costs the test power, and what bends more
# often shows in `where`. Of more runs than that each would need columns of its own: they share them.
DEGREE = 5
DEGREE_IN_TIME, MOST_RUNS_APART = 9, 4


def smooth_columns(test: TestRecord) -> np.ndarray:
    """(rows, k): Legendre polynomials over the position, alone and times temperature, supply pressure and direction.

    The position counts by its rank: a bench puts its points where the curve moves. Over time, run by run, in motion.
    """
    if test.in_motion:
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


def smooth_in_time(test: TestRecord) -> np.ndarray:
    """(rows, k): Legendre polynomials over each run's rows; runs beyond the first few share theirs."""
    degree = DEGREE_IN_TIME if test.axis == "time" else DEGREE
    shared = np.minimum(test.run, MOST_RUNS_APART - 1)
    columns = np.zeros((test.rows, (degree + 1) * (int(shared.max()) + 1)))
    for code in np.unique(test.run):
        rows = np.flatnonzero(test.run == code)
        rank = np.argsort(np.argsort(test.place[rows], kind="stable"), kind="stable")
        first = int(shared[rows[0]]) * (degree + 1)
        columns[rows, first : first + degree + 1] = legendre.legvander(2.0 * rank / max(len(rows) - 1, 1) - 1.0, degree)
    return columns


def _scaled(column: np.ndarray | None, least: float = 1e-3) -> np.ndarray | None:
    """From -1 to 1; None where it varies by no more than this share of its size."""
    if column is None:
        return None
    low, high = float(np.min(column)), float(np.max(column))
    if high - low <= least * max(abs(high), abs(low), 1e-300):
        return None
    return 2.0 * (column - low) / (high - low) - 1.0


def smooth_block(problem: Problem, rows: int) -> np.ndarray:
    """Smooth columns of every channel, whitened like a residual of `rows` rows (priors last, untouched)."""
    blocks = [whitened(problem, key, smooth_columns(problem.tests[key[0]]), rows) for key in problem.rows()]
    return np.concatenate(blocks, axis=1)


def whitened(problem: Problem, key: Key, columns: np.ndarray, rows: int) -> np.ndarray:
    """What columns (own rows, k) of a channel, SI, are in a residual of `rows` rows: in shares of its noise and whitened as that is, 0 in
    rows that share no errors with its own."""
    weight = 1.0 / problem.noise.std[key]
    block = np.zeros((rows, columns.shape[1]))
    block[problem.rows()[key]] = whiten_on_host(problem.whitening(key), columns * weight[:, None])
    return problem.decorrelated(block.T).T


@dataclass(frozen=True)
class LackOfFit:
    """F test of curves beside a fitted model."""

    p_value: float
    chi2: float  # that the curves would take off
    degrees_of_freedom: int


def misfit_left(problem: Problem, fit: Fit, block: np.ndarray) -> LackOfFit:
    """Whether anything smooth still explains something beside `fit`: curves over the conditions (`block`), a shift of the position that
    differs from spot to spot, a quantity of the model that varies with a condition, or a sensor whose error goes with what it reads. The
    test of least chance, its p-value times the number of these four, and of the last two times the number of their like.

    Those have few columns each: what goes with one quantity is found where it is too small for a test of a hundred curves.
    """
    families = families_left(problem, fit, block)
    found, alike = min(
        ((one, len(family)) for family in families.values() for one in family), key=lambda of: of[0].p_value * of[1]
    )
    return replace(found, p_value=min(1.0, sum(map(bool, families.values())) * alike * found.p_value))


def families_left(problem: Problem, fit: Fit, block: np.ndarray) -> dict[str, list[LackOfFit]]:
    """The tests of `misfit_left` by what they ask: "curves", "positions", "conditions", "readings"; in motion curves alone.

    The p-value of each test alone is uniform where nothing is left.
    """
    ask = CurvesBeside.of(fit)
    if problem.in_motion:
        return {"curves": [ask(block)]}
    at = _white(problem, fit)
    along = _along_the_position(problem, at)
    return {
        "curves": [ask(block)],
        "positions": [] if along is None else [ask(along)],
        "conditions": [
            ask.few(pair.columns) for pair in _pairs(problem, at, DEGREE, _rank) if not pair.of_the_position
        ],
        "readings": [ask.few(columns) for columns in _bent_readings(problem, at)],
    }


def _along_the_position(problem: Problem, at: Fit) -> np.ndarray | None:
    """Whitened columns (rows, KNOTS) of a shift of the position from knot to knot; None where a null is held."""
    if "null_bias" not in problem.plans or problem.plans["null_bias"].absent:
        return None
    position = np.concatenate([problem.tests[key[0]].spool_position for key in problem.rows()])
    low, high = float(np.min(position)), float(np.max(position))
    if not high > low:
        return None
    return _times(problem, at, "null_bias", lines_between(position, low, high))


def _bent_readings(problem: Problem, at: Fit) -> Iterator[np.ndarray]:
    """Of each channel whitened columns (rows, DEGREE) of a sensor whose error goes with what it reads, by the model. at: `_white`."""
    for key in problem.rows():
        values = problem.read_by_model(key, at)
        scaled = _scaled(_rank(values)) if np.isfinite(values).all() else None
        if scaled is None:
            continue
        shapes = legendre.legvander(scaled, DEGREE)[:, 1:]
        yield whitened(problem, key, shapes, len(at.residual))


@dataclass(frozen=True)
class CurvesBeside:
    """Whether curves still explain something beside a fit.

    used (rows,): the rows that count; base: beside the fit's own columns there; residual: what these leave of the fit's.
    """

    used: np.ndarray
    base: Projection
    residual: np.ndarray

    @classmethod
    def of(cls, fit: Fit) -> "CurvesBeside":
        base = Projection.beside(fit.nuisance[fit.used])
        return cls(fit.used, base, base(fit.residual[fit.used]))

    def __call__(self, block: np.ndarray) -> LackOfFit:
        """F test of curves (rows, k), whitened; the rest measures the noise."""
        return self._test(Projection.beside(self.base(block[self.used])).q)

    def few(self, columns: np.ndarray) -> LackOfFit:
        """The same of few columns, without what the fit's own leave a thousandth of: there a step is bent."""
        own = columns[self.used]
        length = np.linalg.norm(own, axis=0)
        if not np.isfinite(length).all():
            return LackOfFit(1.0, 0.0, 0)
        left = self.base(own[:, length > 0.0] / length[length > 0.0])
        squares, turn = np.linalg.eigh(left.T @ left)
        kept = squares > LEAST_KEPT**2
        return self._test(left @ (turn[:, kept] / np.sqrt(squares[kept])))

    def _test(self, q: np.ndarray) -> LackOfFit:
        rank = q.shape[1]
        taken = float(np.sum((q.T @ self.residual) ** 2))
        rest = float(np.sum(self.residual**2)) - taken
        degrees_of_freedom = len(self.residual) - self.base.rank - rank
        if rank == 0 or degrees_of_freedom < 10:
            return LackOfFit(1.0, taken, rank)
        noise = max(rest / degrees_of_freedom, 0.5)
        return LackOfFit(float(fdtrc(rank, degrees_of_freedom, taken / rank / noise)), taken, rank)


QUANTITIES = (
    "discharge_coefficient", "transition_number", "clearance", "edge_radius", "underlap", "null_bias", "viscosity",
)  # fmt: skip
VARIABLES = (
    "spool_position", "opening", "temperature", "supply_pressure", "load_pressure", "flow_number", "direction", "rate",
    "elapsed",
)  # fmt: skip
OF_THE_POSITION = ("spool_position", "opening", "flow_number", "direction")
DEGREE_OF_VARIATION = 3  # what a reader can still put in words: a slope, a bend, and one turn
LEVEL = 1e-3  # of all variations together: they say where to look and change no model, so a level between those of names and of chance
MOST = 3  # that are told
CURVE_POINTS = 41  # of a drawn curve
MICRON = 1e-6  # unit of an absolute quantity's coefficients while they are solved for


def variations_of(problem: Problem, fit: Fit, most: int = MOST) -> tuple[Variation, ...]:
    """The leading smooth variations beside `fit`, those that closes most first; empty where none is beyond chance."""
    base = Projection.beside(fit.nuisance)
    residual = base(fit.residual)
    rows = len(residual)
    found: list[tuple[float, Variation]] = []
    tried = list(_pairs(problem, _white(problem, fit), DEGREE_OF_VARIATION, np.asarray))
    for pair in tried:
        values, columns = pair.values, pair.columns
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
        unit = MICRON if pair.quantity in ABSOLUTE else 1.0
        grid = np.linspace(float(np.min(values)), float(np.max(values)), CURVE_POINTS)
        shapes = legendre_basis(grid, pair.centre, pair.reach, DEGREE_OF_VARIATION)[:, 1 : columns.shape[1] + 1]
        band = np.sqrt(max(rest, 1.0)) * np.linalg.norm(shapes @ inverse, axis=1)
        excess = max(fit.chi2 - rows, gain)
        variation = Variation(
            pair.quantity, pair.variable, "m" if pair.quantity in ABSOLUTE else "1", grid, unit * (shapes @ coefficients),
            unit * band, gain, p, float(np.clip(gain / excess, 0.0, 1.0)), (0.0, *(unit * coefficients)), pair.centre, pair.reach,
        )  # fmt: skip
        found.append((gain - 3.0 * rank, variation))
    found.sort(key=lambda item: -item[0])
    return tuple(variation for _, variation in found[:most])


@dataclass(frozen=True)
class _Pair:
    """A quantity that varies with a condition: its values (readings,), and whitened columns (rows, degrees), none for a constant."""

    quantity: str
    variable: str
    values: np.ndarray
    columns: np.ndarray

    @property
    def of_the_position(self) -> bool:
        """Whether it is a shift of the position that goes with it: a knot's, and an error of what was read goes with what was read."""
        return self.quantity == "null_bias" and self.variable in OF_THE_POSITION

    @property
    def centre(self) -> float:
        return 0.5 * float(np.min(self.values) + np.max(self.values))

    @property
    def reach(self) -> float:
        return 0.5 * float(np.ptp(self.values))


def _pairs(problem: Problem, at: Fit, degree: int, measure: Callable[[np.ndarray], np.ndarray]) -> Iterator[_Pair]:
    """Every pair, by Legendre polynomials of a measure of the condition (readings,). at: `_white`."""
    reference = {"underlap": at.values["underlap"], "null_bias": at.values["null_bias"], "oil": problem.record.oil}
    for variable in VARIABLES:
        try:
            of_test = {name: variable_values(variable, test, reference) for name, test in problem.tests.items()}
        except ValueError:  # a column that this record does not have
            continue
        values = np.concatenate([of_test[key[0]] for key in problem.rows()])
        scaled = _scaled(measure(values), 1e-9) if np.isfinite(values).all() else None
        if scaled is None:
            continue
        levels = len(np.unique(np.round(scaled, 2)))
        shapes = legendre.legvander(scaled, min(degree, max(levels - 1, 1)))[:, 1:]
        for quantity in QUANTITIES:
            if quantity in problem.plans and problem.plans[quantity].absent:
                continue
            if (factor_on(quantity) or quantity) not in at.order:  # of a model with a typed term
                continue
            yield _Pair(quantity, variable, values, _times(problem, at, quantity, shapes))


def _rank(values: np.ndarray) -> np.ndarray:
    """Share of values below each, those that are alike in the middle."""
    _, which, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - 0.5 * count)[which] / len(values)


def term_columns(problem: Problem, fit: Fit, term: LearnedTerm) -> np.ndarray:
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


def _white(problem: Problem, fit: Fit) -> Fit:
    """Columns at a fit in units of the noise, not whitened."""
    return problem.with_noise(problem.noise.white).evaluate(fit.values, fit.effects)


def _times(problem: Problem, at: Fit, quantity: str, shapes: np.ndarray) -> np.ndarray:
    """A quantity's own column times shapes (readings, degrees), whitened; zero in the rows of priors."""
    size = MICRON if quantity in ABSOLUTE else _size(quantity, at)
    slope = at.column(factor_on(quantity) or quantity) * size
    return whitened_rows(problem, slope[: len(shapes), None] * shapes, len(at.residual))


def whitened_rows(problem: Problem, columns: np.ndarray, rows: int) -> np.ndarray:
    """Columns (readings, k) in units of the noise, whitened like a residual of `rows` rows; zero in those of priors."""
    block = np.zeros((rows, columns.shape[1]))
    for key, place in problem.rows().items():
        block[place] = whiten_on_host(problem.whitening(key), columns[place])
    return problem.decorrelated(block.T).T


def _size(quantity: str, fit: Fit) -> float:
    """What a relative change of 1 is in the column's own unit."""
    factor = factor_on(quantity)
    return fit.values[quantity] if factor is None else 1.0 + fit.values.get(factor, 0.0)


ROUNDS = 6  # of Gauss-Newton, which ends by `SETTLED` before
SETTLED = 1e-3  # of a coefficient's standard error


def learn(problem: Problem, fit: Fit, variation: Variation) -> tuple[Problem, Fit, LearnedTerm]:
    """The problem with the variation as a term of the model, its fit, and the term.

    Gauss-Newton in the coefficients, with the parameters refitted at every round: the compiled fit takes the term as
    data, so learning compiles nothing.
    """
    term = LearnedTerm(
        variation.quantity, variation.variable, variation.centre, variation.reach,
        tuple(0.0 for _ in variation.coefficients), fit.values["underlap"], fit.values["null_bias"],
    )  # fmt: skip
    best, best_term = fit, term
    for _ in range(ROUNDS):
        columns = term_columns(problem.with_terms(term), fit, term)[fit.used]
        base = Projection.beside(fit.nuisance[fit.used])
        left, residual = base(columns), base(fit.residual[fit.used])
        own, singular, right = np.linalg.svd(left, full_matrices=False)
        seen = singular > 1e-6 * singular[0]
        loads = own[:, seen].T @ residual
        step = -(right[seen].T / singular[seen]) @ loads
        unit = 1e-6 if term.quantity in ABSOLUTE else 1.0
        term = replace(
            term, coefficients=(0.0, *(c + unit * s for c, s in zip(term.coefficients[1:], step, strict=True)))
        )
        fit = problem.with_terms(term).fit(fit.effects, fit.values)
        if fit.chi2 < best.chi2:
            best, best_term = fit, term
        if float(np.max(np.abs(loads))) < SETTLED:
            break
    return problem.with_terms(best_term), best, best_term
