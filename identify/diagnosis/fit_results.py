"""A `FitResult` of a diagnosis's fit: the plain fit's words and figures, with effects among the parameters."""

from dataclasses import replace

import numpy as np

from thermohyd.effects.registry import effect_info

from ..channel_noise import ChannelNoise
from ..covariance import Block, Covariance, covariance_of
from ..dynamic.words import verdict_of_motion
from ..fit_result import FitResult
from ..fitted import Fitted, Key
from ..noise_correlation import NoiseCorrelation
from ..outcome import fit_result
from ..parameters import ParameterInfo, ParameterPlan
from ..static_model import channel_slices
from .library_fit import LibraryFit, LibraryProblem
from .record_noise import NoiseFound, first_noise


PINT_UNITS = {"1": "dimensionless", "Pa/(m3/s)^2": "Pa*s**2/m**6"}


def effect_plan(name: str) -> ParameterPlan:
    """An effect's amount as a parameter of a fit."""
    info = effect_info(name)
    as_parameter = ParameterInfo(name, info.unit, 0.0, info.lower, info.upper, info.scale, info.sentence)
    return ParameterPlan(as_parameter, 0.0, False, info.lower, info.upper)


def gls_covariance(fit: LibraryFit, scale: float, priors: int) -> Covariance:
    """(J'J)^-1 of the whitened problem over `fit.free`; scale: variance of the whitened residuals where it exceeds 1.

    priors: rows at the end that are no readings.
    """
    columns = fit.columns[:, [fit.order.index(name) for name in fit.free]][fit.used]
    active = np.array([fit.solution.active[fit.order.index(name)] for name in fit.free])
    rows = len(columns) - priors
    block = Block(slice(0, rows), np.zeros(rows, dtype=int), NoiseCorrelation(), max(scale, 1.0))
    return covariance_of(columns, fit.free, active, [block], slice(rows, rows + priors))


def result_of(
    problem: LibraryProblem,
    fit: LibraryFit,
    fitted: Fitted,
    noise: dict[Key, NoiseFound],
    scale: float,
) -> FitResult:
    """Everything that a plain fit reports, for `fit`; error bars by generalised least squares with the noise found."""
    white = problem.with_noise(first_noise(_as_channel_noise(noise)))
    at = white.evaluate(fit.values, fit.effects)
    slices = channel_slices(fitted.tests)
    count = max(s.stop for s in slices.values()) + len(fit.free)
    columns = [at.order.index(name) for name in fit.free]
    residual, jacobian = np.zeros(count), np.zeros((count, len(fit.free)))
    for key, rows in problem.rows().items():
        residual[slices[key]] = at.residual[rows]
        jacobian[slices[key]] = at.columns[rows][:, columns]
    for i, name in enumerate(fit.free):
        if name in problem.parameters:
            k = len(at.residual) - len(problem.parameters) + problem.parameters.index(name)
            residual[count - len(fit.free) + i], jacobian[count - len(fit.free) + i] = (
                at.residual[k],
                at.columns[k, columns],
            )
    pick = [fit.order.index(name) for name in fit.free]
    solution = replace(
        fit.solution,
        p=fit.solution.p[pick],
        z=fit.solution.z[pick],
        start=fit.solution.start[pick],
        active=fit.solution.active[pick],
        cost=float(np.sum(residual**2)),
        residual=residual,
        jacobian=jacobian,
    )
    plans = {name: plan for name, plan in fitted.plans.items()} | {name: effect_plan(name) for name in fit.effects}
    whole = replace(
        fitted, plans=plans, free=fit.free, noise=_as_channel_noise(noise), solution=solution, starts=fitted.starts
    )
    found = fit_result(whole, gls_covariance(fit, scale, len(problem.parameters)))
    if not problem.in_motion:
        return found
    words = verdict_of_motion(found.channels, found.converged, found.message)
    return replace(found, rows=sum(test.rows for test in fitted.tests.values()), verdict=words)


def _as_channel_noise(noise: dict[Key, NoiseFound]) -> dict[Key, ChannelNoise]:
    return {key: ChannelNoise(n.std, n.source, n.known, False, n.std) for key, n in noise.items()}
