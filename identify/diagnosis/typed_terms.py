"""Ask at which place of the circuit something is missing, and with which quantity it goes: score tests over a table of typed terms.

A column of the table is what a shift of a place does to each reading (`Problem.with_places`) times a law of a variable. All are scored
at once beside the final model; the leading ones are fitted inside the model, parameters and all, and judged on rows that they were
not fitted to. A term says where and with what, never why: after Kristensen, Madsen and Jørgensen (Computers and Chemical Engineering
28, 2004), who ask which state of a grey-box model lacks something, here with places of the circuit and control of false ones.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.typed_terms import (
    VARIABLES,
    Place,
    States,
    TypedTerm,
    asked_with,
    basis,
    place_of,
    places_for,
    read_as,
    values_of,
)

from .case import Progress
from .confirmation import PROVEN, parts_left_out, predicted_apart
from .final_model import ON_HELD_OUT, closed, mean_square
from .held_out import Split
from .left_over import whitened_rows
from .max_t import MaxT
from .screening import LEAST_KEPT, Projection


LEVEL = 1e-3  # of the whole table
DRAWS = 4000
ASKED_BY_REFIT = 6  # pairs of place and variable
FROM_ONE_PLACE = 3  # of these at most
MOST = 3  # terms that are told
SIMPLE_LAWS = 3  # of the leading place, that are asked in the end
AS_GOOD = 6.0  # chi-square, in units of what the best leaves, up to which another pair does as well
CURVE_POINTS = 41
ROUNDS, TRIES, PATIENT = 6, 3, 20  # of Gauss-Newton
DAMPED = 30.0
BENT = 1.5  # reduced chi-square from which a model counts as bent
STRAIGHTENED = 3  # times that a table is asked anew
SETTLED, ENOUGH = 0.02, 1e-4  # chi-square, and share of it, that another round would gain


@dataclass(frozen=True)
class Entry:
    """One law of one variable at one place beside a model, and where the variable was.

    columns (rows, coefficients): whitened, of length 1; length (coefficients,): what that was, per unit of each coefficient.
    """

    place: str
    variable: str
    law: str
    columns: np.ndarray
    length: np.ndarray
    low: float
    high: float

    @property
    def pair(self) -> tuple[str, str]:
        return self.place, self.variable


@dataclass(frozen=True)
class Scored:
    """An entry's chi-square gain beside the model, its rank, and what it leaves of unit directions (rows, rank)."""

    entry: Entry
    gain: float
    rank: int
    directions: np.ndarray

    def merit(self, noise: float, rows: int) -> float:
        """Gain less the penalty of the Bayesian information criterion: a simpler law wins unless the data say otherwise."""
        return self.gain / noise - self.rank * float(np.log(rows))


