"""What closes the gap on the rows held out: the names, what was learned, the bench's faults, or weights; and what may be handed over?

Groups of what the final model holds are fitted to the other rows in every combination. A group is worth what it closes as the first one in
and as the last one in; its share is Shapley's (Annals of Mathematics Studies 28, 1953; of explained variance: Lindeman, Merenda and Gold,
1980), the mean of both where there are two. So no name is given what faults or weights did. docs/diagnosis.md section 11.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import factorial

import numpy as np

from thermohyd.identify.fitting.bench_faults import is_fault
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.typed_terms import TypedTerm

from .case import Case, Progress
from .confirmation import PROVEN, fit_of_rows_left
from .final_model import FinalModel, closed, exchange_fits, held_out_result, mean_square
from .held_out import Split
from .left_over import learn as learn_term
from .remaining_misfit import Remaining
from .result import Credit, HeldOut, Variation
from .screening import Screen
from .term_fit import fitted_inside
from .term_table import opened


Groups = frozenset[str]


@dataclass(frozen=True)
class Apart:
    """The final model `fit`, and what some of its groups alone make of it, fitted to the rows that are not held out."""

    case: Case
    split: Split
    fit: Fit
    term: LearnedTerm | TypedTerm | None
    smooth: tuple[Variation, ...]
    remaining: Remaining | None
    _plain: dict[Groups, Fit] = field(default_factory=dict)
    _known: dict[Groups, tuple[Problem, Fit]] = field(default_factory=dict)

    @property
    def groups(self) -> tuple[str, ...]:
        """What of the model can close a gap."""
        weighed = self.remaining is not None and self.remaining.weighed.discrepancy is not None
        there = {"names": self.fit.physics, "terms": self.term, "faults": self.fit.faults, "weights": weighed}
        return tuple(group for group, held in there.items() if held)

    def rest(self, groups: Groups) -> Problem:
        """The problem of the other rows, weighed as the model is."""
        rest = self.case.problem.with_rows(~self.split.held)
        return rest if self.remaining is None or "weights" not in groups else self.remaining.weighing(rest)

    def plain(self, groups: Groups) -> Fit:
        """The fit of these groups, without what was learned."""
        if groups not in self._plain:
            names = [n for n in self.fit.effects if ("faults" if is_fault(n) else "names") in groups]
            values = self.fit.values | {n: 0.0 for n in self.fit.effects if n not in names}
            rest = self.rest(groups)
            fit = fit_of_rows_left(rest, names, values) if names else rest.fit(start=self.case.base.values)
            self._plain[groups] = fit
        return self._plain[groups]

    def fitted(self, groups: Groups) -> tuple[Problem, Fit]:
        """The problem that a fit of these groups is judged by, and the fit."""
        if groups not in self._known:
            self._known[groups] = self._fitted(groups)
        return self._known[groups]

    def _fitted(self, groups: Groups) -> tuple[Problem, Fit]:
        plain, problem = self.plain(groups), self.case.problem
        if "terms" not in groups:
            return problem, plain
        if isinstance(self.term, TypedTerm):
            seen = fitted_inside(opened(self.rest(groups), plain), plain, self.term)
            return seen.problem.with_rows(None), seen.fit
        _, fit, learned = learn_term(self.rest(groups), plain, self.smooth[0])
        return problem.with_terms(learned), fit

    def left(self, groups: Groups) -> float:
        """Mean squared whitened misfit of the rows held out."""
        return mean_square(*self.fitted(groups), self.split)

    def valves(self, *, believed: bool) -> tuple[float, float, int] | None:
        """The same of the ideal valve and of the final model without the bench's faults, and of how many rows.

        believed: whether with the faults nothing is left to explain. The rows that they spoil then say nothing of the valve; None where
        no others are held out.
        """
        held = self.split.held
        if believed:
            held = held & ~_spoiled(self.case.problem, self.fit.faults, len(held))
        if not held.any():
            return None
        problem, fit = self.fitted(frozenset(self.groups))
        values = fit.values | dict.fromkeys(fit.faults, 0.0)
        rows, valve = replace(self.split, held=held), replace(fit, effects=fit.physics, values=values)
        return mean_square(*self.fitted(frozenset()), rows), mean_square(problem, valve, rows), int(held.sum())


def _spoiled(problem: Problem, names: tuple[str, ...], count: int) -> np.ndarray:
    """Rows (count,) that faults of the bench change."""
    found = np.zeros(count, dtype=bool)
    for fault in (problem.faults[name] for name in names):
        for (test, channel), place in problem.rows().items():
            if test in fault.shapes and (fault.info.moves or fault.channel == channel):
                found[place] |= fault.shapes[test] != 0.0
    return found


def credits_of(groups: Sequence[str], worth: Callable[[Groups], float]) -> tuple[Credit, ...]:
    """Of each group what it closes as the first one in, as the last one in, and its share. worth: what some of the groups close."""
    found, count = [], len(groups)
    for group in groups:
        others = [other for other in groups if other != group]
        adds = {
            before: worth(frozenset((*before, group))) - (worth(frozenset(before)) if before else 0.0)
            for size in range(count)
            for before in combinations(others, size)
        }
        orders = lambda size: factorial(size) * factorial(count - 1 - size) / factorial(count)
        share = sum(orders(len(before)) * more for before, more in adds.items())
        found.append(Credit(group, adds[()], adds[tuple(others)], share))
    return tuple(found)


def held_out_figures(
    case: Case,
    split: Split,
    model: FinalModel,
    fit: Fit,
    term: LearnedTerm | TypedTerm | None,
    smooth: tuple[Variation, ...],
    first: Screen,
    remaining: Remaining | None,
    say: Progress,
) -> HeldOut:
    """The ideal and the final model fitted to the other rows, on the rows held out, and who closed the gap there."""
    apart = Apart(case, split, fit, term, smooth, remaining)
    everything, nothing = frozenset(apart.groups), frozenset()
    final = apart.plain(everything)
    spared = set(fit.effects) | {r.name for rival in model.rivals.values() for r in rival.alike}
    exchanged = exchange_fits(apart.rest(everything), final, [s.name for s in first.ranked], spared, say)
    problem, final = apart.fitted(everything)
    words = split.what if model.seen_apart else f"{split.what} (the choice needed all rows, the values did not)"
    _, base = apart.fitted(nothing)
    held = held_out_result(case.problem, problem, split, base, final, exchanged, words)
    if len(apart.groups) > 1:
        say("who closes the gap on the rows held out")
    before, after = held.reduced_chi2_before, held.reduced_chi2_after
    worth = lambda some: closed(before, apart.left(some), held.rows, after)
    credit = credits_of(apart.groups, worth) if held.before > 0.0 else ()
    return replace(held, credit=credit, valves=apart.valves(believed=not model.disagrees))


def not_to_be_handed_over(held: HeldOut, *, believed: bool) -> bool:
    """Whether the final model without the bench's faults predicts rows held out worse than the ideal valve does.

    believed: where nothing is left to explain, by more than chance makes of it; else at all.
    """
    if held.valves is None:
        return False
    ideal, final, rows = held.valves
    return (final - ideal) * rows > (PROVEN if believed else 0.0)
