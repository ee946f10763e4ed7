"""Score a table of typed terms beside a fitted model: every law of every variable at every place of the circuit, at once.

A column of the table is what a shift of a place does to each reading (`Problem.with_places`) times a law of a variable; in motion, what a
run's derivative says of the law. Scores as those of effects (`screening`), error control over the whole table.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.places import OF_READING, Place, place_of, places_for, places_in_motion, read_as
from thermohyd.identify.model.term_variables import VARIABLES, States, asked_with
from thermohyd.identify.model.typed_terms import KNOTS, TypedTerm, shapes_at, thinning_of, thins, values_of
from thermohyd.identify.report.known_physics import known_physics

from .left_over import whitened_rows
from .max_t import MaxT
from .screening import LEAST_KEPT, Projection


DRAWS = 4000  # of the largest score: a p-value of 1e-3 is then known to 50 %, and none below counts
VARIES = 0.02  # of the oil's thinning, from which a laminar law is not the proportional one
AS_GOOD = 6.0  # chi-square, in units of what the best leaves, up to which another pair does as well
ALIKE = 0.995  # cosine of two directions beyond which no reading tells them apart


@dataclass(frozen=True)
class Entry:
    """One law of one variable at one place beside a model, and where the variable was.

    columns (rows, coefficients): whitened, of length 1; length (coefficients,): what that was, per unit of each coefficient.
    moving: of tests in motion.
    """

    place: str
    variable: str
    law: str
    columns: np.ndarray
    length: np.ndarray
    low: float
    high: float
    moving: bool = False

    @property
    def pair(self) -> tuple[str, str]:
        return self.place, self.variable

    @property
    def key(self) -> tuple[str, str, str]:
        """What tells it from the other entries of a table."""
        return self.place, self.variable, self.law


# Chi-square by which a pair that no known physics shows must do better than one that some does: 2 ln 20, as the few dozen pairs of the
# list say what is missing in four records of five, and hundreds share the fifth. By which one that is known by other laws must.
UNHEARD_OF, UNUSUAL = 6.0, 1.0


def prior_of(entry: Entry) -> float:
    """Chi-square that an entry must gain beyond what its coefficients cost."""
    known = known_physics(entry.place, entry.variable, entry.law, moving=entry.moving)
    unheard_of = UNHEARD_OF if known is None else 0.0 if known.usual(entry.law) else UNUSUAL
    return unheard_of + place_of(entry.place, moving=entry.moving).prior


@dataclass(frozen=True)
class Scored:
    """An entry's chi-square gain beside the model, its rank, and what it leaves of unit directions (rows, rank)."""

    entry: Entry
    gain: float
    rank: int
    directions: np.ndarray

    def cost(self, rows: int) -> float:
        """Chi-square that it must gain: the penalty of the Bayesian information criterion, so that a simpler law wins unless the data say
        otherwise, and what its place and physics ask beforehand."""
        return self.rank * float(np.log(rows)) + prior_of(self.entry)

    def merit(self, noise: float, rows: int) -> float:
        """Gain less what it costs."""
        return self.gain / noise - self.cost(rows)


Law = tuple[str, str, np.ndarray, float, float]  # variable, law, columns (readings, coefficients), low, high


def _laws(problem: Problem, fit: Fit, place: Place, slopes: list[np.ndarray], states: States) -> Iterator[Law]:
    """Every law of every variable that a place is asked with; slopes: `slope_of` of each of its parts."""
    thin = _at_readings(thinning_of, problem, states)
    shown, null = np.any([slope != 0.0 for slope in slopes], axis=0), fit.values["null_bias"]
    for variable in VARIABLES.values():
        if not asked_with(place, variable):
            continue
        values = [
            own for part in place.parts if (own := _values(problem, variable.name, part, states, null)) is not None
        ]
        if not values:
            continue
        seen = np.concatenate([own[slope != 0.0] for own, slope in zip(values, slopes, strict=True)])
        low, high = float(np.min(seen)), float(np.max(seen))
        constant = variable.name == "constant"
        if not np.isfinite(high - low) or (not constant and high - low <= 1e-6 * max(abs(low), abs(high), 1e-300)):
            continue
        levels = 1 if constant else len(np.unique(np.round((seen - low) / (high - low), 2)))
        laws = ["constant"] if constant else ["proportional"]
        laws += ["square", "root"] if variable.powers else []
        laws += ["cube"] if variable.powers and place.name.startswith(OF_READING) else []
        laws += (
            ["laminar"]
            if place.leaks and variable.unit == "Pa" and np.ptp(thin[shown]) > VARIES * thin[shown].mean()
            else []
        )
        laws += ["smooth"] if levels > 2 else []
        laws += ["local"] if variable.name in place.followed and levels > KNOTS else []
        for law in laws:
            parts = [
                slope[:, None] * shapes_at(law, own, low, high, thin) for slope, own in zip(slopes, values, strict=True)
            ]
            yield variable.name, law, np.sum(parts, axis=0), low, high