@dataclass(frozen=True)
class FittedTerm:
    """A term fitted inside the model, with the parameters. problem: with the term; std: of its coefficients, by what it leaves.

    joint: covariance of `fit.free` without those at a limit, then the coefficients; None where only a linear step was made.
    """

    term: TypedTerm
    problem: Problem
    fit: Fit
    gain: float
    std: np.ndarray
    joint: np.ndarray | None
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Found:
    """A term that chance does not explain. p_value: of the whole table; gap_closed: on rows held out; proof: 2 ln E, as of an effect."""

    fitted: FittedTerm
    p_value: float
    gap_closed: float
    proof: float
    alternatives: tuple[tuple[str, str], ...]

    @property
    def holds(self) -> bool:
        """Whether it predicts what it was not fitted to, by the rule of effects."""
        return self.gap_closed > ON_HELD_OUT and self.proof > PROVEN

    @property
    def learnable(self) -> bool:
        """Whether it was fitted inside the model, and holds."""
        return self.holds and self.fitted.joint is not None

    @property
    def size(self) -> tuple[float, float]:
        """A law's coefficient and its standard error; of a smooth law the spread of the shift over what was seen, with its own."""
        term, std = self.fitted.term, self.fitted.std
        if term.law != "smooth":
            return term.coefficients[0], float(std[0])
        shapes = basis(term.law, np.linspace(term.low, term.high, CURVE_POINTS), term.low, term.high)
        shift = shapes @ np.asarray(term.coefficients)
        slope = (shapes[int(np.argmax(shift))] - shapes[int(np.argmin(shift))]) * std
        return float(np.ptp(shift)), float(np.linalg.norm(slope))

    @property
    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The variable over what was seen, the shift there and its standard deviation, SI."""
        term = self.fitted.term
        values = np.linspace(term.low, term.high, CURVE_POINTS)
        shapes = basis(term.law, values, term.low, term.high)
        joint = self.fitted.joint
        own = (
            np.diag(self.fitted.std**2) if joint is None else joint[len(self.fitted.names) :, len(self.fitted.names) :]
        )
        band = np.sqrt(np.maximum(np.einsum("ri,ij,rj->r", shapes, own, shapes), 0.0))
        return values, shapes @ np.asarray(term.coefficients), band


Law = tuple[str, str, np.ndarray, float, float]  # variable, law, shapes (readings, coefficients), low, high


def _laws(problem: Problem, fit: Fit, place: Place, shown: np.ndarray, states: States) -> Iterator[Law]:
    """Every law of every variable that a place is asked with; shown (readings,): where a shift of the place shows."""
    for variable in VARIABLES.values():
        if not asked_with(place, variable):
            continue
        values = _values(problem, variable.name, place, states, fit.values["null_bias"])
        if values is None:
            continue
        seen = values[shown]
        low, high = float(np.min(seen)), float(np.max(seen))
        constant = variable.name == "constant"
        if not np.isfinite(high - low) or (not constant and high - low <= 1e-6 * max(abs(low), abs(high), 1e-300)):
            continue
        levels = 1 if constant else len(np.unique(np.round((seen - low) / (high - low), 2)))
        laws = ["constant"] if constant else ["proportional"]
        laws += ["square", "root"] if variable.powers else []
        laws += ["smooth"] if levels > 2 else []
        for law in laws:
            yield variable.name, law, basis(law, values, low, high), low, high


def scores_of(
    problem: Problem, fit: Fit, slopes: dict[str, np.ndarray], states: States
) -> tuple[list[Scored], Projection]:
    """Every entry of the table beside a fit that the parameters do not swallow; problem: with states."""
    base = Projection.beside(fit.nuisance * fit.used[:, None])
    residual = base(fit.residual * fit.used)
    found: list[Scored] = []
    for place in places_for(problem.tests):
        slope = slope_of(problem, fit, place, slopes)
        laws = list(_laws(problem, fit, place, slope != 0.0, states)) if slope.any() else []
        if not laws:
            continue
        columns = _whitened(
            problem, fit, slope[:, None] * np.concatenate([shapes for _, _, shapes, _, _ in laws], axis=1)
        )
        length = np.linalg.norm(columns, axis=0)
        columns = columns / np.where(length > 0.0, length, 1.0)
        left, first = base(columns), 0
        for variable, law, shapes, low, high in laws:
            own = slice(first, first + shapes.shape[1])
            first = own.stop
            entry = Entry(place.name, variable, law, columns[:, own], length[own], low, high)
            score = _scored(entry, left[:, own], residual)
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


def slope_of(problem: Problem, fit: Fit, place: Place, slopes: dict[str, np.ndarray]) -> np.ndarray:
    """(readings,): what a shift of a place does to each residual, before whitening, in units of its noise."""
    found = np.zeros(len(next(iter(slopes.values()))))
    for entry, sign in place.entries.items():
        found += sign * slopes[entry]
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


def _whitened(problem: Problem, fit: Fit, columns: np.ndarray) -> np.ndarray:
    """Columns (readings, k) in units of the noise, whitened as the residual is, zero in the rows of priors and in rows not used."""
    return whitened_rows(problem, columns, len(fit.residual)) * fit.used[:, None]


def term_columns(
    problem: Problem, fit: Fit, term: TypedTerm, slopes: dict[str, np.ndarray], states: States
) -> np.ndarray:
    """Whitened columns (rows, coefficients) of a term at the model's present states."""
    place = place_of(term.place)
    values = _values(problem, term.variable, place, states, term.null_bias)
    assert values is not None
    shapes = basis(term.law, values, term.low, term.high)
    return _whitened(problem, fit, slope_of(problem, fit, place, slopes)[:, None] * shapes)


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


