"""Draws of a fit's posterior, judged before they are reported: chains that disagree or trajectories that diverge are no answer.

Vehtari et al., "Rank-normalization, folding, and localization: an improved R-hat for assessing convergence of MCMC", Bayesian Analysis
16, 2021: R-hat below 1.01 and 400 effective draws, in the middle and in the tails.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from thermohyd.identify.fitting.outcome import Fitted, Uncertainty
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.optional_parts import install

from .finished_fit import effects_of
from .importance import Weighed, effective_in_tails, propose, quantiles, smoothing_or_sentence
from .log_posterior import LogPosterior, log_posterior, log_posterior_of
from .result import LEVELS, Nested, Posterior, PosteriorOf
from .sampler import Drawn, draw, sampler_or_sentence
from .untraced_posterior import UntracedPosterior, is_traced, untraced_posterior, untraced_posterior_of


TARGETS = (0.85, 0.95, 0.99)  # acceptance: the next where trajectories diverged
R_HAT, ESS = 1.01, 400.0


@dataclass(frozen=True)
class Sampling:
    """How much is drawn: each of `chains` throws `warmup` draws away and keeps `draws`; where these are too few, twice as many."""

    chains: int = 4
    warmup: int = 200
    draws: int = 300
    seed: int = 20110913
    targets: tuple[float, ...] = TARGETS


def posterior_of(
    fitted: Fitted, known: Uncertainty, sampling: Sampling | None = None, say: Callable[[str], None] = lambda _: None
) -> Posterior:
    """The posterior of a fit's free parameters. Raises BenchInputError where its packages are not installed."""
    sampling = sampling or Sampling()
    if is_traced(fitted.tests, effects_of(fitted)):
        sampler_or_sentence()
        return sampled(log_posterior(fitted, known), sampling, say)
    return weighed(untraced_posterior(fitted, known), sampling, say)


def posterior_of_a_problem(
    problem: Problem,
    fit: Fit,
    scale: float,
    names: Sequence[str],
    sizes: Sequence[float],
    sampling: Sampling,
    say: Callable[[str], None] = lambda _: None,
) -> Posterior:
    """The posterior of the free entries of a problem's fit; see `log_posterior_of`."""
    if is_traced(problem.tests, fit.effects):
        return sampled(log_posterior_of(problem, fit, scale, names, sizes), sampling, say)
    return weighed(untraced_posterior_of(problem, fit, scale, names, sizes), sampling, say)


def weighed(target: UntracedPosterior, sampling: Sampling, say: Callable[[str], None] = lambda _: None) -> Posterior:
    """Proposals until they are worth 400 draws in the middle and in the tails, `chains` times `draws` at most, or twice as many; else a
    posterior with `trouble` and no figures. `warmup` of each round that moves the proposals are thrown away."""
    smoothing_or_sentence()
    most = 2 * sampling.chains * sampling.draws
    found = propose(
        target, pilot=sampling.warmup, most=most, effective=ESS, seed=sampling.seed, say=lambda words: say(f"posterior: {words}")
    )  # fmt: skip
    equal = _physical(target, found.equal(sampling.chains * sampling.draws, sampling.seed))
    parameters: dict[str, PosteriorOf] = {}
    trouble = ""
    if not found.covered:
        trouble = (
            f"the proposals do not cover this posterior (Pareto's k of their weights is {found.shape:.2f}): it is far from "
            "a Gaussian, so no interval of it is reported; use the profiles"
        )
    elif found.worth < ESS:
        trouble = (
            f"{len(found.weights)} proposals are worth {found.worth:.0f} draws, {ESS:.0f} are asked for: no interval is reported; use the "
            "profiles"
        )
    else:
        parameters = _parameters_weighed(target, found)
    none = np.zeros((1, len(equal)))
    posterior = Posterior(
        target.names, equal[None], none.astype(bool), none, sampling.warmup, sampling.seed, np.nan, (), parameters,
        target.prior, trouble, proposals=len(found.weights), pareto_k=found.shape,
    )  # fmt: skip
    if trouble:
        return posterior
    attributes = {"inference_library": "thermohyd", "method": "importance", "pareto_k": found.shape}
    file, notes = _as_file(target.names, equal[None], {}, attributes, sampling)
    return replace(posterior, file=file, notes=notes)


def _parameters_weighed(target: UntracedPosterior, found: Weighed) -> dict[str, PosteriorOf]:
    physical, weights = _physical(target, found.draws), found.weights
    rows = {}
    for own, name in zip(physical.T, target.names, strict=True):
        mean = float(weights @ own)
        intervals = []
        for level in LEVELS:
            low, high = quantiles(own, weights, (0.5 - 0.5 * level, 0.5 + 0.5 * level))
            intervals.append(Nested(level, low, high))
        std = float(np.sqrt(weights @ (own - mean) ** 2))
        tails = effective_in_tails(own, weights)
        rows[name] = PosteriorOf(name, mean, std, tuple(intervals), np.nan, found.effective, tails)
    return rows


