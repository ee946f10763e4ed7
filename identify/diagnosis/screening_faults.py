"""Score faults of the bench beside a fitted model, as the effects of the library are, but at a level of their own.

There are many more places where a bench can be at fault than effects of a valve: under one law with them, the library would lose
power. The level is therefore divided: faults have a share of it, with a critical value of their own (max-T, docs/diagnosis.md section 7.1).
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from thermohyd.identify.fitting.bench_faults import BenchFault
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.readings import STEP
from thermohyd.identify.noise.whitening import whiten_on_host

from .max_t import NoiseFreedom
from .screening import Screen, screen


SHARE = 0.3  # of the level of a search


def screen_of_faults(problem: Problem, fit: Fit, *, level: float, freedom: NoiseFreedom | None = None) -> Screen | None:
    """Scores of all faults that `fit` does not have; None where the tests can have none."""
    names = [name for name in problem.faults if name not in fit.effects]
    if not names:
        return None
    columns = fault_columns(problem, fit, names)
    return screen(fit, names, {}, level=SHARE * level, columns=columns, freedom=freedom)


def p_of_fault(faults: Screen | None) -> float:
    """The strongest fault's, on the scale of the search's level."""
    if faults is None or not faults.ranked:
        return 1.0
    return min(1.0, faults.p_value(faults.ranked[0]) / SHARE)


def fault_columns(problem: Problem, fit: Fit, names: Iterable[str]) -> dict[str, np.ndarray]:
    """{fault: whitened column (rows,) per amount} beside `fit`; rows of priors are 0.

    Rows are taken for themselves: what a shifted position does to the rows behind it, where ports store oil, is left to the refit.
    """
    faults = [problem.faults[name] for name in names]
    slopes = _slopes(problem, fit, faults)
    found = {fault.name: np.zeros(len(fit.residual)) for fault in faults}
    for key, place in problem.rows().items():
        test, own = key[0], [fault for fault in faults if _touches(fault, *key)]
        if not own:
            continue
        weight = 1.0 / problem.noise.std[key] * (1.0 if problem.used is None else problem.used[place])
        columns = [
            fault.shapes[test] * (slopes[fault.info.moves][place] if fault.info.moves else weight) for fault in own
        ]
        for fault, column in zip(own, whiten_on_host(problem.whitening(key), np.stack(columns, axis=1)).T, strict=True):
            found[fault.name][place] = column
    return {name: problem.decorrelated(column) for name, column in found.items()}


def _touches(fault: BenchFault, test: str, channel: str) -> bool:
    return test in fault.shapes and (bool(fault.info.moves) or fault.channel == channel)


def _slopes(problem: Problem, fit: Fit, faults: list[BenchFault]) -> dict[str, np.ndarray]:
    """{column that is read wrong: (rows,)}: what one SI unit too much does to the weighted residuals, before whitening."""
    steps: dict[str, float] = {}
    for fault in faults:
        if fault.info.moves:
            steps.setdefault(fault.info.moves, STEP * fault.info.scale * fault.size)
    return slopes_of_inputs(problem, fit, steps)


def slopes_of_inputs(problem: Problem, fit: Fit, steps: Mapping[str, float]) -> dict[str, np.ndarray]:
    """{column of the tests: (rows,)}: what one SI unit more of what was read there does to the weighted residuals, before whitening, at
    a fit; by differences over these steps, SI."""
    if not steps:
        return {}
    white = problem.with_noise(problem.noise.white)
    here = white.evaluate(fit.values, fit.effects).residual
    found = {}
    for column, step in steps.items():
        moved = {
            name: test if (read := getattr(test, column, None)) is None else replace(test, **{column: read - step})
            for name, test in problem.tests.items()
        }
        found[column] = (replace(white, tests=moved).evaluate(fit.values, fit.effects).residual - here) / step
    return found
