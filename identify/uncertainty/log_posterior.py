"""The logarithm of the posterior of static tests, of a fit or of a diagnosis, as one traced function of unbounded variables.

The likelihood is the fit's, with its noise as estimated: also with its memory, which the fit itself counts only in its error bars. A
diagnosis's has its effects, the faults of the bench that it found and the discrepancy that it puts beside the noise. Priors are those of
`[start]`, and flat within every parameter's limits.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from thermohyd.identify.fitting.bench_faults import is_fault
from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.fit import StaticSearch
from thermohyd.identify.fitting.library_rows import LibraryArgs, residual_alone
from thermohyd.identify.fitting.outcome import Fitted, Uncertainty
from thermohyd.identify.fitting.parameters import ParameterPlan
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import solution_of
from thermohyd.identify.fitting.readings import Noise, StaticReadings
from thermohyd.identify.fitting.sensed import SignalRows
from thermohyd.identify.fitting.static_residuals import prior_rows, residual_of
from thermohyd.identify.noise.whitening import whiten

from .finished_fit import effects_of, problem_of


Density = Callable[[Any, Any], Any]  # (u, data) -> ln posterior + constant

WIDEST = 0.25  # of a parameter's limits: the standard deviation that a search for the posterior begins with at most


class Clamp(eqx.Module):
    """p = lower + s (softplus(u) - softplus(u - w)): inside the limits for every u, and u itself, in steps of s, far from both.

    w = (upper - lower)/s. Near a limit p goes to it exponentially, so that a posterior heaped up there has a smooth density in u.
    """

    lower: Float[Array | np.ndarray, " n"]
    step: Float[Array | np.ndarray, " n"]
    width: Float[Array | np.ndarray, " n"]

    def physical(self, u: Float[Array, " n"]) -> Float[Array, " n"]:
        """p, SI."""
        return jnp.asarray(self.lower) + self.step * (jax.nn.softplus(u) - jax.nn.softplus(u - self.width))

    def log_slope(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """ln of the determinant of dp/du."""
        own = jax.nn.log_sigmoid(u) + jax.nn.log_sigmoid(self.width - u) + jnp.log(-jnp.expm1(-self.width))
        return jnp.sum(own + jnp.log(self.step))

    def free(self, p: np.ndarray) -> np.ndarray:
        """u of p (n,), which is moved inside where it sits at a limit."""
        y = (np.asarray(p) - self.lower) / self.step
        y = np.clip(y, np.minimum(0.1, 0.01 * self.width), self.width - np.minimum(0.1, 0.01 * self.width))
        # softplus(u) - softplus(u - w) = y in closed form: e^u = (e^y - 1) / (1 - e^(y - w)).
        large = y > 30.0
        start = np.where(large, y, np.log(np.expm1(np.where(large, 1.0, y))))
        return start - np.log(-np.expm1(y - self.width))

    def slope(self, u: np.ndarray) -> np.ndarray:
        """dp/du (n,)."""
        sigmoid = lambda x: 1.0 / (1.0 + np.exp(-np.clip(x, -700.0, 700.0)))
        return np.asarray(self.step) * sigmoid(u) * sigmoid(self.width - u) * -np.expm1(-np.asarray(self.width))


@dataclass(frozen=True)
class LogPosterior:
    """density(u, data) -> ln posterior + constant, traced. start (n,): u of the optimum; covariance (n, n): of u, a first idea.

    names: of the parameters, in order. clamp: from u to the fit's own units, `sizes` (n,) from these to SI. data: everything else that
    the density depends on.
    """

    names: tuple[str, ...]
    density: Density
    clamp: Clamp
    start: np.ndarray
    covariance: np.ndarray
    data: Any
    prior: str
    sizes: np.ndarray | None = None


def noise_of_fit(fitted: Fitted, known: Uncertainty) -> Noise:
    """The noise as a fit estimated it, with its memory, and as large as what it leaves."""
    blocks = known.blocks
    return Noise(
        {key: fitted.noise[key].used * np.sqrt(block.variance) for key, block in blocks.items()},
        {key: block.correlation for key, block in blocks.items()},
    )


def around_a_solution(problem: Problem, fit: Fit, scale: float) -> tuple[Clamp, np.ndarray, np.ndarray]:
    """The change of variables of the free entries of a problem's fit, their optimum (n,) and its covariance (n, n) there. scale:
    variance of the whitened residuals where that exceeds 1."""
    boxes = [problem.box_of(name, fit.values[name]) for name in fit.free]
    solution = solution_of(problem, fit)
    return _whitened(boxes, solution.p, solution.jacobian, np.full(len(boxes), scale))


def log_posterior(fitted: Fitted, known: Uncertainty) -> LogPosterior:
    """Of a static fit's free parameters, amounts of effects and of sensors included."""
    noise = noise_of_fit(fitted, known)
    plans = {name: fitted.plans[name] for name in fitted.free}
    boxes = [Box(name, plan.start, plan.info.scale, plan.lower, plan.upper) for name, plan in plans.items()]
    solution = fitted.solution
    clamp, start, covariance = _whitened(boxes, solution.p, solution.jacobian, np.asarray(known.inflation))
    effects = effects_of(fitted)
    if effects:
        problem = problem_of(fitted, noise)
        density, of_model = _of_problem(problem, effects, fitted.free, {}, plans, 1.0)
    else:
        density, of_model = _plain(fitted, noise)
    words = priors_in_words(plans, fitted.free)
    return LogPosterior(fitted.free, density, clamp, start, covariance, (clamp, of_model), words)