def table_of(problem: Problem, fit: Fit) -> tuple[Table, Problem]:
    """The table beside a fit, and the problem with the model's states."""
    problem = problem.with_states({})
    slopes, states = problem.with_places(fit)
    problem = problem.with_states(states)
    found, base = scores_of(problem, fit, slopes, states)
    residual = base(fit.residual * fit.used)
    chi2, rows = float(residual @ residual), int(fit.used.sum()) - base.rank
    best = max((s.gain for s in found), default=0.0)
    noise = max((chi2 - best) / max(rows, 1), 1.0)
    singles = [s.directions[:, 0] for s in found if s.rank == 1]
    directions = np.stack(singles, axis=1) if singles else np.zeros((len(residual), 0))
    law = MaxT.of(directions, np.zeros(directions.shape[1], dtype=bool), DRAWS)
    return Table(tuple(found), law, chi2, noise, rows), problem


def leading(table: Table) -> list[Scored]:
    """Whom a refit asks: the best pairs, of one place a few."""
    chosen: list[Scored] = []
    for found in table.ranked:
        same = sum(family(c.entry.place) == family(found.entry.place) for c in chosen)
        twin = any(_alike(c, found) for c in chosen)
        if same < FROM_ONE_PLACE and not twin and table.p_value(found) <= LEVEL:
            chosen.append(found)
        if len(chosen) == ASKED_BY_REFIT:
            break
    return chosen


def family(place: str) -> str:
    """The quantity of a place, whichever edges; a reading is one of its own."""
    return place if place.startswith("reading:") else place.split(":")[0]


def blank(entry: Entry, fit: Fit, coefficients: int) -> TypedTerm:
    """The term of an entry with all coefficients 0."""
    return TypedTerm(
        entry.place, entry.variable, entry.law, (0.0,) * coefficients, entry.low, entry.high, fit.values["null_bias"]
    )


@dataclass(frozen=True)
class _Limits:
    """The free entries of a fit and their boxes."""

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, problem: Problem, fit: Fit) -> "_Limits":
        boxes = [problem.box_of(name, fit.values[name]) for name in fit.free]
        return cls(fit.free, np.array([b.lower for b in boxes]), np.array([b.upper for b in boxes]))

    def sides(self, at: Fit) -> np.ndarray:
        """-1 at a lower limit, 1 at an upper one, else 0."""
        now = np.array([at.values[name] for name in self.names])
        return (now >= self.upper).astype(int) - (now <= self.lower).astype(int)

    def kept(self, fit: Fit, at: Fit) -> Fit:
        """A point as a fit of what `fit` freed."""
        sides = dict(zip(self.names, self.sides(at).tolist(), strict=True))
        pressed = frozenset(name for name, side in sides.items() if side)
        active = np.array([sides.get(name, 0) for name in at.order])
        return replace(
            at, effects=fit.effects, free=fit.free, active=pressed, used=fit.used, allowance=fit.allowance,
            solution=replace(at.solution, active=active),
        )  # fmt: skip


