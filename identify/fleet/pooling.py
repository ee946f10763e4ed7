"""Lines through what was measured on many valves of one type, each informed by all: a linear mixed model in closed form.

Record j of valve i gives y_ij with its own standard error s_ij:

    y_ij = a_i + b_i t_ij + sum_k c_ik [t_ij > T_ik] + e_ij,    e_ij ~ N(0, s_ij^2 + tau^2),    (a_i, b_i) ~ N((alpha, beta), S)

T_ik are the valve's overhauls (`overhauls.py`); a step c_ik is free. tau is what one test differs from the next beyond its error
bar: another bench, another oil. S and tau are those of the restricted likelihood (Patterson & Thompson, Biometrika 58, 1971) under flat
priors of sigma_a, sigma_b and tau, averaged over what else they may be, which matters where there are few valves (importance sampling).
Given them everything is linear (Henderson's equations; Laird & Ware, Biometrics 38, 1982). Of one valve alone it is its own line.
NumPy and SciPy; no JAX.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.stats import chi2, norm
from scipy.stats.qmc import Sobol


ITERATIONS = 200
# Logarithms of sigma_a, sigma_b and tau and the inverse hyperbolic tangent of the correlation, in units in which values are of order one.
BOUNDS = [(-12.0, 3.0), (-12.0, 3.0), (-3.0, 3.0), (-12.0, 3.0)]
NO_TAU = -12.0
DRAWS, FREEDOM = 64, 5
FEWEST_FOR_TAU = 3  # records of a valve beyond its coefficients, over the type, without which tau is 0


@dataclass(frozen=True)
class Series:
    """One valve: times, values and their standard errors, (records,) each, in the order of time; steps: before which records.

    A record without a value has an infinite standard error.
    """

    time: np.ndarray
    value: np.ndarray
    std: np.ndarray
    steps: tuple[int, ...] = ()


@dataclass(frozen=True)
class Pooled:
    """Lines of all valves of a type, in the units of the series; times count from `origin`.

    mean (valves, 2): level at the origin, after the last step, and slope; covariance (valves, 2, 2): of both, the uncertainty of the
    type's line included. population (2,), population_covariance: the type's. spread (2, 2): S. tau.
    """

    origin: float
    mean: np.ndarray
    covariance: np.ndarray
    population: np.ndarray
    population_covariance: np.ndarray
    spread: np.ndarray
    tau: float

    def at(self, valve: int, time: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(value, its standard deviation) of a valve's line at a time."""
        t = np.atleast_1d(np.asarray(time, dtype=float)) - self.origin
        design = np.stack([np.ones_like(t), t], axis=-1)
        variance = np.einsum("ti,ij,tj->t", design, self.covariance[valve], design)
        return design @ self.mean[valve], np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class _Scaled:
    """All series as one array, in units in which values and times are of order one; a pad weighs nothing."""

    origin: float
    span: float  # of the time
    centre: float
    size: float  # of the values
    design: np.ndarray  # (valves, records, 2 + steps)
    value: np.ndarray  # (valves, records)
    variance: np.ndarray
    real: np.ndarray  # 1 where a record is
    used: np.ndarray  # (valves, 2 + steps): 1 where a valve has this coefficient


