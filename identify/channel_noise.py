"""Which noise a fit believes for each channel: declared, measured on the log or on repeats, or taken from its residuals."""

from dataclasses import dataclass, replace

import numpy as np

from .noise import noise_from_neighbours, noise_from_repeats
from .record import Channel, TestRecord
from .rounding import local_steps


@dataclass(frozen=True)
class ChannelNoise:
    """Standard deviations of a channel's readings, one per row (SI), and where they come from, in words.

    known: stated by the user or measured free of the model, so that a chi-square means something.
    declared: stated by the user, and therefore not to be touched.
    """

    std: np.ndarray
    source: str
    known: bool
    declared: bool
    # What the fit weighs with: `std`, widened where the model misses the curve by more than its noise.
    used: np.ndarray
    freedom: float = np.inf  # degrees of freedom from which `std` was estimated
    neighbours: float | None = None  # scatter of neighbouring rows about a smooth curve, where that says something


FROM_RESIDUALS = "taken from the fit's residuals"


def initial_noise(test: TestRecord, channel: Channel) -> ChannelNoise:
    """The noise known before any fit; where nothing is known, a first guess from neighbouring rows."""
    # Positions are left out of it: in a table of a few hundred rows an even grid is a choice, not a rounding.
    floor = local_steps(channel.value) / np.sqrt(12.0)
    if channel.std is not None:
        std = np.maximum(channel.std, floor)
        declared = channel.std_source.startswith("declared")
        return ChannelNoise(std, channel.std_source, True, declared, std, channel.freedom)
    repeated = noise_from_repeats(test, channel)
    if repeated is not None:
        std = np.maximum(np.full(test.rows, repeated.std), floor)
        return ChannelNoise(std, repeated.source, True, False, std, repeated.freedom)
    found = noise_from_neighbours(test, channel)
    guess = found.std
    smallest = 1e-4 * max(float(np.ptp(channel.value)), float(np.max(np.abs(channel.value))), 1e-300)
    std = np.maximum(np.full(test.rows, max(guess, smallest)), floor)
    return ChannelNoise(std, FROM_RESIDUALS, False, False, std, neighbours=guess if found.valid else None)


def reweighted(noise: ChannelNoise, misfit: np.ndarray, freedom: float) -> ChannelNoise:
    """The noise after a fit whose residuals (SI) are `misfit`, of which a share `freedom` (0..1] is left to chance.

    Unknown noise becomes the residuals' own. Known noise stays what it is, but where the model misses the curve the
    weights allow for that miss as one more, equal, error of every point: else a channel with very small noise would
    drag the whole valve into its misfit. Declared noise is obeyed as it stands.
    """
    if noise.declared:
        return noise
    mean_square = float(np.mean(misfit**2)) / freedom
    if not noise.known:
        std = np.full_like(noise.std, np.sqrt(mean_square))
        return replace(noise, std=std, used=std)
    extra = mean_square - float(np.mean(noise.std**2))
    if extra <= float(np.mean(noise.std**2)):  # less than twice the noise's variance: chance, or nothing to speak of
        return replace(noise, used=noise.std)
    return replace(noise, used=np.sqrt(noise.std**2 + extra))
