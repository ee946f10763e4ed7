"""Fit a typed term inside the model, its coefficients and the parameters together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.term_variables import States
from thermohyd.identify.model.typed_terms import TypedTerm

from .screening import Projection
from .term_table import Scored, blank, term_columns


ROUNDS, TRIES, PATIENT = 6, 3, 20  # of Gauss-Newton
TRIES_IN_MOTION = 6  # a bent machine is far from linear
DAMPED = 30.0  # a try that raised chi-square is followed by one so much more damped (Marquardt, 1963, has 10): few tries are left
SETTLED, ENOUGH = 0.02, 1e-4  # chi-square, and share of it, that another round would gain
MORE = 5  # rounds, each as good as the last, that must bring a fit to its goal
# m: by what the edges of one side may differ from those of the other, as is usual; rounds of a fit begun there.
UNEQUAL, GLANCE = {"underlap": 1e-6, "edge_radius": 5e-6}, 4


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


def fitted_inside(
    problem: Problem, fit: Fit, term: TypedTerm, rounds: int = ROUNDS, goal: float = np.inf
) -> FittedTerm:
    """Fit a term and the parameters together by damped Gauss-Newton steps from `fit`; problem: with states. goal: chi-square; a fit that
    `MORE` rounds like its last one would leave above is left where it is.

    Variables made of the model's own pressures and flows are those of the last round: each round counts them anew. A parameter that a
    bent fit had pressed against a limit is free again, as far as the limit lets it.
    """
    limits = _Limits.of(problem, fit)
    count = len(limits.names)
    state = problem.with_terms(term)
    at = state.evaluate(fit.values, fit.effects)
    if not usable(at):  # the term as another model had it: begin without
        term = replace(term, coefficients=(0.0,) * len(term.coefficients))
        state = problem.with_terms(term)
        at = state.evaluate(fit.values, fit.effects)
    begun, damping = at.chi2, 0.0
    for _ in range(rounds):
        columns, states = _joint(state, at, limits.names, term)
        sides, found = limits.sides(at), None
        now = np.array([at.values[name] for name in limits.names])
        for _ in range(TRIES_IN_MOTION if problem.in_motion else TRIES):
            step = _step_within(columns, at.residual, damping, sides)
            moved = np.clip(now + step[:count], limits.lower, limits.upper)
            tried = replace(
                term, coefficients=tuple(float(c + s) for c, s in zip(term.coefficients, step[count:], strict=True))
            )
            there = (problem if states is None else problem.with_states(states)).with_terms(tried)
            trial = there.evaluate({**at.values, **dict(zip(limits.names, moved.tolist(), strict=True))}, fit.effects)
            if usable(trial) and trial.chi2 < at.chi2:
                found = (at.chi2 - trial.chi2, trial, tried, there)
                break
            damping = max(DAMPED * damping, 1e-3)
        if found is None:
            break
        fall, at, term, state = found
        damping *= 1.0 / DAMPED if damping > 1e-6 else 0.0
        if fall < max(SETTLED, ENOUGH * at.chi2) or at.chi2 - MORE * fall > goal:
            break
    kept = limits.kept(fit, at)
    names = tuple(name for name in limits.names if name not in kept.active)
    joint = _covariance(_joint(state, at, names, term)[0], max(at.chi2 / max(int(fit.used.sum()), 1), 1.0))
    std = np.sqrt(np.maximum(np.diag(joint)[len(names) :], 0.0))
    return FittedTerm(term, state, kept, begun - at.chi2, std, joint, names)


def usable(at: Fit) -> bool:
    """Whether a point has readings and slopes that a step can start from."""
    return bool(np.isfinite(at.chi2) and np.isfinite(at.columns).all())


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


def _joint(problem: Problem, at: Fit, names: tuple[str, ...], term: TypedTerm) -> tuple[np.ndarray, States | None]:
    """(columns of the named entries and of the term's coefficients, the states that a static term is counted at)."""
    own = at.columns[:, [at.order.index(name) for name in names]]
    more, states = columns_of(problem, at, term)
    return np.concatenate([own, more], axis=1), states


def columns_of(problem: Problem, at: Fit, term: TypedTerm) -> tuple[np.ndarray, States | None]:
    """(whitened columns (rows, coefficients) of the term that the problem has, the model's present states in static tests)."""
    if problem.in_motion:
        return problem.term_columns_in_motion(at)[:, : len(term.coefficients)], None
    slopes, states = problem.with_places(at)
    return term_columns(problem, at, term, slopes, states), states


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


def straightened(problem: Problem, fit: Fit, other: Fit) -> Fit:
    """`fit`'s model, without a term, at the parameters of another fit: no optimum."""
    return _Limits.of(problem, fit).kept(fit, problem.with_terms().evaluate(other.values, fit.effects))


def with_coefficients(fitted: FittedTerm) -> Fit:
    """The fit with the term's coefficients among what it adjusted."""
    fit, names = fitted.fit, tuple(f"coefficient {i + 1}" for i in range(len(fitted.term.coefficients)))
    columns = columns_of(fitted.problem, fit, fitted.term)[0]
    return replace(
        fit,
        order=(*fit.order, *names),
        free=(*fit.free, *names),
        values=fit.values | dict(zip(names, fitted.term.coefficients, strict=True)),
        columns=np.concatenate([fit.columns, columns], axis=1),
    )


def mirrored(found: Scored) -> bool:
    """Whether a valve with this shift is nearly one with its opposite, so that no slope says how much is missing: where what the edges
    of one side lose those of the other gain, leakage and flow are the same to first order."""
    quantity, _, side = found.entry.place.partition(":")
    return quantity in UNEQUAL and side in ("supply", "return") and found.entry.law == "constant"


def from_both_sides(problem: Problem, fit: Fit, found: Scored, goal: float) -> list[FittedTerm]:
    """A term fitted from an amount above 0 and one below."""
    amount = UNEQUAL[found.entry.place.partition(":")[0]]
    term = blank(found.entry, fit, 1)
    begun = [replace(term, coefficients=(side * amount,)) for side in (1.0, -1.0)]
    return [fitted_inside(problem, fit, own, GLANCE, goal) for own in begun]


def as_wear(
    problem: Problem, fit: Fit, found: Scored, fitted: FittedTerm, others: Sequence[Scored], goal: float
) -> tuple[Scored, FittedTerm]:
    """A smaller radius of the edges of one side as what it is: the other side's wear, and a smaller radius of all edges.

    Edges do not sharpen, and a search that begins at a worn model's radius cannot come this way by itself.
    """
    quantity, _, side = found.entry.place.partition(":")
    (amount,), now = fitted.term.coefficients, fitted.fit.values
    other = f"{quantity}:{'return' if side == 'supply' else 'supply'}"
    twin = next((s for s in others if s.entry.place == other), None)
    if quantity != "edge_radius" or amount >= 0.0 or quantity not in fit.free or twin is None:
        return found, fitted
    least = problem.box_of(quantity, now[quantity]).lower
    start = replace(fitted.fit, values=now | {quantity: now[quantity] + amount})
    if start.values[quantity] <= least:
        return found, fitted
    own = fitted_inside(problem, start, replace(blank(twin.entry, fit, 1), coefficients=(-amount,)), GLANCE, goal)
    return (twin, own) if usable(own.fit) else (found, fitted)