def fit_pooled(valves: Sequence[Series], *, averaged: bool = True) -> Pooled:
    """The lines of all valves of a type. averaged: over what S and tau may be; else at their best. Raises ValueError where there
    is no record."""
    scaled = _scaled(valves)
    spare = scaled.real.sum(axis=1) - scaled.used.sum(axis=1)
    bounds = [*BOUNDS[:3], BOUNDS[3] if spare[spare > 0].sum() >= FEWEST_FOR_TAU else (NO_TAU, NO_TAU)]
    cost = lambda x: _solve(scaled, x).cost
    best = minimize(cost, [-0.5, -1.5, 0.0, -2.5], method="L-BFGS-B", bounds=bounds, options={"maxiter": ITERATIONS}).x
    points, weights = _about(cost, best, bounds) if averaged else ([best], np.ones(1))
    solved = [_solve(scaled, x) for x in points]
    lines = [_after_last_step(scaled, one) for one in solved]
    mean, covariance = _mixed(weights, [m for m, _ in lines], [c for _, c in lines])
    population, its = _mixed(weights, [one.population for one in solved], [one.population_covariance for one in solved])
    per = np.array([scaled.size, scaled.size / scaled.span])
    level = np.array([scaled.centre, 0.0])
    return Pooled(
        origin=scaled.origin,
        mean=mean * per + level,
        covariance=covariance * np.outer(per, per),
        population=population * per + level,
        population_covariance=its * np.outer(per, per),
        spread=_spread(best) * np.outer(per, per),
        tau=float(np.exp(best[3])) * scaled.size if best[3] > NO_TAU else 0.0,
    )


def _about(
    cost: Callable[[np.ndarray], float], best: np.ndarray, bounds: Sequence[tuple[float, float]]
) -> tuple[list[np.ndarray], np.ndarray]:
    """(points about the optimum, weights): what S and tau may be as well, which few valves leave open.

    Importance sampling from a t law with 5 degrees of freedom and the curvature at the optimum; the points are always the same.
    """
    low, high = np.array(bounds).T
    free = np.flatnonzero(low < high)
    curvature = _hessian(lambda part: cost(_put(best, free, part)), best[free], low[free], high[free])
    values, vectors = np.linalg.eigh(curvature)
    root = vectors / np.sqrt(np.maximum(values, 0.1))
    uniform = Sobol(len(free) + 1, rng=0).random(DRAWS)
    uniform = np.clip(uniform, 1e-6, 1.0 - 1e-6)
    length = np.sqrt(chi2.ppf(uniform[:, -1], FREEDOM) / FREEDOM)[:, None]
    standard = norm.ppf(uniform[:, :-1]) / length
    standard[0] = 0.0
    points = [_put(best, free, part) for part in best[free] + standard @ root.T]
    within = np.array([bool(np.all((x >= low) & (x <= high))) for x in points])
    proposal = -0.5 * (FREEDOM + len(free)) * np.log1p((standard**2).sum(axis=1) / FREEDOM)
    log = np.array([-cost(x) if inside else -np.inf for x, inside in zip(points, within, strict=True)]) - proposal
    weights = np.exp(log - log.max())
    kept = weights > 1e-6 * weights.sum()
    return [x for x, keep in zip(points, kept, strict=True) if keep], weights[kept] / weights[kept].sum()


def _put(x: np.ndarray, free: np.ndarray, part: np.ndarray) -> np.ndarray:
    new = x.copy()
    new[free] = part
    return new


