"""Fits of a made-up linear model, for tests of what is computed from residuals and columns: nothing is simulated."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from helpers.small_bench import REACH, conditions_only, record_of
from thermohyd.effects.library import EFFECTS
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.least_squares import LeastSquaresResult
from thermohyd.identify.fitting.library import Library
from thermohyd.identify.fitting.parameters import PARAMETERS, plan_parameters
from thermohyd.identify.fitting.problem import Key, Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.readings import Noise
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.whitening import whiten_on_host, whitening_of
from thermohyd.identify.reduction.monotone_pieces import run_ids


def linear_problem(correlation: NoiseCorrelation, tests: dict[str, TestRecord] | None = None) -> Problem:
    """Conditions of a small bench, noise of 1 in every channel; nothing of it is ever compiled."""
    tests = tests or {name: conditions_only(name) for name in REACH}
    record = record_of(tests)
    keys: list[Key] = [(test.name, channel.name) for test in tests.values() for channel in test.channels]
    std = {key: np.ones(tests[key[0]].rows) for key in keys}
    plans = plan_parameters(record.valve, {})
    return Problem(record, tests, plans, Library((), {}), Noise(std, dict.fromkeys(keys, correlation)))


def whitened(problem: Problem, key: Key, values: np.ndarray) -> np.ndarray:
    test = problem.tests[key[0]]
    return whiten_on_host(whitening_of(problem.noise.correlation[key], run_ids(test), test.rows), values)


def linear_fit(residual: np.ndarray, columns: np.ndarray, names: tuple[str, ...] = PARAMETERS) -> Fit:
    """A fit of the parameters alone; residual (rows,) whitened and columns (rows, names), priors left out."""
    priors = len(PARAMETERS)
    residual = np.concatenate([residual, np.zeros(priors)])
    columns = np.concatenate([columns, np.zeros((priors, columns.shape[1]))])
    names = names[: columns.shape[1]]
    p, cost = np.zeros(len(names)), float(residual @ residual)
    solution = LeastSquaresResult(
        p, p, p, cost, residual, columns, np.zeros(len(names), int), True, "", 1, 0.0
    )  # fmt: skip
    return Fit(
        (), names, names, dict.fromkeys(names, 0.0), cost, residual, columns, np.ones(len(residual), bool), frozenset(),
        True, "", solution,
    )  # fmt: skip


@dataclass(frozen=True)
class LinearProblem(Problem):
    """A linear model in the place of the compiled one: misfit of the ideal valve, parameters' columns, signatures.

    misfit (rows,), nuisance (rows, parameters) and signatures {effect: (rows,)}, all in units of the noise; a signature is
    what one `scale` of the effect does. Amounts keep to the library's limits. A discrepancy whitens all of them.
    """

    misfit: np.ndarray = field(default_factory=lambda: np.zeros(0))
    nuisance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    signatures: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def order(self) -> tuple[str, ...]:
        return (*PARAMETERS[: self.nuisance.shape[1]], *self.library.names)

    def fit(
        self,
        effects: Iterable[str] = (),
        start: Mapping[str, float] | None = None,
        *,
        patient: bool = False,
        hop_basins: bool = False,
        far: bool = False,
        most_steps: int = 0,
        goal: float = np.inf,
    ) -> Fit:
        chosen = tuple(name for name in self.library.names if name in set(effects))
        free = (*PARAMETERS[: self.nuisance.shape[1]], *chosen)
        columns, size = self._columns, np.array([_size(name) for name in free])
        limits = [(EFFECTS[n].lower, EFFECTS[n].upper) if n in EFFECTS else (-np.inf, np.inf) for n in free]
        used = np.ones(len(self.misfit), dtype=bool) if self.used is None else self.used
        at = columns[:, [self.order.index(name) for name in free]] * size
        solved = lsq_linear(at[used], -self._beside_missed(self.misfit)[used], np.array(limits).T / size, method="bvls")
        values = dict(zip(free, (float(v) for v in solved.x * size), strict=True))
        pressed = [name for name, side in zip(free, solved.active_mask, strict=True) if side]
        return self._at(values, chosen, free, frozenset(pressed))

    def evaluate(self, values: Mapping[str, float], effects: Iterable[str] = ()) -> Fit:
        return self._at(values, (), (), frozenset())

    def read_by_model(self, key: Key, at: Fit) -> np.ndarray:
        """Nothing: what it misses is made up, not read."""
        return np.zeros(self.tests[key[0]].rows)

    def with_all_columns(self, fit: Fit) -> Fit:
        return fit

    @property
    def _columns(self) -> np.ndarray:
        own = [self.signatures[name] / _size(name) for name in self.library.names]
        return self._beside_missed(np.concatenate([self.nuisance, *(column[:, None] for column in own)], axis=1))

    def _beside_missed(self, columns: np.ndarray) -> np.ndarray:
        if self.discrepancy is None:
            return columns
        priors = len(self.discrepancy.columns) - len(columns)
        padded = np.concatenate([columns, np.zeros((priors, *columns.shape[1:]))])
        return self.discrepancy.whitened(padded.T).T[: len(columns)]

    def _at(
        self, values: Mapping[str, float], effects: tuple[str, ...], free: tuple[str, ...], active: frozenset[str]
    ) -> Fit:
        at = {name: values.get(name, 0.0) for name in self.order}
        residual = self._beside_missed(self.misfit) + self._columns @ np.array(list(at.values()))
        made = linear_fit(residual, self._columns, self.order)
        used = np.ones(len(made.residual), dtype=bool)
        if self.used is not None:
            used[: len(self.used)] = self.used
        chi2 = float(np.sum(made.residual[used] ** 2))
        return replace(made, effects=effects, free=free, values=at, chi2=chi2, used=used, active=active)


def _size(name: str) -> float:
    return EFFECTS[name].scale if name in EFFECTS else 1.0


def linear_library(
    misfit: np.ndarray, nuisance: np.ndarray, signatures: dict[str, np.ndarray], used: np.ndarray | None = None
) -> LinearProblem:
    """A problem over the rows of a small bench whose library is `signatures`."""
    plain = linear_problem(NoiseCorrelation())
    library = Library(tuple(signatures), {})
    return LinearProblem(
        plain.record, plain.tests, plain.plans, library, plain.noise, used, misfit=misfit, nuisance=nuisance,
        signatures=signatures,
    )  # fmt: skip