def log_posterior_of(
    problem: Problem, fit: Fit, scale: float, names: Sequence[str], sizes: Sequence[float]
) -> LogPosterior:
    """Of the free entries of a fit of static tests: parameters, amounts of effects and of faults of the bench, with what the problem's
    readings are known to, its discrepancy included. scale: variance of the whitened residuals where that exceeds 1. names, sizes: of
    `fit.free`, as the draws are to call them, and their units in SI."""
    plans = {name: problem.plans[name] for name in fit.free if name in problem.plans}
    clamp, start, covariance = around_a_solution(problem, fit, scale)
    density, of_model = _of_problem(problem, fit.physics, fit.free, fit.values, plans, scale)
    data = (clamp, of_model)
    words = priors_in_words(plans, plans)
    return LogPosterior(tuple(names), density, clamp, start, covariance, data, words, np.asarray(sizes))


def priors_in_words(plans: Mapping[str, ParameterPlan], free: Iterable[str]) -> str:
    """The priors of the free entries that have a plan."""
    given = [name for name in free if name in plans and plans[name].prior is not None]
    return f"flat within the limits of each parameter{f', and those of [start] on {", ".join(given)}' if given else ''}"


def _log_density(clamp: Clamp, u: Array, squares: Array) -> Array:
    found = clamp.log_slope(u) - 0.5 * squares
    return jnp.where(jnp.isfinite(found), found, -jnp.inf)


def _plain(fitted: Fitted, noise: Noise) -> tuple[Density, Any]:
    """The density of a fit without effects, from the residuals that the fit itself minimises, and its data."""
    search = StaticSearch(fitted.record, fitted.tests, fitted.plans, fitted.free)
    args = search.args({key: replace(n, used=noise.std[key]) for key, n in fitted.noise.items()})
    filters = tuple(
        noise.whitening((c.test, c.name), fitted.tests[c.test], None, c.value.shape[0]) for c in args.data.channels
    )
    return _plain_density(fitted.free), (args, filters)