def fitted_inside(problem: Problem, fit: Fit, term: TypedTerm, rounds: int = ROUNDS) -> FittedTerm:
    """Fit a term and the parameters together by damped Gauss-Newton steps from `fit`; problem: with states.

    Variables made of the model's own pressures and flows are those of the last round: each round counts them anew. A parameter that a
    bent fit had pressed against a limit is free again, as far as the limit lets it.
    """
    limits = _Limits.of(problem, fit)
    count = len(limits.names)
    state = problem.with_terms(term)
    at = state.evaluate(fit.values, fit.effects)
    begun, damping = at.chi2, 0.0
    for _ in range(rounds):
        slopes, states = state.with_places(at)
        columns = _joint(state, at, limits.names, term, slopes, states)
        sides, found = limits.sides(at), None
        now = np.array([at.values[name] for name in limits.names])
        for _ in range(TRIES):
            step = _step_within(columns, at.residual, damping, sides)
            moved = np.clip(now + step[:count], limits.lower, limits.upper)
            tried = replace(
                term, coefficients=tuple(float(c + s) for c, s in zip(term.coefficients, step[count:], strict=True))
            )
            there = problem.with_states(states).with_terms(tried)
            trial = there.evaluate({**at.values, **dict(zip(limits.names, moved.tolist(), strict=True))}, fit.effects)
            if np.isfinite(trial.chi2) and trial.chi2 < at.chi2:
                found = (at.chi2 - trial.chi2, trial, tried, there)
                break
            damping = max(DAMPED * damping, 1e-3)
        if found is None:
            break
        fall, at, term, state = found
        damping *= 1.0 / DAMPED if damping > 1e-6 else 0.0
        if fall < max(SETTLED, ENOUGH * at.chi2):
            break
    slopes, states = state.with_places(at)
    kept = limits.kept(fit, at)
    names = tuple(name for name in limits.names if name not in kept.active)
    joint = _covariance(_joint(state, at, names, term, slopes, states), max(at.chi2 / max(int(fit.used.sum()), 1), 1.0))
    std = np.sqrt(np.maximum(np.diag(joint)[len(names) :], 0.0))
    return FittedTerm(term, state, kept, begun - at.chi2, std, joint, names)


def _step_within(columns: np.ndarray, residual: np.ndarray, damping: float, sides: np.ndarray) -> np.ndarray:
    """A step that leaves what presses against a limit (sides: of the first columns) where it is."""
    length = np.linalg.norm(columns, axis=0)
    length[length == 0.0] = 1.0
    open_ = np.ones(columns.shape[1], dtype=bool)
    step = np.zeros(columns.shape[1])
    for _ in range(2):
        step[:] = 0.0
        step[open_] = _step(columns[:, open_] / length[open_], residual, damping) / length[open_]
        pushes = step[: len(sides)] * sides > 0.0
        if not pushes.any():
            break
        open_[: len(sides)] &= ~pushes
    return step


def _joint(
    problem: Problem, at: Fit, names: tuple[str, ...], term: TypedTerm, slopes: dict[str, np.ndarray], states: States
) -> np.ndarray:
    own = at.columns[:, [at.order.index(name) for name in names]]
    return np.concatenate([own, term_columns(problem, at, term, slopes, states)], axis=1)


def _step(columns: np.ndarray, residual: np.ndarray, damping: float) -> np.ndarray:
    if damping > 0.0:
        count = columns.shape[1]
        columns = np.concatenate([columns, np.sqrt(damping) * np.eye(count)])
        residual = np.concatenate([residual, np.zeros(count)])
    return np.linalg.lstsq(columns, -residual, rcond=1e-9)[0]


def _covariance(columns: np.ndarray, scale: float) -> np.ndarray:
    length = np.linalg.norm(columns, axis=0)
    length[length == 0.0] = 1.0
    _, singular, right = np.linalg.svd(columns / length, full_matrices=False)
    seen = singular > 1e-9 * singular[0]
    root = right[seen].T / singular[seen] / length[:, None]
    return scale * (root @ root.T)


