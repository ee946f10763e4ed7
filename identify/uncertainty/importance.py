"""Draws of a posterior that is no traced function: proposals weighed by importance.

A no-U-turn sampler takes ten thousands of gradients in turn; a run in time is integrated piece by piece, in a tenth of a second. Beside a
fit the posterior is near its Gaussian: proposals from Student's t around it, moved to what their weights show (Cappé et al.,
"Adaptive importance sampling in general mixture classes", Statistics and Computing 18, 2008), need some six hundred evaluations.
Vehtari et al., "Pareto smoothed importance sampling", J. Machine Learning Research 25, 2024: the largest weights are smoothed, and the
shape k of their tail says whether the proposals cover the posterior. Where they do not, nothing is reported.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import multivariate_t

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.side_by_side import each

from .sampler import NOT_INSTALLED
from .untraced_posterior import UntracedPosterior


FREEDOM = 6  # of Student's t: tails wider than those of the posterior, a fifth of the proposals lost by them
MOST_PILOTS = 5  # rounds that move the proposals
NEAR = 0.6  # of a round's proposals, worth from which on they need no more of them
PIECE = 100  # proposals between two words of progress
WORST_SHAPE = 0.7  # of the weights' tail, from which on no number of proposals is enough
# Times the mean, up to which the largest weight is no tail: of proposals that are nearly the posterior all weights lie in a hair's breadth,
# and a shape that is fitted to the largest of them means nothing (it was 4 where 2,400 were worth 2,330).
EVEN = 4.0
WIDER = 1.1  # than the weights show: what lies outside of the proposals is not seen


@dataclass(frozen=True)
class Weighed:
    """draws (draws, n) of u and their weights (draws,), which sum to 1; shape: of the weights' tail, nan where they have none."""

    draws: np.ndarray
    weights: np.ndarray
    shape: float

    @property
    def effective(self) -> float:
        """As many equally weighted draws know a mean as well."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def worth(self) -> float:
        """As many know the means and the tails as well."""
        return min([self.effective, *(effective_in_tails(own, self.weights) for own in self.draws.T)])

    @property
    def covered(self) -> bool:
        """Whether so many draws are an answer by the shape of their weights' tail (Vehtari et al., 2024, equation 13)."""
        return not self.shape > min(1.0 - 1.0 / np.log10(len(self.weights)), WORST_SHAPE)

    def equal(self, count: int, seed: int) -> np.ndarray:
        """(count, n) draws of equal weight: strata of the weights (Kitagawa, J. Computational and Graphical Statistics 5, 1996)."""
        strata = (np.arange(count) + np.random.default_rng(seed).random(count)) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(self.weights), strata), len(self.weights) - 1)
        return self.draws[chosen]


def smoothing_or_sentence() -> Any:
    """ArviZ's statistics; one sentence where they are not installed."""
    try:
        from arviz_stats.base.array import array_stats
    except ImportError:
        raise BenchInputError(NOT_INSTALLED) from None
    return array_stats


def smoothed(log_ratios: np.ndarray) -> tuple[np.ndarray, float]:
    """(weights (draws,) that sum to 1, their largest smoothed; shape of their tail)."""
    # Made for the logarithms of likelihoods that are to be left out, it takes the weights' the other way round.
    log_weights, shape = smoothing_or_sentence().psislw(-log_ratios)
    weights = np.exp(np.asarray(log_weights) - np.max(log_weights))
    return weights / weights.sum(), float(np.asarray(shape))


def propose(
    target: UntracedPosterior,
    *,
    pilot: int,
    most: int,
    effective: float,
    seed: int,
    say: Callable[[str], None] = lambda _: None,
) -> Weighed:
    """Proposals until they are worth `effective` draws, `most` of them at most. pilot: proposals of each round that moves them."""
    random = np.random.default_rng(seed)
    middle, spread = target.start, target.covariance
    for k in range(MOST_PILOTS):
        found = weighed(*_round(target, middle, spread, pilot, random))
        say(f"{pilot} proposals of round {k + 1}, worth {found.effective:.0f} draws")
        middle, spread = _moved(found, spread)
        if found.effective > NEAR * pilot:
            break
    draws, ratios = _round(target, middle, spread, PIECE, random)
    while True:
        found = weighed(draws, ratios)
        say(f"{len(draws)} proposals, worth {found.worth:.0f} draws of {effective:.0f}")
        # The shape of a tail that reaches nowhere is not known from few: more show it.
        if len(draws) >= most or (found.worth >= effective and found.covered):
            return found
        more = _round(target, middle, spread, PIECE, random)
        draws, ratios = np.concatenate([draws, more[0]]), np.concatenate([ratios, more[1]])


def weighed(draws: np.ndarray, log_ratios: np.ndarray) -> Weighed:
    """log_ratios (draws,): of density over proposal, to a constant; -inf where the density is 0."""
    if not np.isfinite(log_ratios).any():
        return Weighed(draws, np.full(len(draws), 1.0 / len(draws)), np.inf)
    lowest = np.min(log_ratios[np.isfinite(log_ratios)]) - 700.0
    log_ratios = np.where(np.isfinite(log_ratios), log_ratios, lowest)
    weights = np.exp(log_ratios - np.max(log_ratios))
    if np.max(weights) <= EVEN * np.mean(weights):
        return Weighed(draws, weights / weights.sum(), np.nan)
    return Weighed(draws, *smoothed(log_ratios))


def _round(
    target: UntracedPosterior, middle: np.ndarray, spread: np.ndarray, count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """(draws (count, n), log ratios (count,)) of a round."""
    # Student's t has a wider covariance than its matrix.
    proposal = multivariate_t(loc=middle, shape=spread * (FREEDOM - 2) / FREEDOM, df=FREEDOM)  # pyright: ignore[reportArgumentType]
    draws = np.reshape(proposal.rvs(count, random_state=random), (count, len(middle)))
    found = np.array(each(target.log_density, list(draws)))
    found[np.isnan(found)] = -np.inf
    return draws, found - np.reshape(proposal.logpdf(draws), count)


def _moved(found: Weighed, before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance that the weights show, drawn to the last ones where few draws count."""
    middle = found.weights @ found.draws
    away = found.draws - middle
    shown = away.T @ (found.weights[:, None] * away)
    count, few = found.effective, 3.0 * len(middle)
    return middle, WIDER * (count * shown + few * before) / (count + few)


def quantiles(values: np.ndarray, weights: np.ndarray, levels: tuple[float, ...]) -> list[float]:
    """Of weighted values (draws,)."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) - 0.5 * weights[order]
    return [float(np.interp(level, share, values[order])) for level in levels]


def effective_in_tails(values: np.ndarray, weights: np.ndarray, level: float = 0.05) -> float:
    """As many equally weighted draws know the less known of two tail quantiles as well."""
    low, high = quantiles(values, weights, (level, 1.0 - level))
    worth = []
    for inside, share in ((values <= low, level), (values <= high, 1.0 - level)):
        variance = float(np.sum(weights**2 * (inside - share) ** 2))
        worth.append(share * (1.0 - share) / variance if variance > 0.0 else 0.0)
    return min(worth)
