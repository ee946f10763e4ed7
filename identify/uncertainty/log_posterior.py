"""The logarithm of the posterior of a fit of static tests, as one traced function of unbounded variables.

The likelihood is the fit's, with its noise as estimated: also with its memory, which the fit itself counts only in its error bars.
Priors are those of `[start]`, and flat within every parameter's limits.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fitting.fit import StaticSearch
from thermohyd.identify.fitting.library_rows import residual_alone
from thermohyd.identify.fitting.outcome import Fitted, Uncertainty
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

    names: of the parameters, in order. clamp: from u to SI. data: everything else that the density depends on.
    """

    names: tuple[str, ...]
    density: Density
    clamp: Clamp
    start: np.ndarray
    covariance: np.ndarray
    data: Any
    prior: str


def log_posterior(fitted: Fitted, known: Uncertainty) -> LogPosterior:
    """Of a fit's free parameters, amounts of effects and of sensors included.

    Raises BenchInputError where dynamic tests take part: their runs are no one traced function.
    """
    if any(test.in_motion for test in fitted.tests.values()):
        raise BenchInputError(
            "--posterior is for records of static tests: runs in time are integrated piece by piece, which a sampler cannot follow; "
            "--profile works for them",
            file=fitted.record.folder,
        )
    blocks = known.blocks
    noise = Noise(
        {key: fitted.noise[key].used * np.sqrt(block.variance) for key, block in blocks.items()},
        {key: block.correlation for key, block in blocks.items()},
    )
    plans = [fitted.plans[name] for name in fitted.free]
    clamp, start, covariance = _whitened(fitted, known)
    density, of_model = _plain(fitted, noise) if not effects_of(fitted) else _with_effects(fitted, noise)
    given = [name for name, plan in zip(fitted.free, plans, strict=True) if plan.prior is not None]
    words = (
        f"flat within the limits of each parameter{f', and those of [start] on {", ".join(given)}' if given else ''}"
    )
    return LogPosterior(fitted.free, density, clamp, start, covariance, (clamp, of_model), words)


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


def _with_effects(fitted: Fitted, noise: Noise) -> tuple[Density, Any]:
    """The same with effects freed, from the program of the library that holds them."""
    problem, effects = problem_of(fitted, noise), effects_of(fitted)
    (part,) = problem.readings
    assert isinstance(part, StaticReadings)
    program = part.program(effects)
    entries, free = part.order(program), fitted.free
    vector = np.array([fitted.plans[n].start if n in fitted.plans else 0.0 for n in entries], dtype=float)
    value, weight = prior_rows([fitted.plans[name] for name in free])
    (signals,) = problem.signals
    held = {name: plan.start for name, plan in fitted.plans.items() if name not in free}
    density = _density(program, entries, free) if not signals else _density_of(program, entries, free, signals, held)
    return density, (part.arguments(program), jnp.asarray(vector), value, weight)


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

    def density(u: Array, data: Any) -> Array:
        clamp, (args, vector, prior_value, prior_weight) = data
        p = clamp.physical(u)
        for i, own in places:
            vector = vector.at[i].set(p[own])
        residual = residual_alone(program, vector, args)
        given = {**held, **{name: p[i] for i, name in enumerate(free)}}
        for signal in signals:
            read, behind = jnp.asarray(signal.readings), signal.behind
            rows = behind.factor(given) * (residual[signal.place] + read) - read
            for shift, mask in zip(behind.shifts(given), signal.masks, strict=True):
                rows = rows + shift * jnp.asarray(mask)
            residual = residual.at[signal.place].set(rows)
        prior = (p - prior_value) * prior_weight
        return _log_density(clamp, u, jnp.sum(residual**2) + jnp.sum(prior**2))

    return density


def _whitened(fitted: Fitted, known: Uncertainty) -> tuple[Clamp, np.ndarray, np.ndarray]:
    """The change of variables, u of the optimum, and the covariance of u there: that of the fit, wide where it has none."""
    plans = [fitted.plans[name] for name in fitted.free]
    lower, upper = (np.array([getattr(plan, end) for plan in plans], dtype=float) for end in ("lower", "upper"))
    scale = np.array([plan.info.scale for plan in plans])
    # An amount without a limit is an amount of any size; a hundred of its natural steps are more than any bench has.
    lower = np.where(np.isfinite(lower), lower, fitted.solution.p - 100.0 * scale)
    upper = np.where(np.isfinite(upper), upper, fitted.solution.p + 100.0 * scale)
    widest = WIDEST * (upper - lower)
    jacobian = fitted.solution.jacobian * widest
    matrix = np.linalg.inv(jacobian.T @ jacobian + np.eye(len(widest))) * np.outer(widest, widest)
    more = np.sqrt(np.maximum(known.inflation, 1.0))
    matrix = matrix * np.outer(more, more)
    step = np.minimum(np.sqrt(np.diag(matrix)), widest)
    clamp = Clamp(lower, step, (upper - lower) / step)
    start = clamp.free(fitted.solution.p)
    slope = np.maximum(clamp.slope(start), 0.3 * step)
    return clamp, start, matrix / np.outer(slope, slope)
