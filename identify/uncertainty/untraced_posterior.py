"""The logarithm of the posterior of what is no one traced function: runs in time, which are integrated piece by piece, and oil stored at
the ports. The same likelihood and priors as of static tests (`log_posterior`), from the residuals of a problem."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.outcome import Fitted, Uncertainty
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit

from .finished_fit import effects_of, problem_of
from .log_posterior import Clamp, around_a_solution, noise_of_fit, priors_in_words


@dataclass(frozen=True)
class UntracedPosterior:
    """log_density(u (n,)) -> ln posterior + constant, on the host. start (n,): u of the optimum; covariance (n, n): of u, a first idea.

    names: of the parameters, in order. clamp: from u to the fit's own units, `sizes` (n,) from these to SI. prior: in words.
    """

    names: tuple[str, ...]
    log_density: Callable[[np.ndarray], float]
    clamp: Clamp
    start: np.ndarray
    covariance: np.ndarray
    prior: str
    sizes: np.ndarray | None = None


def is_traced(tests: Mapping[str, TestRecord], effects: Iterable[str]) -> bool:
    """Whether the residuals of these tests and effects are one traced function."""
    return not any(test.in_motion for test in tests.values()) and not any(stores(name) for name in effects)


def untraced_posterior(fitted: Fitted, known: Uncertainty) -> UntracedPosterior:
    """Of a fit's free parameters, amounts of effects and of sensors included.

    Around the optimum of this likelihood, which counts the memory of the noise: that of the fit may lie several standard errors away.
    """
    problem = problem_of(fitted, noise_of_fit(fitted, known))
    fit = problem.fit(effects_of(fitted), fitted.values, patient=True)
    return untraced_posterior_of(problem, fit, 1.0, fit.free, [1.0] * len(fit.free))


def untraced_posterior_of(
    problem: Problem, fit: Fit, scale: float, names: Sequence[str], sizes: Sequence[float]
) -> UntracedPosterior:
    """Of the free entries of a problem's fit, as `log_posterior_of`."""
    clamp, start, covariance = around_a_solution(problem, fit, scale)
    density = _log_density(problem, fit.effects, fit.free, fit.values, clamp, scale)
    words = priors_in_words(problem.plans, fit.free)
    return UntracedPosterior(tuple(names), density, clamp, start, covariance, words, np.asarray(sizes))


def _log_density(
    problem: Problem,
    effects: tuple[str, ...],
    free: tuple[str, ...],
    values: Mapping[str, float],
    clamp: Clamp,
    scale: float,
) -> Callable[[np.ndarray], float]:
    priors = len(problem.parameters)

    def log_density(u: np.ndarray) -> float:
        at = jnp.asarray(u)
        p = np.asarray(clamp.physical(at))
        found = problem.evaluate({**values, **dict(zip(free, p.tolist(), strict=True))}, effects)
        squares = found.residual**2
        rows = len(squares) - priors
        whole = float(clamp.log_slope(at)) - 0.5 * float(np.sum(squares[:rows]) / scale + np.sum(squares[rows:]))
        return whole if np.isfinite(whole) else -np.inf

    return log_density