def scores_of(
    problem: Problem, fit: Fit, slopes: dict[str, np.ndarray], states: States
) -> tuple[list[Scored], Projection]:
    """Every entry of the table beside a fit that the parameters do not swallow; problem: with states."""
    base = Projection.beside(fit.nuisance * fit.used[:, None])
    residual = base(fit.residual * fit.used)
    found: list[Scored] = []
    for place in places_for(problem.tests):
        of_parts = [slope_of(problem, fit, part, slopes, states) for part in place.parts]
        laws = list(_laws(problem, fit, place, of_parts, states)) if np.any(of_parts) else []
        if not laws:
            continue
        columns = _whitened(problem, fit, np.concatenate([own for _, _, own, _, _ in laws], axis=1))
        length = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(length > 0.0, length, 1.0)
        left, first = base(columns), 0
        for variable, law, raw, low, high in laws:
            own = slice(first, first + raw.shape[1])
            first = own.stop
            entry = Entry(place.name, variable, law, columns[:, own], length[own], low, high)
            score = _scored(entry, left[:, own], residual)
            if score is not None:
                found.append(score)
    return found, base


STOOD_STILL = 1e-6  # of a variable's size, over which it must have ranged


def scores_in_motion(problem: Problem, fit: Fit) -> tuple[list[Scored], Projection]:
    """Every entry of the table of tests in motion beside a fit that the parameters do not swallow.

    A variable that stood still is not asked. Without a step test there is none.
    """
    # Here, not above: a static problem does not wait for the solvers of motion.
    from thermohyd.identify.fitting.motion_term_columns import laws_of, ranges_of

    base = Projection.beside(fit.nuisance * fit.used[:, None])
    residual = base(fit.residual * fit.used)
    channels = (c.name for test in problem.tests.values() for c in test.channels)
    laws = tuple(law for place in places_in_motion(channels) for law in laws_of(place.name))
    columns, ranges = problem.table_in_motion(fit, laws)
    found: list[Scored] = []
    for law, raw in zip(laws, columns if ranges else (), strict=bool(ranges)):
        low, high = ranges_of(law.place, law.variable, ranges)
        if law.law != "constant" and high - low <= STOOD_STILL * max(abs(low), abs(high), 1e-300):
            continue
        length = np.linalg.norm(raw, axis=0)
        own = raw / np.where(length > 0.0, length, 1.0)
        score = _scored(
            Entry(law.place, law.variable, law.law, own, length, low, high, moving=True), base(own), residual
        )
        if score is not None:
            found.append(score)
    return found, base


def _scored(entry: Entry, left: np.ndarray, residual: np.ndarray) -> Scored | None:
    """left: the entry's columns beside the parameters; None where these swallow it."""
    if not entry.length.all() or not np.isfinite(left).all():
        return None
    if left.shape[1] == 1:
        size = float(np.linalg.norm(left))
        if size <= LEAST_KEPT:
            return None
        own = left / size
    else:
        q, triangle = np.linalg.qr(left)
        turn, singular, _ = np.linalg.svd(triangle)
        own = q @ turn[:, singular > LEAST_KEPT]
        if not own.shape[1]:
            return None
    loads = own.T @ residual
    return Scored(entry, float(loads @ loads), own.shape[1], own)


def slope_of(problem: Problem, fit: Fit, place: Place, slopes: dict[str, np.ndarray], states: States) -> np.ndarray:
    """(readings,): what a shift of a place, or of a part of it, does to each residual, before whitening, in units of its noise."""
    found = np.zeros(len(next(iter(slopes.values()))))
    for entry, sign in place.entries.items():
        found += sign * slopes[entry]
    if place.warms:
        found *= -_at_readings(thins, problem, states)
    for key, rows in problem.rows().items():
        sign = place.readings.get(read_as(problem.tests[key[0]], key[1]))
        if sign is not None:
            found[rows] += sign * problem.factor_of(key, fit) / problem.noise.std[key]
    return np.where(np.isfinite(found), found, 0.0)


def _values(problem: Problem, variable: str, place: Place, states: States, null: float) -> np.ndarray | None:
    """(readings,): a variable at each reading's row; None where a test lacks a column."""
    try:
        of_test = {name: values_of(variable, place, test, states, null) for name, test in problem.tests.items()}
    except ValueError:
        return None
    return np.concatenate([of_test[key[0]] for key in problem.rows()])


def _at_readings(of: Callable[[TestRecord, States], np.ndarray], problem: Problem, states: States) -> np.ndarray:
    """(readings,): what `of` gives of a test's rows, at each reading's row."""
    return np.concatenate([of(problem.tests[key[0]], states) for key in problem.rows()])


def _whitened(problem: Problem, fit: Fit, columns: np.ndarray) -> np.ndarray:
    """Columns (readings, k) in units of the noise, whitened as the residual is, zero in the rows of priors and in rows not used."""
    return whitened_rows(problem, columns, len(fit.residual)) * fit.used[:, None]


