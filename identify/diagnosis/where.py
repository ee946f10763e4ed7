"""Where a fitted model misses the bench: boxes of conditions that hold the most misfit beyond noise.

A scan over boxes for the one whose residual variance most exceeds the rest's (Kulldorff's scan statistic for a variance:
Communications in Statistics 26, 1997); found, set aside, and again.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from ..fit_result import ChannelFit
from ..record import DynamicTest, TestRecord
from .result import Region


STRETCHES = 12
MOST_REGIONS = 6
LEAST_ROWS = 6
# Smallest gain of the scan worth a line: far beyond what the many boxes reach by chance.
WORTH_TELLING = 12.0
SMALLEST_SHARE = 0.02


def regions(fits: tuple[ChannelFit, ...], tests: dict[str, TestRecord]) -> tuple[Region, ...]:
    """The worst boxes over all channels, by their share of the record's excess chi-square."""
    total = sum(max(float(np.sum(_squares(fit))) - len(fit.measured), 0.0) for fit in fits)
    found = [region for fit in fits for region in _of_channel(fit, tests[fit.test], max(total, 1e-300))]
    found = [region for region in found if region.share >= SMALLEST_SHARE]
    return tuple(sorted(found, key=lambda region: -region.share)[:MOST_REGIONS])


def _squares(fit: ChannelFit) -> np.ndarray:
    return ((fit.measured - fit.predicted) / fit.std) ** 2


def _of_channel(fit: ChannelFit, test: TestRecord, total: float) -> Iterator[Region]:
    squares = _squares(fit)
    axes = _axes(test)
    left = np.ones(len(squares), dtype=bool)
    for _ in range(3):
        best = _best_box(squares, axes, left)
        if best is None:
            return
        inside, limits = best
        excess = float(np.sum(squares[inside])) - float(inside.sum())
        misfit = (fit.measured - fit.predicted)[inside]
        rms = float(np.sqrt(max(np.mean(misfit**2 - fit.std[inside] ** 2), 0.0)))
        yield Region(
            fit.test, fit.channel, limits, excess, excess / total, int(inside.sum()), float(np.mean(misfit)), rms
        )
        left &= ~inside


def _axes(test: TestRecord) -> dict[str, list[tuple[np.ndarray, tuple[float, float] | None]]]:
    """For each column the stretches that may bound a box: (rows inside, limits; None for "anywhere")."""
    everywhere = np.ones(test.rows, dtype=bool)
    axes: dict[str, list[tuple[np.ndarray, tuple[float, float] | None]]] = {}
    x = test.place
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, STRETCHES + 1)))
    dynamic = isinstance(test, DynamicTest)
    first = "spool_position" if not dynamic else "time" if test.frequency is None else "frequency"
    stretches: list[tuple[np.ndarray, tuple[float, float] | None]] = [(everywhere, None)]
    for i in range(len(edges) - 1):
        for j in range(i + 1, len(edges)):
            if (i, j) != (0, len(edges) - 1):
                stretches.append(((x >= edges[i]) & (x <= edges[j]), (float(edges[i]), float(edges[j]))))
    axes[first] = stretches
    for name, column, step in (
        ("temperature", test.temperature, 2.0),
        ("supply_pressure", test.supply_pressure, 0.03 * max(float(np.max(np.abs(test.supply_pressure))), 1e-300)),
        ("direction", test.direction, 0.5),
        ("rate", None if test.rate is None else np.abs(test.rate), None),
        ("run", test.run.astype(float) if dynamic else None, 0.5),
    ):
        if column is None:
            continue
        if step is None:
            step = 0.2 * max(float(np.median(column)), 1e-300)
        axes[name] = [(everywhere, None), *_levels(column, step)]
    return axes


def _levels(column: np.ndarray, step: float) -> list[tuple[np.ndarray, tuple[float, float]]]:
    """Contiguous groups of the levels of a column that is held in steps; none where it does not vary or drifts."""
    order = np.sort(column)
    starts = np.append(0, 1 + np.flatnonzero(np.diff(order) > step))
    ends = np.append(starts[1:] - 1, len(order) - 1)
    if not 1 < len(starts) <= 6:
        return []
    found = []
    for i in range(len(starts)):
        for j in range(i, len(starts)):
            if (i, j) == (0, len(starts) - 1):
                continue
            low, high = float(order[starts[i]]), float(order[ends[j]])
            found.append(((column >= low) & (column <= high), (low, high)))
    return found


def _best_box(
    squares: np.ndarray, axes: dict[str, list[tuple[np.ndarray, tuple[float, float] | None]]], left: np.ndarray
) -> tuple[np.ndarray, dict[str, tuple[float, float]]] | None:
    """The box of the largest gain, column after column from "anywhere" until none can be narrowed with profit."""
    n, power = float(left.sum()), float(np.sum(squares[left]))
    if n < LEAST_ROWS or power <= n:
        return None
    first, *others = axes
    position = np.stack([rows for rows, _ in axes[first]]) & left
    best_gain, best = WORTH_TELLING, None
    for choice in product(*(range(len(axes[name])) for name in others)):
        inside = left.copy()
        for name, i in zip(others, choice, strict=True):
            inside &= axes[name][i][0]
        if inside.sum() < LEAST_ROWS:
            continue
        counts = position @ inside.astype(float)
        sums = position @ np.where(inside, squares, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean_in = np.where(counts > 0, sums / counts, 0.0)
            mean_out = np.where(n - counts > 0, (power - sums) / (n - counts), 1.0)
            gain = 0.5 * (
                n * np.log(power / n)
                - counts * np.log(np.maximum(mean_in, 1e-300))
                - (n - counts) * np.log(np.maximum(mean_out, 1e-300))
            )
        gain = np.where((counts >= LEAST_ROWS) & (mean_in > np.maximum(mean_out, 1.0)), gain, -np.inf)
        # Every bound has to earn its place in the sentence.
        bounds = sum(axes[name][i][1] is not None for name, i in zip(others, choice, strict=True))
        gain = gain - 2.0 * (bounds + (np.arange(len(gain)) > 0))
        k = int(np.argmax(gain))
        if gain[k] > best_gain:
            best_gain = float(gain[k])
            limits = {
                name: limit
                for name, i in (*zip(others, choice, strict=True), (first, k))
                if (limit := axes[name][i][1]) is not None
            }
            best = inside & axes[first][k][0], limits
    if best is None and power - n > 5.0 * np.sqrt(2.0 * n):
        return left.copy(), {}  # everywhere alike
    return best