@functools.cache
def _plain_density(free: tuple[str, ...]) -> Density:
    """One object for all records, so that it compiles once for each shape."""
    residual_at = residual_of(free)

    def density(u: Array, data: Any) -> Array:
        clamp, (args, filters) = data
        residual = residual_at(clamp.physical(u), args)
        squares, first = jnp.zeros(()), 0
        for channel, filter_ in zip(args.data.channels, filters, strict=True):
            last = first + channel.value.shape[0]
            squares, first = squares + jnp.sum(whiten(filter_, residual[first:last]) ** 2), last
        return _log_density(clamp, u, squares + jnp.sum(residual[first:] ** 2))

    return density


class _Model(eqx.Module):
    """What the density of a problem depends on, beside the free entries.

    vector: of all entries of the program. moved {test: {field of its operating points: (faults, rows)}} and added (faults, rows): what a
    unit of each free fault does to what was read, and to the whitened residuals. members, shares (rows, k): of the decorrelation of
    gauges, None without one. left (rows, k), share (k,): of the discrepancy, None without one.
    """

    args: LibraryArgs
    vector: Float[Array | np.ndarray, " entries"]
    prior_value: Float[Array | np.ndarray, " n"]
    prior_weight: Float[Array | np.ndarray, " n"]
    scale: Float[Array | np.ndarray, ""]
    moved: Mapping[str, Mapping[str, Float[Array | np.ndarray, "faults _"]]]
    added: Float[Array | np.ndarray, "faults rows"] | None = None
    members: Int[Array | np.ndarray, "rows gauges"] | None = None
    shares: Float[Array | np.ndarray, "rows gauges"] | None = None
    left: Float[Array | np.ndarray, "rows k"] | None = None
    share: Float[Array | np.ndarray, " k"] | None = None


def _of_problem(
    problem: Problem,
    effects: tuple[str, ...],
    free: tuple[str, ...],
    values: Mapping[str, float],
    plans: Mapping[str, ParameterPlan],
    scale: float,
) -> tuple[Density, Any]:
    """The density of a problem's free entries, from the program of the library that holds its effects. values: of entries that are held;
    else where their plans begin."""
    (part,) = problem.readings
    assert isinstance(part, StaticReadings)
    program = part.program(effects)
    entries = part.order(program)
    begin = {name: plan.start for name, plan in problem.plans.items()} | dict(values)
    value, weight = np.zeros(len(free)), np.zeros(len(free))
    given = [i for i, name in enumerate(free) if name in plans]
    value[given], weight[given] = (np.asarray(found) for found in prior_rows([plans[free[i]] for i in given]))
    (signals,) = problem.signals
    held = {name: begin[name] for name in problem.plans if name not in free}
    faults = [problem.faults[name] for name in free if is_fault(name)]
    moved: dict[str, dict[str, np.ndarray]] = {}
    for i, fault in enumerate(faults):
        for test, fields in part.moved_by(fault).items():
            for field, rows in fields.items():
                moved.setdefault(test, {}).setdefault(field, np.zeros((len(faults), len(rows))))[i] = rows
    added = np.stack([problem.added_by(fault, part) for fault in faults]) if faults else None
    members, shares, left, share = None, None, None, None
    padded = sum(part.size(test.rows) * len(test.channels) for test in part.tests.values())
    priors = len(problem.parameters)  # nothing of it is in them
    real = problem.real_rows(padded + priors)[:-priors]
    if problem.decorrelation is not None:
        of, factor = problem.decorrelation.members
        members, shares = np.zeros((padded, of.shape[1]), dtype=int), np.zeros((padded, of.shape[1]))
        members[real], shares[real] = real[of], factor
    if problem.discrepancy is not None:
        directions, share = problem.discrepancy.parts
        left = np.zeros((padded, len(share)))
        left[real] = directions[:-priors]
    vector = np.array([begin.get(name, 0.0) for name in entries], dtype=float)
    args, variance = part.arguments(program), np.asarray(scale)
    model = _Model(args, vector, value, weight, variance, moved, added, members, shares, left, share)
    density = _density(program, entries, free) if not signals else _density_of(program, entries, free, signals, held)
    return density, model


