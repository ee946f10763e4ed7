"""What a fit of a problem says of its free entries alone, and of the noise."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.level import ChannelNoise

from .least_squares import LeastSquaresResult
from .problem import Problem
from .problem_fit import Fit
from .static_readings import channel_slices
from .uncertainty import Block, Covariance, Key, covariance_of, settled_noise


def solution_of(problem: Problem, fit: Fit, seen: Fit | None = None) -> LeastSquaresResult:
    """`fit` over its free entries alone, rows as `channel_slices` lays them out, the free entries' priors behind them.

    seen: residual and columns to take instead, of the same point seen with other noise.
    """
    seen = fit if seen is None else seen
    slices = channel_slices(problem.tests)
    count = max(s.stop for s in slices.values()) + len(fit.free)
    columns = [seen.order.index(name) for name in fit.free]
    residual, jacobian = np.zeros(count), np.zeros((count, len(fit.free)))
    for key, rows in problem.rows().items():
        residual[slices[key]] = seen.residual[rows]
        jacobian[slices[key]] = seen.columns[rows][:, columns]
    priors = len(seen.residual) - len(problem.parameters)
    for i, name in enumerate(fit.free, start=count - len(fit.free)):
        if name in problem.parameters:
            k = priors + problem.parameters.index(name)
            residual[i], jacobian[i] = seen.residual[k], seen.columns[k, columns]
    pick = [fit.order.index(name) for name in fit.free]
    whole = fit.solution
    return replace(
        whole, p=whole.p[pick], z=whole.z[pick], start=whole.start[pick], active=whole.active[pick],
        cost=float(np.sum(residual**2)), residual=residual, jacobian=jacobian,
    )  # fmt: skip


def misfit_scale(problem: Problem, fit: Fit) -> float:
    """Reduced chi-square of the readings beside a fit, at least 1."""
    rows = len(fit.residual) - len(problem.parameters)
    return max(fit.chi2 / max(rows - len(fit.free), 1), 1.0)


def gls_covariance(fit: Fit, scale: float, priors: int, beside: np.ndarray | None = None) -> Covariance:
    """(J'J)^-1 of the whitened problem over `fit.free`; scale: variance of the whitened residuals where it exceeds 1.

    priors: rows at the end that are no readings. beside (rows, k): columns of what was fitted with it; its rows stand last.
    """
    columns = fit.columns[:, [fit.order.index(name) for name in fit.free]]
    active = np.array([fit.solution.active[fit.order.index(name)] for name in fit.free])
    names = fit.free
    if beside is not None:
        columns = np.concatenate([columns, beside], axis=1)
        active = np.append(active, np.zeros(beside.shape[1], dtype=int))
        names = (*names, *(f"coefficient {i + 1} of the term" for i in range(beside.shape[1])))
    columns = columns[fit.used]
    rows = len(columns) - priors
    block = Block(slice(0, rows), np.zeros(rows, dtype=int), NoiseCorrelation(), max(scale, 1.0))
    return covariance_of(columns, names, active, [block], slice(rows, rows + priors))


def noise_settled_by(problem: Problem, fit: Fit, noise: Mapping[Key, ChannelNoise]) -> dict[Key, ChannelNoise]:
    """The noise of each channel as the residuals of `fit` show it (`settled_noise`)."""
    scales = np.array([problem.scale_of(name) for name in fit.free])
    columns = fit.columns[:, [fit.order.index(name) for name in fit.free]] * scales
    position = fit.column("null_bias") if "null_bias" in fit.order else None
    return settled_noise(noise, problem.rows(), fit.residual, columns, position)
