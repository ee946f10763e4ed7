"""A finished fit as whoever looks around its optimum sees it: boxes, optimum, the rise of chi-square that an interval stands for, and
fits with some parameters held."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.fit import PROFILE_CLOSE_ENOUGH, StaticSearch
from thermohyd.identify.fitting.least_squares import LeastSquaresResult, solve
from thermohyd.identify.fitting.library import Library
from thermohyd.identify.fitting.outcome import Fitted, Uncertainty
from thermohyd.identify.fitting.problem import BELIEVE, MOST_STEPS, Problem
from thermohyd.identify.fitting.readings import Noise, white_noise


def effects_of(fitted: Fitted) -> tuple[str, ...]:
    """The free entries of a fit that are effects of the library."""
    from thermohyd.effects.library import whole_library

    known = whole_library()
    return tuple(name for name in fitted.free if name in known)


def problem_of(fitted: Fitted, noise: Noise | None = None) -> Problem:
    """The fit's readings and model as a problem. noise: another than that which the fit used."""
    effects = effects_of(fitted)
    plans = {name: plan for name, plan in fitted.plans.items() if name not in effects}
    weighed = white_noise(fitted.noise) if noise is None else noise
    return Problem(fitted.record, fitted.tests, plans, Library(effects, {}), weighed)


@dataclass(frozen=True)
class FinishedFit:
    """Around a fit's optimum. known: what its noise does to the parameters."""

    fitted: Fitted
    known: Uncertainty

    @property
    def plain(self) -> bool:
        """Static tests alone and no effect freed: the search that is compiled as a whole serves."""
        return not effects_of(self.fitted) and not any(test.in_motion for test in self.fitted.tests.values())

    @cached_property
    def problem(self) -> Problem:
        return problem_of(self.fitted)

    @cached_property
    def _around(
        self,
    ) -> tuple[LeastSquaresResult, list[Box], Callable[[np.ndarray, Mapping[int, float]], LeastSquaresResult]]:
        fitted = self.fitted
        if self.plain:
            search = StaticSearch(fitted.record, fitted.tests, fitted.plans, fitted.free)
            args = search.args(fitted.noise)
            return fitted.solution, search.boxes, lambda start, held: search.solve(args, start, held)
        problem, effects = self.problem, effects_of(fitted)
        system = problem.system(effects, fitted.values)
        boxes = system.boxes

        def hold(start: np.ndarray, held: Mapping[int, float]) -> LeastSquaresResult:
            own = list(boxes)
            for i, value in held.items():
                own[i] = boxes[i].held_at(value)
            return solve(
                None, own, None, start, tolerance=PROFILE_CLOSE_ENOUGH, max_steps=MOST_STEPS, both=system.both, believe=BELIEVE
            )  # fmt: skip

        start = np.array([fitted.values.get(name, box.start) for name, box in zip(system.order, boxes, strict=True)])
        return hold(start, {}), boxes, hold

    @property
    def best(self) -> LeastSquaresResult:
        """The optimum over `boxes`."""
        return self._around[0]

    @property
    def boxes(self) -> list[Box]:
        """Of the free parameters; beside effects and in motion also of held ones."""
        return self._around[1]

    def hold(self, start: np.ndarray, held: Mapping[int, float]) -> LeastSquaresResult:
        """A fit from `start` with these entries held."""
        return self._around[2](start, held)

    def place(self, name: str) -> int:
        """Where a free parameter stands among `boxes`."""
        return next(i for i, box in enumerate(self.boxes) if box.name == name)

    def rises(self, name: str, levels: tuple[float, ...]) -> list[float]:
        """By how much chi-square rises to the ends of an interval of each level, with the correlation of the noise counted in."""
        reach = [self.known.reach(len(self.fitted.free), level) for level in levels]
        inflation = float(self.known.inflation[self.fitted.free.index(name)])
        return [r**2 * inflation for r in reach]
