"""Draws of a posterior by the no-U-turn sampler (Hoffman and Gelman, J. Machine Learning Research 15, 2014), a few dozen at a time.

BlackJAX's kernel, which is a pure function of a log density as it stands: so the chains advance in short pieces, between which
progress is said, and a metric that was learned on the way changes nothing that is compiled. All chains go side by side.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.optional_parts import install
from thermohyd.numerics import OPTIONS, jitted, known_options


PIECE = 25  # draws of every chain between two words of progress
MOST_DOUBLINGS = 8
FIRST_STEP = 0.5  # of the whitened variables
SHRINK = 5.0  # draws that the first metric is worth beside the learned one


@dataclass(frozen=True)
class Drawn:
    """draws (chains, draws, n) of u, divergent, energy, acceptance and doublings (chains, draws)."""

    draws: np.ndarray
    divergent: np.ndarray
    energy: np.ndarray
    acceptance: np.ndarray
    doublings: np.ndarray


NOT_INSTALLED = f"--posterior needs the packages blackjax and arviz: {install('posterior')}"


def sampler_or_sentence() -> Any:
    """BlackJAX; one sentence where it is not installed."""
    try:
        import blackjax
    except ImportError:
        raise BenchInputError(NOT_INSTALLED) from None
    return blackjax


@functools.cache
def _piece(density: Callable[[Any, Any], Any], draws: int, apart: bool) -> Callable[..., Any]:
    """Compiled: every chain `draws` further. Adapts each chain's step size where `learn` is 1. apart: each chain has a metric and
    data of its own."""
    blackjax = sampler_or_sentence()
    from blackjax.adaptation.step_size import dual_averaging_adaptation

    kernel = blackjax.nuts.build_kernel()

    def one_chain(key: Any, state: Any, tuning: Any, metric: Any, target: Any, learn: Any, data: Any) -> Any:
        _, update, _ = dual_averaging_adaptation(target)

        def step(carry: Any, key: Any) -> Any:
            state, tuning = carry
            log_step = jnp.where(learn > 0.0, tuning.log_step_size, tuning.log_step_size_avg)
            state, info = kernel(key, state, lambda u: density(u, data), jnp.exp(log_step), metric, MOST_DOUBLINGS)
            moved = update(tuning, info.acceptance_rate)
            tuning = jax.tree.map(lambda new, old: jnp.where(learn > 0.0, new, old), moved, tuning)
            doublings = info.num_trajectory_expansions
            return (state, tuning), (state.position, info.is_divergent, info.energy, info.acceptance_rate, doublings)

        (state, tuning), out = jax.lax.scan(step, (state, tuning), jax.random.split(key, draws))
        return state, tuning, out

    own = 0 if apart else None
    return jitted(jax.vmap(one_chain, in_axes=(0, 0, 0, own, None, None, own)), known_options(OPTIONS))


@functools.cache
def _begin(density: Callable[[Any, Any], Any], apart: bool) -> Callable[..., Any]:
    blackjax = sampler_or_sentence()
    from blackjax.adaptation.step_size import dual_averaging_adaptation

    start = lambda u, data: blackjax.nuts.init(u, lambda x: density(x, data))
    tune = lambda chains: jax.vmap(dual_averaging_adaptation(0.8)[0])(jnp.full(chains, FIRST_STEP))
    begun = jitted(jax.vmap(start, in_axes=(0, 0 if apart else None)), known_options(OPTIONS))
    # What comes out of a piece is strongly typed, and so must be what goes into the first, or the second is compiled anew.
    typed = lambda part: jnp.asarray(np.asarray(part))
    return lambda u, data: jax.tree.map(typed, (begun(u, data), tune(len(u))))


def draw(
    density: Callable[[Any, Any], Any],
    data: Any,
    start: np.ndarray,
    covariance: np.ndarray,
    *,
    chains: int,
    warmup: int,
    draws: int,
    target: float,
    seed: int,
    say: Callable[[str], None] = lambda _: None,
) -> Drawn:
    """Draws of u whose log density is `density(u, data)`, from about `start` (n,), where its covariance is about `covariance` (n, n).

    warmup: thrown away; the first half tunes the step size, the second too with the metric that the first half showed. Numbers of
    draws are rounded up to pieces of `PIECE`. target: the acceptance that the step size is tuned to.
    """
    # The chain of a sampler mixes integers and floats; the model itself keeps to strict promotion.
    with jax.numpy_dtype_promotion("standard"):
        pieces = lambda count: -(-count // PIECE)
        key = jax.random.key(seed)
        key, first = jax.random.split(key)
        root = np.linalg.cholesky(covariance)
        spread = np.asarray(jax.random.normal(first, (chains, len(start)))) @ root.T
        state, tuning = _begin(density, False)(jnp.asarray(start + spread), data)
        advance = _piece(density, PIECE, False)
        metric, kept = jnp.asarray(covariance), []
        halves = [pieces(warmup // 2), pieces(warmup - warmup // 2)]
        whole, done = sum(halves) + pieces(draws), 0

        def piece(learn: float) -> tuple[Any, ...]:
            nonlocal key, state, tuning, done
            key, own = jax.random.split(key)
            keys = jax.random.split(own, chains)
            state, tuning, out = advance(keys, state, tuning, metric, jnp.asarray(target), jnp.asarray(learn), data)
            done += 1
            found = tuple(np.asarray(part) for part in out)
            lost = int(found[1].sum()) if learn == 0.0 else 0
            say(f"draws {100.0 * done / whole:.0f} %{f', {lost} divergent' if lost else ''}")
            return found

        learned: list[np.ndarray] = []
        for k in range(halves[0]):
            out = piece(1.0)
            if k >= halves[0] // 2:
                learned.append(out[0])
        if learned:
            metric = jnp.asarray(_metric(np.concatenate(learned, axis=1), covariance))
        for _ in range(halves[1]):
            piece(1.0)
        kept = [piece(0.0) for _ in range(pieces(draws))]
    together = [np.concatenate([part[i] for part in kept], axis=1) for i in range(5)]
    return Drawn(*together)


def _metric(draws: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The covariance of draws (chains, draws, n), drawn to the first idea where they are few."""
    flat = draws.reshape(-1, draws.shape[-1])
    count = len(flat) / 5.0  # neighbours are alike
    found = np.atleast_2d(np.cov(flat.T))
    return (count * found + SHRINK * covariance) / (count + SHRINK)


