"""What is known of each parameter beyond its covariance: profiles, draws of the posterior, coverage, and one row that says it all.

Plain numbers and words, SI. No JAX here.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np


LEVELS = (0.68, 0.95, 0.99)  # of nested intervals

Shape = Literal["bounded", "one-sided", "flat"]
Verdict = Literal["identified", "practically not", "structurally not"]


@dataclass(frozen=True)
class ProfilePoint:
    """One parameter held at `value` (SI), the others at their best: chi-square above the optimum's, and which of them press against
    a limit there."""

    value: float
    rise: float
    pressed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Nested:
    """An interval (SI) at one level. open_low, open_high: the parameter's limits ended it, not the data."""

    level: float
    low: float
    high: float
    open_low: bool = False
    open_high: bool = False


def at_level(intervals: tuple[Nested, ...], level: float) -> Nested:
    return next(interval for interval in intervals if interval.level == level)


@dataclass(frozen=True)
class ProfileOf:
    """The likelihood profile of one parameter.

    intervals: at `LEVELS`, each inside the next. rises: of chi-square, where each of them ends. shape: of the 95 % interval: bounded,
    one-sided (it runs into a limit on one side) or flat (on both). seen: by how much chi-square rises at most; near 0 the data do
    not see the parameter at all.
    """

    name: str
    points: tuple[ProfilePoint, ...]
    intervals: tuple[Nested, ...]
    rises: tuple[float, ...]
    shape: Shape
    seen: float

    def at(self, level: float) -> Nested:
        return at_level(self.intervals, level)


@dataclass(frozen=True)
class PosteriorOf:
    """What the draws say of one parameter (SI): mean, standard deviation, central intervals at `LEVELS`, and how the chains agree (r_hat
    nan of proposals weighed by importance)."""

    name: str
    mean: float
    std: float
    intervals: tuple[Nested, ...]
    r_hat: float
    ess_bulk: float
    ess_tail: float

    def at(self, level: float) -> Nested:
        return at_level(self.intervals, level)


@dataclass(frozen=True)
class Posterior:
    """Draws of all parameters together.

    draws (chains, draws, parameters), SI, in the order of `names`; divergent and energy (chains, draws). target: the acceptance that
    the step size was tuned to, and tried: all that were. trouble: why nothing is reported; `parameters` is then empty.
    prior: in words. file: the draws as NetCDF, empty where they could not be written. proposals: 0 of the no-U-turn sampler; else so many
    were weighed (`importance`), pareto_k is the shape of their weights' tail (nan: they have none), and the draws, one chain, were
    drawn from them by weight.
    """

    names: tuple[str, ...]
    draws: np.ndarray = field(repr=False)
    divergent: np.ndarray = field(repr=False)
    energy: np.ndarray = field(repr=False)
    warmup: int
    seed: int
    target: float
    tried: tuple[float, ...]
    parameters: dict[str, PosteriorOf]
    prior: str
    trouble: str = ""
    file: bytes = field(default=b"", repr=False)
    notes: tuple[str, ...] = ()
    proposals: int = 0
    pareto_k: float = float("nan")


@dataclass(frozen=True)
class CoverageOf:
    """How often a parameter's 95 % interval held the truth in records simulated at this fit, of those that gave an interval.

    low, high: 95 % interval of that share (Clopper and Pearson, Biometrika 26, 1934).
    """

    name: str
    held: int
    records: int
    low: float
    high: float

    @property
    def share(self) -> float:
        return self.held / self.records if self.records else float("nan")


@dataclass(frozen=True)
class Remedy:
    """The change of the tests that narrows a parameter most: in words, and its standard error then, of today's (1: no change)."""

    words: str
    factor: float


@dataclass(frozen=True)
class KnownParameter:
    """The row of one free parameter (SI; of a relative one, in SI all the same).

    prior_share: of all information on it, the part that priors brought: 0 the data alone, 1 the priors alone; None where nothing is
    known. bound: "lower", "upper" or "". trades_with: the parameter that it is most correlated with, and how much. averaged: its
    interval is averaged over models that explain the record alike, named here.
    """

    name: str
    value: float
    unit: str
    std: float | None
    ci95: tuple[float, float] | None
    verdict: Verdict
    why: str
    prior_share: float | None
    bound: str
    trades_with: tuple[str, float] | None
    profile: ProfileOf | None = None
    posterior: PosteriorOf | None = None
    coverage: CoverageOf | None = None
    remedy: Remedy | None = None
    averaged: tuple[str, ...] = ()


@dataclass(frozen=True)
class PredictedFigure:
    """A figure of the valve at one condition (SI), which need not have been read: its value, standard error and interval by the
    covariance (None where they say nothing), and the 95 % interval by its profile."""

    name: str
    test: str
    temperature: float
    supply_pressure: float
    value: float
    unit: str
    std: float | None
    ci95: tuple[float, float] | None
    profile: Nested


@dataclass(frozen=True)
class Knowledge:
    """All rows, in the order of the fit, and what they were made from. profiled: whether profiles were asked."""

    rows: dict[str, KnownParameter]
    profiled: bool = False
    posterior: Posterior | None = None
    simulated: int = 0  # records of the coverage
    failed: int = 0  # of these, fits that did not converge
    seed: int = 0
    notes: tuple[str, ...] = ()
    predictions: tuple[PredictedFigure, ...] = ()  # with the profiles, of static tests