def linear_only(problem: Problem, fit: Fit, found: Scored, noise: float) -> FittedTerm:
    """A term by one linear step, where a refit would take a program that nobody has asked for (oil stored at the ports)."""
    base = Projection.beside(fit.nuisance * fit.used[:, None])
    left = base(found.entry.columns)
    step = _step(left, base(fit.residual * fit.used), 0.0) / found.entry.length
    term = replace(blank(found.entry, fit, left.shape[1]), coefficients=tuple(step.tolist()))
    std = np.sqrt(np.maximum(np.diag(_covariance(left, noise)), 0.0)) / found.entry.length
    moved = replace(fit, residual=fit.residual + left @ (step * found.entry.length), chi2=fit.chi2 - found.gain)
    return FittedTerm(term, problem, moved, found.gain, std, None)


def terms_of(problem: Problem, fit: Fit, split: Split, say: Progress = lambda _: None) -> tuple[Found, ...]:
    """The leading terms beside `fit`, which leaves a misfit: the best first; empty where none is beyond chance."""
    say("asking where in the circuit, and with what")
    plain = problem
    table, problem = table_of(problem, fit)
    lead = leading(table)
    if not lead:
        return ()
    refits = not any(stores(name) for name in fit.effects)
    start = fit
    ask = lambda s: (
        fitted_inside(problem, start, blank(s.entry, start, s.entry.columns.shape[1]))
        if refits
        else linear_only(problem, fit, s, table.noise)
    )
    asked = [(s, ask(s)) for s in lead]
    # A model that misses by far has bent its parameters to the misfit, and scores beside it say little: they are asked again beside
    # the parameters that the best term so far has straightened.
    for _ in range(STRAIGHTENED if refits else 0):
        best_so_far = min(f.fit.chi2 for _, f in asked)
        if fit.chi2 <= BENT * table.rows:
            break
        best_one = min((f for _, f in asked), key=lambda f: f.fit.chi2)
        start = straightened(problem, fit, fitted_inside(problem, best_one.fit, best_one.term, PATIENT).fit)
        table, _ = table_of(problem.with_terms(), start)
        asked += [(s, ask(s)) for s in leading(table)]
        if min(f.fit.chi2 for _, f in asked) > 0.9 * best_so_far:
            break
    freedom = max(table.rows, 1)
    count = lambda s: s.rank * float(np.log(freedom)) + place_of(s.entry.place).prior
    noise = max(min(f.fit.chi2 for _, f in asked) / freedom, 1.0)
    cost = lambda item: item[1].fit.chi2 / noise + count(item[0])
    asked.sort(key=cost)
    if refits:
        asked = sorted([*asked, *_other_edges(table, asked[0][0], [s for s, _ in asked], ask)], key=cost)
        asked = sorted([*asked, *_other_laws(table, asked[0], [s for s, _ in asked], ask)], key=cost)
        first, rough = asked[0]
        asked[0] = (first, fitted_inside(problem, rough.fit, rough.term, PATIENT))
        asked.sort(key=cost)
    best: dict[tuple[str, str], tuple[Scored, FittedTerm]] = {}
    for item in asked:
        best.setdefault(item[0].entry.pair, item)
    told = list(best.values())
    chosen = plain.with_rows(~split.held)
    without = chosen.fit(fit.effects, fit.values)
    gap = mean_square(plain, without, split)
    found = []
    for scored_, fitted in told[:MOST]:
        alike = [
            other.entry.pair
            for other, own in told
            if other is not scored_ and cost((other, own)) - cost((scored_, fitted)) < AS_GOOD
        ]
        alike += [pair for pair in _same_direction(table, scored_) if pair not in alike and pair not in best]
        if refits:
            seen = fitted_inside(problem.with_rows(~split.held), without, fitted.term)
            shown = closed(gap, mean_square(replace(seen.problem, used=None), seen.fit, split))
            proof = _proof(problem, fit, fitted)
        else:
            excess = max(fit.chi2 - table.rows, fitted.gain)
            shown, proof = float(np.clip(fitted.gain / excess, 0.0, 1.0)), np.nan
        found.append(Found(fitted, table.p_value(scored_), shown, proof, tuple(alike)))
    return tuple(found)


