"""Fits of a made-up linear model, for tests of what is computed from residuals and columns: nothing is simulated."""

import numpy as np

from thermohyd.identify.diagnosis.library import Library
from thermohyd.identify.diagnosis.library_fit import Key, LibraryFit, LibraryProblem, Noise, noise_sweeps
from thermohyd.identify.diagnosis.library_model import PARAMETERS
from thermohyd.identify.diagnosis.whitening import whiten_on_host, whitening_of
from thermohyd.identify.least_squares import LeastSquaresResult
from thermohyd.identify.noise_correlation import NoiseCorrelation
from thermohyd.identify.parameters import plan_parameters
from thermohyd.identify.record import TestRecord

from .small_bench import REACH, conditions_only, record_of


def linear_problem(correlation: NoiseCorrelation, tests: dict[str, TestRecord] | None = None) -> LibraryProblem:
    """Conditions of a small bench, noise of 1 in every channel; nothing of it is ever compiled."""
    tests = tests or {name: conditions_only(name) for name in REACH}
    record = record_of(tests)
    keys: list[Key] = [(test.name, channel.name) for test in tests.values() for channel in test.channels]
    std = {key: np.ones(tests[key[0]].rows) for key in keys}
    plans = plan_parameters(record.valve, {})
    return LibraryProblem(record, tests, plans, Library((), {}), Noise(std, dict.fromkeys(keys, correlation)))


def whitened(problem: LibraryProblem, key: Key, values: np.ndarray) -> np.ndarray:
    test = problem.tests[key[0]]
    return whiten_on_host(whitening_of(problem.noise.correlation[key], noise_sweeps(test), test.rows), values)


def linear_fit(residual: np.ndarray, columns: np.ndarray) -> LibraryFit:
    """A fit of the parameters alone; residual (rows,) whitened and columns (rows, parameters), priors left out."""
    priors = len(PARAMETERS)
    residual = np.concatenate([residual, np.zeros(priors)])
    columns = np.concatenate([columns, np.zeros((priors, columns.shape[1]))])
    names = PARAMETERS[: columns.shape[1]]
    p, cost = np.zeros(len(names)), float(residual @ residual)
    solution = LeastSquaresResult(
        p, p, p, cost, residual, columns, np.zeros(len(names), int), True, "", 1, 0.0
    )  # fmt: skip
    return LibraryFit(
        (), names, names, dict.fromkeys(names, 0.0), cost, residual, columns, np.ones(len(residual), bool), frozenset(),
        True, "", solution,
    )  # fmt: skip