@functools.cache
def _density(program: tuple[str, ...], entries: tuple[str, ...], free: tuple[str, ...]) -> Density:
    """One object for all records of a kind, so that it compiles once."""
    return _density_of(program, entries, free, [], {})


def _density_of(
    program: tuple[str, ...],
    entries: tuple[str, ...],
    free: tuple[str, ...],
    signals: Sequence[SignalRows],
    held: Mapping[str, float],
) -> Density:
    places = [(i, free.index(name)) for i, name in enumerate(entries) if name in free]
    of_faults = np.array([i for i, name in enumerate(free) if is_fault(name)], dtype=int)

    def density(u: Array, data: Any) -> Array:
        clamp, model = data
        p = clamp.physical(u)
        vector = jnp.asarray(model.vector)
        for i, own in places:
            vector = vector.at[i].set(p[own])
        residual = residual_alone(program, vector, _as_read_right(model, p[of_faults]))
        given = {**held, **{name: p[i] for i, name in enumerate(free)}}
        for signal in signals:
            read, behind = jnp.asarray(signal.readings), signal.behind
            rows = behind.factor(given) * (residual[signal.place] + read) - read
            for shift, mask in zip(behind.shifts(given), signal.masks, strict=True):
                rows = rows + shift * jnp.asarray(mask)
            residual = residual.at[signal.place].set(rows)
        if model.added is not None:
            residual = residual + p[of_faults] @ jnp.asarray(model.added)
        if model.members is not None and model.shares is not None:
            residual = jnp.sum(residual[jnp.asarray(model.members)] * jnp.asarray(model.shares), axis=1)
        if model.left is not None:
            left = jnp.asarray(model.left)
            residual = residual - left @ ((residual @ left) * model.share)
        prior = (p - model.prior_value) * model.prior_weight
        return _log_density(clamp, u, jnp.sum(residual**2) / model.scale + jnp.sum(prior**2))

    return density


def _as_read_right(model: _Model, amounts: Array) -> LibraryArgs:
    """The arguments with operating points as they would have been read without the faults."""
    conditions = dict(model.args.data.conditions)
    for test, fields in model.moved.items():
        own = conditions[test]
        right = {field: getattr(own, field) - amounts @ jnp.asarray(rows) for field, rows in fields.items()}
        conditions[test] = replace(own, **right)
    return replace(model.args, data=replace(model.args.data, conditions=conditions)) if model.moved else model.args


def _whitened(
    boxes: Sequence[Box], p: np.ndarray, jacobian: np.ndarray, inflation: np.ndarray
) -> tuple[Clamp, np.ndarray, np.ndarray]:
    """The change of variables, u of the optimum p (n,), and the covariance of u there: that of the fit, wide where it has none.

    jacobian (rows, n) of the residuals; inflation (n,): what variances are more than its."""
    lower, upper = (np.array([getattr(box, end) for box in boxes], dtype=float) for end in ("lower", "upper"))
    scale = np.array([box.scale for box in boxes])
    # An amount without a limit is an amount of any size; a hundred of its natural steps are more than any bench has.
    lower = np.where(np.isfinite(lower), lower, p - 100.0 * scale)
    upper = np.where(np.isfinite(upper), upper, p + 100.0 * scale)
    widest = WIDEST * (upper - lower)
    jacobian = jacobian * widest
    matrix = np.linalg.inv(jacobian.T @ jacobian + np.eye(len(widest))) * np.outer(widest, widest)
    more = np.sqrt(np.maximum(inflation, 1.0))
    matrix = matrix * np.outer(more, more)
    step = np.minimum(np.sqrt(np.diag(matrix)), widest)
    clamp = Clamp(lower, step, (upper - lower) / step)
    start = clamp.free(p)
    slope = np.maximum(clamp.slope(start), 0.3 * step)
    return clamp, start, matrix / np.outer(slope, slope)
