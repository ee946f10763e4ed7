"""How noisy a dynamic test's readings are before any fit: declared, from repeated runs, or from neighbours in time."""

import numpy as np

from ..channel_noise import FROM_RESIDUALS, ChannelNoise
from ..noise import MEDIAN_OF_CHI2, THIRD_DIFFERENCE
from ..record import Channel, DynamicTest
from ..rounding import local_steps


def first_noise_of(test: DynamicTest, channel: Channel) -> ChannelNoise:
    """The noise known before any fit; where nothing is known, a first guess from third differences along the rows."""
    floor = local_steps(channel.value) / np.sqrt(12.0)
    if channel.std is not None:
        std = np.maximum(channel.std, floor)
        return ChannelNoise(std, channel.std_source, True, channel.std_source.startswith("declared"), std)
    repeated = run_differences(test, channel)
    rows = sum(len(d) for d in repeated)
    if rows >= 60:
        size = float(np.sqrt(sum(float(d @ d) for d in repeated) / rows))
        std = np.maximum(np.full(test.rows, size), floor)
        return ChannelNoise(std, f"differences between repeated runs ({rows} pairs of rows)", True, False, std)
    found = [
        np.convolve(channel.value[test.run == code], THIRD_DIFFERENCE, "valid") / np.sqrt(20.0)
        for code in np.unique(test.run)
        if np.sum(test.run == code) >= 4
    ]
    guess = float(np.sqrt(np.median(np.concatenate(found) ** 2) / MEDIAN_OF_CHI2)) if found else 0.0
    smallest = 1e-4 * max(float(np.ptp(channel.value)), float(np.max(np.abs(channel.value))), 1e-300)
    std = np.maximum(np.full(test.rows, max(guess, smallest)), floor)
    return ChannelNoise(std, FROM_RESIDUALS, False, False, std)


def run_differences(test: DynamicTest, channel: Channel) -> list[np.ndarray]:
    """Differences between runs with the same rows, command and conditions, scaled to the noise of one row (SI)."""
    if test.time is None:
        return []
    columns = [test.command, test.supply_pressure, test.return_pressure, test.temperature]
    columns += [] if test.external_force is None else [test.external_force]
    rows = [np.flatnonzero(test.run == code) for code in np.unique(test.run)]
    found, used = [], set()
    for i, a in enumerate(rows):
        for j in range(i + 1, len(rows)):
            b = rows[j]
            if j in used or i in used or len(a) != len(b):
                continue
            same = np.allclose(test.time[a] - test.time[a[0]], test.time[b] - test.time[b[0]], rtol=0.0, atol=1e-6)
            if same and all(np.allclose(c[a], c[b], rtol=1e-3, atol=1e-9) for c in columns):
                found.append((channel.value[a] - channel.value[b]) / np.sqrt(2.0))
                used |= {i, j}
    return found
