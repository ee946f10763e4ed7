"""Which runs to add to a plan: those that let most effects be seen, and most pairs be told apart, per hour of bench time.

The menu is that of the next test (docs/diagnosis.md section 16): the same tests under other conditions, all of them or one alone.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.diagnosis.next_test import cost_of, menu
from thermohyd.identify.diagnosis.screening import Projection
from thermohyd.identify.fitting.library import stores

from .planned_problem import Prospect
from .visible import View, change_at, confused_with, with_more


ALL = ""  # tests
CHANGE_OVER = 300.0  # s: to set a new condition, beside the reading itself


@dataclass(frozen=True)
class AddedRun:
    """Tests to add, in words, and what they bring at the largest usual amounts. seconds: of reading and of one change-over; None
    without a time. shows: effects that would be found in 90 % of records and are not without; separates: pairs likewise told apart.
    """

    words: str
    rows: int
    seconds: float | None
    shows: tuple[str, ...]
    separates: tuple[tuple[str, str], ...]

    @property
    def gains(self) -> int:
        return len(self.shows) + len(self.separates)

    @property
    def per_hour(self) -> float:
        """What is gained in an hour; where there is no time, by thousand rows."""
        return self.gains / (self.rows / 1000.0 if self.seconds is None else self.seconds / 3600.0)


def added_runs(prospect: Prospect, view: View, say: Callable[[str], None] = lambda _: None) -> tuple[AddedRun, ...]:
    """Every change of the menu, what brings most per hour first."""
    before = {sight.name: change_at(prospect, sight.name, sight.amount) for sight in view.sights}
    hidden = {s.name for s in view.sights if s.strength_of_usual < view.wanted}
    alike = _pairs(view)
    problem, found = prospect.problem, []
    priors = len(problem.parameters)
    for words, tests in menu(problem.tests):
        say(f"with the tests {words}")
        anew = replace(problem, tests=tests)
        there = replace(prospect, problem=anew, fit=prospect.seen(anew.evaluate(prospect.fit.values)))
        after = {
            sight.name: change_at(there, sight.name, sight.amount)
            for sight in view.sights
            if not stores(sight.name) or all(test.time is not None for test in tests.values())
        }
        if not all(np.isfinite(change).all() for change in after.values()):
            continue
        rows = {name: np.zeros(len(there.fit.residual) - priors, dtype=bool) for name in (*tests, ALL)}
        for (name, _), place in anew.rows().items():
            rows[name][place] = rows[ALL][place] = True
        for name, own in rows.items():
            if name == ALL or len(tests) > 1:
                columns = np.concatenate([prospect.nuisance, there.nuisance[:-priors][own]])
                if not np.isfinite(columns).all():
                    continue
                changes = {
                    n: np.concatenate([before[n], after[n][:-priors][own] if n in after else np.zeros(int(own.sum()))])
                    for n in before
                }
                more = with_more(view, changes, Projection.beside(columns))
                chosen = list(tests.values()) if name == ALL else [tests[name]]
                count, seconds = cost_of(chosen)
                spoken = words if name == ALL else f"{words}, {name.replace('_', ' ')} alone"
                shown = tuple(s.name for s in more.sights if s.name in hidden and s.strength_of_usual >= view.wanted)
                apart = tuple(sorted(alike - _pairs(more)))
                found.append(AddedRun(spoken, count, None if seconds is None else seconds + CHANGE_OVER, shown, apart))
    return tuple(sorted(found, key=lambda run: (-run.per_hour, run.seconds or run.rows)))


def _pairs(view: View) -> set[tuple[str, str]]:
    """Pairs of effects of which one is not told from the other in its largest usual amount."""
    return {
        (min(sight.name, other), max(sight.name, other))
        for sight in view.sights
        for other in confused_with(view, sight.name)
    }