def _hessian(cost: Callable[[np.ndarray], float], x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Second differences, about a point that lies a step within the bounds."""
    step, count = 0.1, len(x)
    x = np.clip(x, low + step, high - step)
    unit = step * np.eye(count)
    hessian = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            corners = [cost(x + a * unit[i] + b * unit[j]) * a * b for a in (1, -1) for b in (1, -1)]
            hessian[i, j] = hessian[j, i] = sum(corners) / (4.0 * step * step)
    return hessian


def _mixed(
    weights: np.ndarray, means: list[np.ndarray], covariances: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a mixture of normal laws."""
    every = np.array(means)
    mean = np.tensordot(weights, every, 1)
    off = every - mean
    between = np.einsum("k,k...i,k...j->...ij", weights, off, off)
    return mean, np.tensordot(weights, np.array(covariances), 1) + between


def robust_tau(valves: Sequence[Series]) -> float:
    """tau of what lies between neighbouring records: each against the line through the one before and the one after, by the median
    over all, which a few steps and bad tests do not move. Infinite where no valve has three records in a row."""
    contrasts, own, share = [], [], []
    for series in valves:
        for k in range(1, len(series.time) - 1):
            before, after = series.time[k] - series.time[k - 1], series.time[k + 1] - series.time[k]
            if not np.isfinite(series.std[k - 1 : k + 2]).all() or before + after <= 0.0:
                continue
            a = np.array([-after, before + after, -before]) / (before + after)
            contrasts.append(float(a @ series.value[k - 1 : k + 2]) ** 2)
            own.append(float(a**2 @ series.std[k - 1 : k + 2] ** 2))
            share.append(float(a @ a))
    if not contrasts:
        return np.inf
    square, variance, weight = np.array(contrasts), np.array(own), np.array(share)
    excess = lambda tau: float(np.median(square / (variance + weight * tau**2))) - float(chi2.median(1))
    high = float(np.sqrt(square.max() / weight.min())) * 2.0
    if not (high > 0.0 and excess(0.0) > 0.0):
        return 0.0
    root: Any = brentq(excess, 0.0, high)
    return float(root)


def step_evidence(valves: Sequence[Series], pooled: Pooled) -> list[np.ndarray]:
    """For each valve, how much chi-square a further free step before each of its records 1, 2, ... would gain, one degree of
    freedom each, given the type's line and spread; 0 where there is a step already. (records - 1,)"""
    gains = []
    for series in valves:
        t = series.time - pooled.origin
        weight = 1.0 / (series.std**2 + pooled.tau**2)
        line = np.stack([np.ones_like(t), t], axis=1)
        steps = [_step(len(t), k) for k in series.steps]
        design = np.column_stack([line, *steps])
        precision = np.zeros((design.shape[1],) * 2)
        precision[:2, :2] = np.linalg.inv(pooled.spread + pooled.population_covariance)
        projector = np.diag(weight) - _sandwich(design, weight, precision)
        residual = projector @ (series.value - line @ pooled.population)
        gain = np.zeros(len(t) - 1)
        for k in range(1, len(t)):
            column = _step(len(t), k)
            information = column @ projector @ column
            if k not in series.steps and information > 1e-12 * weight.sum():
                gain[k - 1] = (column @ residual) ** 2 / information
        gains.append(gain)
    return gains


def _step(records: int, before: int) -> np.ndarray:
    """1 from this record on."""
    return (np.arange(records) >= before).astype(float)


def _sandwich(design: np.ndarray, weight: np.ndarray, precision: np.ndarray) -> np.ndarray:
    weighted = design * weight[:, None]
    return weighted @ np.linalg.solve(design.T @ weighted + precision, weighted.T)


def _scaled(valves: Sequence[Series]) -> _Scaled:
    known = [np.isfinite(series.std) for series in valves]
    if not any(one.any() for one in known):
        raise ValueError("a trend needs a record")
    times = np.concatenate([series.time[here] for series, here in zip(valves, known, strict=True)])
    values = np.concatenate([series.value[here] for series, here in zip(valves, known, strict=True)])
    origin, centre = float(np.mean(times)), float(np.median(values))
    span = float(np.std(times)) or 1.0
    errors = np.concatenate([series.std[here] for series, here in zip(valves, known, strict=True)])
    size = float(np.std(values)) or float(np.median(errors)) or 1.0
    records, steps = max(len(series.time) for series in valves), max(len(series.steps) for series in valves)
    shape = (len(valves), records)
    design, used = np.zeros((*shape, 2 + steps)), np.zeros((len(valves), 2 + steps))
    value, variance, real = np.zeros(shape), np.ones(shape), np.zeros(shape)
    for i, series in enumerate(valves):
        n = len(series.time)
        design[i, :n, 0] = 1.0
        design[i, :n, 1] = (series.time - origin) / span
        for k, before in enumerate(series.steps):
            design[i, :n, 2 + k] = _step(n, before)
        used[i, : 2 + len(series.steps)] = 1.0
        for k, before in enumerate(series.steps):  # a step that none of its records shows is held at 0
            later = series.steps[k + 1] if k + 1 < len(series.steps) else n
            used[i, 2 + k] = float(known[i][before:later].any() and known[i][:before].any())
        value[i, :n] = np.where(known[i], (series.value - centre) / size, 0.0)
        variance[i, :n] = np.where(known[i], (series.std / size) ** 2, 1.0)
        real[i, :n] = known[i]
    return _Scaled(origin, span, centre, size, design, value, variance, real, used)


def _spread(x: np.ndarray) -> np.ndarray:
    a, b, rho = np.exp(x[0]), np.exp(x[1]), np.tanh(x[2])
    return np.array([[a * a, rho * a * b], [rho * a * b, b * b]])


@dataclass(frozen=True)
class _Solved:
    """Minus the log of the restricted likelihood, the type's line, and each valve's coefficients."""

    cost: float
    population: np.ndarray
    population_covariance: np.ndarray
    mean: np.ndarray  # (valves, 2 + steps)
    covariance: np.ndarray


def _solve(scaled: _Scaled, x: np.ndarray) -> _Solved:
    """Woodbury throughout: nothing larger than a valve's own coefficients is inverted."""
    design, valves = scaled.design, len(scaled.design)
    spread = _spread(x)
    precision2 = np.linalg.inv(spread)
    weight = scaled.real / (scaled.variance + np.exp(2.0 * x[3]))
    count = design.shape[2]
    precision = np.zeros((valves, count, count))
    precision[:, :2, :2] = precision2
    index = np.arange(2, count)
    precision[:, index, index] = (
        1.0 - scaled.used[:, 2:]
    )  # a step that a valve lacks is held at 0; one that it has is free
    weighted = design * weight[:, :, None]
    inner = np.einsum("vri,vrj->vij", weighted, design) + precision
    inverse = np.linalg.inv(inner)
    right = np.einsum("vri,vr->vi", weighted, scaled.value)
    of_line = np.einsum("vri,vrj->vij", weighted, design[:, :, :2])
    # of V^-1, by valve: X'V^-1 X, X'V^-1 y, y'V^-1 y
    gram = of_line[:, :2, :] - np.einsum("vji,vjk,vkl->vil", of_line, inverse, of_line)
    moment = right[:, :2] - np.einsum("vji,vjk,vk->vi", of_line, inverse, right)
    square = np.einsum("vr,vr->v", weight, scaled.value**2) - np.einsum("vi,vij,vj->v", right, inverse, right)
    covariance = np.linalg.inv(gram.sum(axis=0) + 1e-9 * np.eye(2))
    population = covariance @ moment.sum(axis=0)
    misfit = square.sum() - moment.sum(axis=0) @ population
    logs = -np.log(weight[scaled.real > 0]).sum() + np.linalg.slogdet(inner)[1].sum()
    logs += valves * np.linalg.slogdet(spread)[1] - np.linalg.slogdet(covariance)[1]
    prior = np.zeros(count)
    prior[:2] = precision2 @ population
    mean = np.einsum("vij,vj->vi", inverse, right + prior)
    pull = inverse[:, :, :2] @ precision2
    spreads = inverse + pull @ covariance @ np.swapaxes(pull, 1, 2)
    return _Solved(0.5 * (misfit + logs) - x[0] - x[1] - x[3], population, covariance, mean, spreads)


def _after_last_step(scaled: _Scaled, solved: _Solved) -> tuple[np.ndarray, np.ndarray]:
    """Level and slope of each valve with all its steps behind it, and their covariance."""
    sums = np.zeros((len(scaled.design), 2, scaled.design.shape[2]))
    sums[:, 0, 0] = sums[:, 1, 1] = 1.0
    sums[:, 0, 2:] = scaled.used[:, 2:]
    mean = np.einsum("vij,vj->vi", sums, solved.mean)
    return mean, sums @ solved.covariance @ np.swapaxes(sums, 1, 2)