def term_columns(
    problem: Problem, fit: Fit, term: TypedTerm, slopes: dict[str, np.ndarray], states: States
) -> np.ndarray:
    """Whitened columns (rows, coefficients) of a term at the model's present states."""
    thin, found = _at_readings(thinning_of, problem, states), []
    for part in place_of(term.place).parts:
        values = _values(problem, term.variable, part, states, term.null_bias)
        assert values is not None
        shapes = shapes_at(term.law, values, term.low, term.high, thin)
        slope = slope_of(problem, fit, part, slopes, states)
        if part.warms:  # exp(-thins shift), as it stands
            slope = slope * np.exp(-_at_readings(thins, problem, states) * (shapes @ np.asarray(term.coefficients)))
        found.append(slope[:, None] * shapes)
    return _whitened(problem, fit, np.sum(found, axis=0))


@dataclass(frozen=True)
class Table:
    """All entries beside a model; noise: variance that the best of them leaves; rows: readings that count."""

    entries: tuple[Scored, ...]
    law: MaxT
    chi2: float  # of the projected residual
    noise: float
    rows: int

    def p_value(self, found: Scored) -> float:
        """Of the largest of all entries: of single columns by max-T, of smooth ones Fisher's F by Bonferroni, twice for both kinds."""
        freedom = max(self.rows - found.rank, 1)
        rest = max((self.chi2 - found.gain) / freedom, 1e-300)
        if found.rank == 1:
            return min(1.0, 2.0 * self.law.p_value(float(np.sqrt(found.gain / rest))))
        count = sum(entry.rank > 1 for entry in self.entries)
        return min(1.0, 2.0 * count * float(fdtrc(found.rank, freedom, found.gain / found.rank / rest)))

    @property
    def ranked(self) -> list[Scored]:
        """The best law of each pair of place and variable, the best first."""
        best: dict[tuple[str, str], Scored] = {}
        for found in self.entries:
            now = best.get(found.entry.pair)
            if now is None or found.merit(self.noise, self.rows) > now.merit(self.noise, self.rows):
                best[found.entry.pair] = found
        return sorted(best.values(), key=lambda f: -f.merit(self.noise, self.rows))


def opened(problem: Problem, fit: Fit) -> Problem:
    """The problem with its places open to terms, which in static tests are counted at the model's states at a fit."""
    if problem.in_motion:
        return problem
    return _counted_at(problem, fit)[0]


def _counted_at(problem: Problem, fit: Fit) -> tuple[Problem, dict[str, np.ndarray], States]:
    """Of static tests: the problem `opened`, what a shift of each place does, and the model's states at the fit."""
    problem = problem.with_states({})
    slopes, states = problem.with_places(fit)
    return problem.with_states(states), slopes, states


def table_of(problem: Problem, fit: Fit) -> tuple[Table, Problem]:
    """The table beside a fit, and the problem `opened`."""
    if problem.in_motion:
        found, base = scores_in_motion(problem, fit)
    else:
        problem, slopes, states = _counted_at(problem, fit)
        found, base = scores_of(problem, fit, slopes, states)
    residual = base(fit.residual * fit.used)
    chi2, rows = float(residual @ residual), int(fit.used.sum()) - base.rank
    best = max((s.gain for s in found), default=0.0)
    noise = max((chi2 - best) / max(rows, 1), 1.0)
    singles = [s.directions[:, 0] for s in found if s.rank == 1]
    directions = np.stack(singles, axis=1) if singles else np.zeros((len(residual), 0))
    law = MaxT.of(directions, np.zeros(directions.shape[1], dtype=bool), DRAWS)
    return Table(tuple(found), law, chi2, noise, rows), problem


def acting_like(problem: Problem, fit: Fit, scale: float) -> dict[str, tuple[tuple[str, str], ...]]:
    """{effect of a fit: pairs of place and variable that by one amount show what it shows, to first order, the likeliest first}.

    Whatever acts so reads alike, be it in the library or not: beside the parameters and the other effects its column leaves less of what
    the effect explains than rivals may, or points the same way. Of static tests; nothing beside oil stored at the ports.
    scale: variance that the fit leaves.
    """
    if problem.in_motion or not fit.physics or any(stores(name) for name in fit.effects):
        return {}
    problem, slopes, states = _counted_at(problem, fit)
    rows, found = int(fit.used.sum()), {}
    for name in fit.physics:
        shown = fit.columns[:, fit.order.index(name)] * fit.values[name]
        scored, base = scores_of(problem, replace(fit, residual=shown, active=fit.active | {name}), slopes, states)
        explained = float(np.sum(base(shown * fit.used) ** 2))
        near = min(explained - AS_GOOD * scale, ALIKE**2 * explained)
        alike = [s for s in scored if s.rank == 1 and s.gain > near]
        alike.sort(key=lambda s: -s.merit(scale, rows))
        found[name] = tuple(dict.fromkeys(s.entry.pair for s in alike))
    return found


def family(place: str) -> str:
    """The quantity of a place, whichever edges; a reading is one of its own."""
    return place if place.startswith("reading:") else place.split(":")[0]


def blank(entry: Entry, fit: Fit, coefficients: int) -> TypedTerm:
    """The term of an entry with all coefficients 0."""
    return TypedTerm(
        entry.place, entry.variable, entry.law, (0.0,) * coefficients, entry.low, entry.high,
        fit.values.get("null_bias", 0.0), entry.moving,
    )  # fmt: skip