def straightened(problem: Problem, fit: Fit, other: Fit) -> Fit:
    """`fit`'s model, without a term, at the parameters of another fit: no optimum."""
    return _Limits.of(problem, fit).kept(fit, problem.with_terms().evaluate(other.values, fit.effects))


def _other_laws(
    table: Table, best: tuple[Scored, FittedTerm], asked: list[Scored], ask: Callable[[Scored], FittedTerm]
) -> list[tuple[Scored, FittedTerm]]:
    """The other laws of the leading pair, and the simple ones of its place, fitted too: a linear score may have preferred the wrong one."""
    pair, known = best[0].entry.pair, {(s.entry.pair, s.entry.law) for s in asked}
    new = [s for s in table.entries if (s.entry.pair, s.entry.law) not in known]
    own = [s for s in new if s.entry.pair == pair]
    simple = [s for s in new if s.entry.place == pair[0] and s.rank == 1 and s.entry.pair != pair]
    simple.sort(key=lambda s: -s.gain)
    constant = [s for s in simple if s.entry.law == "constant"]
    chosen = {id(s): s for s in (*own, *constant, *simple[:SIMPLE_LAWS])}
    return [(s, ask(s)) for s in chosen.values()]


def _other_edges(
    table: Table, best: Scored, asked: list[Scored], ask: Callable[[Scored], FittedTerm]
) -> list[tuple[Scored, FittedTerm]]:
    """The quantity of the leading place at all edges, a pair or one of them, with the same variable: scores beside a bent fit may have
    preferred the wrong ones."""
    place, variable = best.entry.pair
    known = {s.entry.pair for s in asked}
    new = [
        s
        for s in table.ranked
        if s.entry.variable == variable and family(s.entry.place) == family(place) and s.entry.pair not in known
    ]
    return [(s, ask(s)) for s in new]


ALIKE = 0.995  # cosine of two directions beyond which no reading tells them apart


def _same_direction(table: Table, best: Scored) -> list[tuple[str, str]]:
    """Pairs whose column no reading tells from that of the best."""
    if best.rank > 1:
        return []
    return list(
        dict.fromkeys(s.entry.pair for s in table.entries if s.entry.pair != best.entry.pair and _alike(best, s))
    )


def _alike(a: Scored, b: Scored) -> bool:
    return a.rank == b.rank == 1 and abs(float(a.directions[:, 0] @ b.directions[:, 0])) > ALIKE


def _proof(problem: Problem, fit: Fit, fitted: FittedTerm) -> float:
    """2 ln E of the term over the model without it, every condition left out once, in units of the misfit left."""
    parts = parts_left_out(problem.tests)
    scale = max(fitted.fit.chi2 / max(int(fit.used.sum()), 1), 1.0)
    apart = lambda f: float(np.sum(predicted_apart(f, parts) ** 2))
    return (apart(fit) - apart(with_coefficients(fitted))) / scale


def with_coefficients(fitted: FittedTerm) -> Fit:
    """The fit with the term's coefficients among what it adjusted."""
    fit, names = fitted.fit, tuple(f"coefficient {i + 1}" for i in range(len(fitted.term.coefficients)))
    slopes, states = fitted.problem.with_places(fit)
    columns = term_columns(fitted.problem, fit, fitted.term, slopes, states)
    return replace(
        fit,
        order=(*fit.order, *names),
        free=(*fit.free, *names),
        values=fit.values | dict(zip(names, fitted.term.coefficients, strict=True)),
        columns=np.concatenate([fit.columns, columns], axis=1),
    )
