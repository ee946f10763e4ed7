"""Refits of a record's dynamic tests with any effects of the dynamic library freed, as the search and the reports expect them."""

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, effect_info
from thermohyd.identify.bench.record import DynamicTest
from thermohyd.identify.fitting.fit_motion import BELIEVE, CLOSE_ENOUGH, simulator_of
from thermohyd.identify.fitting.least_squares import Both, LeastSquaresResult
from thermohyd.identify.fitting.motion_readings import DynamicSimulator, Weighing, both_of
from thermohyd.identify.fitting.parameters import ParameterPlan
from thermohyd.identify.fitting.static_readings import Size
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.whitening import whiten_on_host, whitening_of

from .library import Library
from .library_fit import Key, LibraryFit, LibraryProblem


# Static effects that a step test can show: few, as each is one more name that chance may hit. A leak between the ports is
# the jack's leak by another name, and stands for itself in the static library.
STATIC = ("unequal_underlap", "position_scale")


def motion_library(tests: dict[str, DynamicTest], heat: str) -> Library:
    """The dynamic effects, and a few static ones, that these tests can show."""
    names, impossible = [], {}
    kinds = {test.kind for test in tests.values()}
    readings = {channel.name for test in tests.values() for channel in test.channels}
    for name in (*STATIC, *DYNAMIC_EFFECTS):
        info = effect_info(name)
        if name in DYNAMIC_EFFECTS and not kinds & set(info.shows):
            impossible[name] = f"none of its tests ({', '.join(info.shows)}) is in the record"
        elif name == "wall_heat" and heat == "isothermal":
            impossible[name] = 'the record says heat = "isothermal": all oil has the supply\'s temperature'
        elif name == "position_scale" and "spool_position" not in readings:
            impossible[name] = "the spool's position is not measured"
        else:
            names.append(name)
    known = list({**EFFECTS, **DYNAMIC_EFFECTS})
    return Library(tuple(sorted(names, key=known.index)), impossible)


@dataclass
class MotionProblem(LibraryProblem):
    """plans: of the entries that can be free, `held` of all others. known_effects: found in static tests, at their amounts."""

    held: dict[str, ParameterPlan] | None = None
    known_effects: dict[str, float] | None = None

    @property
    def in_motion(self) -> bool:
        return True

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(self.plans)

    def order_of(self, program: tuple[str, ...]) -> tuple[str, ...]:
        return (*self.parameters, *program)

    @property
    def _size(self) -> Size:
        return lambda rows: rows

    @property
    def _closeness(self) -> tuple[float, float]:
        return CLOSE_ENOUGH, BELIEVE

    def _program(self, chosen: tuple[str, ...]) -> tuple[str, ...]:
        """Without effects a program of its own; with any, one that has them all."""
        return self.library.names if chosen else ()

    def _arguments(self, program: tuple[str, ...]) -> Any:
        return None

    def _both(self, program: tuple[str, ...]) -> Both:
        rows, weight = self.rows(), {}
        for key, place in rows.items():
            weight[key] = 1.0 / self.noise.std[key]
            if self.used is not None:
                weight[key] = weight[key] * self.used[place]
        weighing = Weighing(weight, whiten=self._whiten)
        return both_of(self._simulator(), self.parameters, program, weighing, list(self.plans.values()))

    def _simulator(self) -> DynamicSimulator:
        cache: dict[str, Any] = self._args
        if "simulator" not in cache:
            own = simulator_of(self.record, {**(self.held or {}), **self.plans}, self.known_effects)
            cache["simulator"] = replace(own, tests=self.tests, _runs={})
        return cache["simulator"]

    def _whiten(self, key: Key, values: np.ndarray) -> np.ndarray:
        correlation = self.noise.correlation[key]
        if correlation == NoiseCorrelation():
            return values
        filter_ = whitening_of(correlation, self.sweeps(key[0]), self.tests[key[0]].rows)
        return whiten_on_host(filter_, values.T).T

    def _evaluate(self, values: Any, program: tuple[str, ...]) -> LibraryFit:
        order = self.order_of(program)
        point = np.array([values.get(n, 0.0 if n not in self.parameters else self.plans[n].start) for n in order])
        residual, columns = (np.asarray(part) for part in self._both(program)(jnp.asarray(point), None))
        self.evaluations += 1
        still = np.zeros(len(point), dtype=int)
        cost = float(np.sum(residual**2))
        result = LeastSquaresResult(point, point, point, cost, residual, columns.T, still, True, "", 0, 0.0)
        return self._result((), order, (), result)

    def with_all_columns(self, fit: LibraryFit) -> LibraryFit:
        if fit.order == self.order_of(self.library.names):
            return fit
        at = self._evaluate(fit.values, self.library.names)
        return replace(fit, order=at.order, values=at.values, columns=at.columns)