def draw_each(
    density: Callable[[Any, Any], Any],
    data: Sequence[Any],
    starts: np.ndarray,
    covariances: np.ndarray,
    *,
    warmup: int,
    draws: int,
    target: float,
    seed: int,
) -> Drawn:
    """One chain for each of several problems of one density, side by side: for a calibration. Their data (records,), starts
    (records, n) and covariances (records, n, n), which stay the chains' metrics; `chains` of the result are the records."""
    with jax.numpy_dtype_promotion("standard"):
        together = jax.tree.map(lambda *parts: jnp.stack([jnp.asarray(part) for part in parts]), *data)
        key = jax.random.key(seed)
        key, first = jax.random.split(key)
        roots = np.linalg.cholesky(covariances)
        spread = np.einsum("rij,rj->ri", roots, np.asarray(jax.random.normal(first, starts.shape)))
        state, tuning = _begin(density, True)(jnp.asarray(starts + spread), together)
        advance, kept = _piece(density, PIECE, True), []
        pieces = -(-warmup // PIECE)
        for k in range(pieces - (-draws // PIECE)):
            key, own = jax.random.split(key)
            learn = jnp.asarray(1.0 if k < pieces else 0.0)
            keys = jax.random.split(own, len(starts))
            state, tuning, out = advance(
                keys, state, tuning, jnp.asarray(covariances), jnp.asarray(target), learn, together
            )
            if k >= pieces:
                kept.append(tuple(np.asarray(part) for part in out))
    return Drawn(*[np.concatenate([part[i] for part in kept], axis=1) for i in range(5)])