def sampled(target: LogPosterior, sampling: Sampling, say: Callable[[str], None] = lambda _: None) -> Posterior:
    """Draws until none diverges, the chains agree and they are enough; else a posterior with `trouble` and no figures."""
    tried: list[float] = []
    draws, trouble, found = sampling.draws, "", None
    rungs = list(sampling.targets)
    longer = False
    while rungs:
        acceptance = rungs[0]
        tried.append(acceptance)
        say(f"posterior: {sampling.chains} chains, acceptance {acceptance:g}")
        found = draw(
            target.density, target.data, target.start, target.covariance, chains=sampling.chains, warmup=sampling.warmup,
            draws=draws, target=acceptance, seed=sampling.seed + len(tried) - 1, say=lambda words: say(f"posterior: {words}"),
        )  # fmt: skip
        lost = int(found.divergent.sum())
        if lost:
            trouble = (
                f"{lost} of {found.divergent.size} trajectories diverged with acceptance {acceptance:g}: the sampler does not follow "
                "this posterior, so no interval of it is reported; use the profiles"
            )
            rungs.pop(0)
            continue
        parameters = _parameters(target, found)
        trouble = _disagreement(parameters)
        if not trouble or longer:
            break
        longer, draws = True, 2 * draws
    assert found is not None
    physical = _physical(target, found.draws)
    parameters = {} if trouble else _parameters(target, found)
    file, notes = (b"", ()) if trouble else _file_of_chains(target, physical, found, sampling, tried[-1])
    return Posterior(
        target.names, physical, found.divergent, found.energy, sampling.warmup, sampling.seed, tried[-1], tuple(tried),
        parameters, target.prior, trouble, file, notes,
    )  # fmt: skip


def _physical(target: LogPosterior | UntracedPosterior, draws: np.ndarray) -> np.ndarray:
    import jax

    flat = jax.numpy.asarray(draws.reshape(-1, draws.shape[-1]))
    physical = np.asarray(jax.vmap(target.clamp.physical)(flat)).reshape(draws.shape)
    return physical if target.sizes is None else physical * target.sizes


def _parameters(target: LogPosterior, found: Drawn) -> dict[str, PosteriorOf]:
    from arviz_stats.base.array import array_stats

    physical = _physical(target, found.draws)
    rows = {}
    for i, name in enumerate(target.names):
        own = physical[:, :, i]
        intervals = []
        for level in LEVELS:
            low, high = np.quantile(own, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
            intervals.append(Nested(level, float(low), float(high)))
        figure = lambda values: float(np.asarray(values))
        rows[name] = PosteriorOf(
            name, float(own.mean()), float(own.std(ddof=1)), tuple(intervals),
            figure(array_stats.rhat(own, chain_axis=0, draw_axis=1)),
            figure(array_stats.ess(own, chain_axis=0, draw_axis=1, method="bulk")),
            figure(array_stats.ess(own, chain_axis=0, draw_axis=1, method="tail", prob=(0.05, 0.95))),
        )  # fmt: skip
    return rows


def _disagreement(parameters: dict[str, PosteriorOf]) -> str:
    """Why draws that did not diverge are no answer all the same; empty where they are one."""
    worst = max(parameters.values(), key=lambda p: p.r_hat if np.isfinite(p.r_hat) else np.inf)
    if not worst.r_hat <= R_HAT:
        return (
            f"the chains do not agree on {worst.name} (R-hat {worst.r_hat:.3f}, beyond {R_HAT:g}): the posterior has parts between which "
            "they do not cross, so no interval of it is reported; use the profiles"
        )
    fewest = min(parameters.values(), key=lambda p: min(p.ess_bulk, p.ess_tail))
    least = min(fewest.ess_bulk, fewest.ess_tail)
    if not least >= ESS:
        return f"only {least:.0f} effective draws of {fewest.name}, {ESS:.0f} are asked for: no interval is reported; use the profiles"
    return ""


def _file_of_chains(
    target: LogPosterior, physical: np.ndarray, found: Drawn, sampling: Sampling, acceptance: float
) -> tuple[bytes, tuple[str, ...]]:
    stats = {
        "diverging": found.divergent,
        "energy": found.energy,
        "acceptance_rate": found.acceptance,
        "tree_depth": found.doublings,
    }
    attributes = {"inference_library": "blackjax", "warmup": sampling.warmup, "target_acceptance": acceptance}
    return _as_file(target.names, physical, stats, attributes, sampling)


def _as_file(
    names: tuple[str, ...],
    physical: np.ndarray,
    stats: dict[str, np.ndarray],
    attributes: dict[str, Any],
    sampling: Sampling,
) -> tuple[bytes, tuple[str, ...]]:
    """Draws (chains, draws, n) as ArviZ keeps them: a DataTree with the groups `posterior` and `sample_stats`, as NetCDF."""
    try:
        import arviz_base
        import h5netcdf  # noqa: F401  # xarray writes by it
    except ImportError:
        return b"", (f"posterior.nc was not written: {install('posterior')}",)
    # A name with a stroke would be a group of the file.
    draws = {name.replace("/", " per "): physical[:, :, i] for i, name in enumerate(names)}
    groups = {"posterior": draws, **({"sample_stats": stats} if stats else {})}
    tree = arviz_base.from_dict(groups)
    tree.attrs.update(**attributes, units="SI", seed=sampling.seed)
    # ArviZ stamps the time, and a file of one run must equal that of the next.
    for group in groups:
        tree[group].attrs.pop("created_at", None)
    tree.attrs.pop("created_at", None)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "posterior.nc"
        tree.to_netcdf(path, engine="h5netcdf")
        return path.read_bytes(), ()
