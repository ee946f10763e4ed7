"""Find where a fitted model misses the bench: boxes of conditions that hold the most misfit beyond noise; in words and as a map.

A scan over boxes for the one whose residual variance most exceeds the rest's (Kulldorff's scan statistic for a variance:
Communications in Statistics 26, 1997); found, set aside, and again. Words are an engineer's: "-12 to 35 um, 60 to 71 degC,
falling". The map shows residuals in units of the noise over the position, one row per condition and direction.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import UM, DisplayUnit, significant
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.result import ChannelFit, FitResult
from thermohyd.identify.report import style as look
from thermohyd.identify.report.style import TITLES, pressure_groups, run_label, temperature_groups

from .result import Region


STRETCHES = 12  # of a variable, between whose ends a box begins and ends: their pairs are tried in a moment
MOST_REGIONS = 6  # that are told
LEAST_ROWS = 6  # of a box: a variance of fewer is known to 60 % at best
# Smallest gain of the scan worth a line: far beyond what the many boxes reach by chance.
WORTH_TELLING = 12.0
SMALLEST_SHARE = 0.02  # of the excess chi-square: less is no lead, however sure


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
        mean, rows = float(np.mean(misfit)), int(inside.sum())
        yield Region(fit.test, fit.channel, limits, excess, excess / total, rows, mean, rms, fit.signal)
        left &= ~inside


def _axes(test: TestRecord) -> dict[str, list[tuple[np.ndarray, tuple[float, float] | None]]]:
    """For each column the stretches that may bound a box: (rows inside, limits; None for "anywhere")."""
    everywhere = np.ones(test.rows, dtype=bool)
    axes: dict[str, list[tuple[np.ndarray, tuple[float, float] | None]]] = {}
    x = test.place
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, STRETCHES + 1)))
    first = test.axis
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
        ("run", test.run.astype(float) if test.in_motion else None, 0.5),
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


_AFTER = {"supply_pressure": " supply", "return_pressure": " return", "load_pressure": " load"}


def direction_word(direction: float) -> str:
    """How the spool moved."""
    return "rising" if direction > 0 else "falling"


def region_words(limits: Mapping[str, tuple[float, float]], run_names: tuple[str, ...] = ()) -> str:
    """The box in words, position first; "everywhere" where nothing bounds it. Limits are SI."""
    columns = sorted(limits, key=lambda column: column not in ("spool_position", "time", "frequency"))
    words = [_range(column, *limits[column], run_names) for column in columns]
    return ", ".join(word for word in words if word) or "everywhere"


def miss_words(unit: DisplayUnit, mean: float, rms: float) -> tuple[str, str]:
    """(RMS with its unit, side) of a misfit: "above" or "below" the model; "" where both signs outweigh the mean."""
    size = rms if rms > 0.0 else abs(mean)
    side = "" if size > 2.0 * abs(mean) else "above" if mean > 0 else "below"
    return f"{significant(size * unit.factor, 2)} {unit.label} RMS", side


def _range(column: str, low: float, high: float, run_names: tuple[str, ...]) -> str:
    if column == "direction":
        return "" if low != high else f"{direction_word(low)} sweeps"
    if column == "run":
        return _runs(round(low), round(high), run_names)
    unit = column_unit(column)
    low, high = unit.of(low), unit.of(high)
    # A step test lasts a second, a sweep minutes.
    digits = 3 if column == "time" else 0 if max(abs(low), abs(high)) >= 10.0 else 2
    first, last = (f"{value:.{digits}f}" if unit.label else significant(value, 3) for value in (low, high))
    if first == "-0":
        first = "0"
    figures = first if first == last else f"{first} to {last}"
    if not unit.label:
        return f"{column} {figures}"
    return f"{figures} {unit.label}{_AFTER.get(column, '')}"


def _runs(low: int, high: int, names: tuple[str, ...]) -> str:
    if 0 <= low <= high < len(names):
        return f"run {names[low]}" if low == high else f"runs {names[low]} to {names[high]}"
    return f"run {low}" if low == high else f"runs {low} to {high}"


MOST_BINS = 60  # across a picture
MOST_ROWS = 16  # per channel: where runs would make more, they share a row
ROW, HEAD, FOOT, TOP = 0.17, 0.42, 0.95, 0.25  # inches


@dataclass(frozen=True)
class _Map:
    """Mean residual of each bin (rows, bins), NaN where there is no reading."""

    title: str
    labels: list[str]
    edges: np.ndarray  # um
    values: list[np.ndarray]  # of each model


def residual_map(before: FitResult, after: FitResult | None, run_names: dict[str, tuple[str, ...]]) -> Figure:
    """Both models beside each other on one colour scale; `after` None: the ideal valve alone."""
    fits = [before] if after is None else [before, after]
    maps = [
        _map([fit.channels[i] for fit in fits], run_names.get(channel.test, ()))
        for i, channel in enumerate(before.channels)
    ]
    heights = [max(2, len(found.labels)) * ROW for found in maps]
    total = sum(heights) + HEAD * len(maps) + FOOT + TOP
    with look.style():
        figure = Figure(figsize=(10.0, total))
        largest = max(
            [
                10.0,
                *(  # noise alone stays pale
                    float(np.nanmax(np.abs(values))) for m in maps for values in m.values
                ),
            ]
        )
        norm = SymLogNorm(linthresh=2.0, linscale=0.5, vmin=-largest, vmax=largest)
        width = 0.82 if len(fits) == 1 else 0.395
        top = total - TOP
        for found, height in zip(maps, heights, strict=True):
            top -= HEAD + height
            for column, values in enumerate(found.values):
                place = (0.155 + column * (width + 0.04), top / total, width, height / total)
                axes = figure.add_axes(place)
                mesh = axes.pcolormesh(found.edges, np.arange(len(values) + 1), values, cmap="RdBu_r", norm=norm)
                mesh.set_rasterized(True)
                _label(axes, found, ("ideal valve", "final model")[column], column == 0)
                if found is maps[-1]:
                    axes.set_xlabel("spool position [um]", fontsize=8, labelpad=1)
        scale = figure.add_axes((0.155, 0.40 / total, 0.30, 0.10 / total))
        bar = figure.colorbar(ScalarMappable(norm, "RdBu_r"), cax=scale, orientation="horizontal")
        decades = [tick for tick in (2.0, 10.0, 100.0, 1000.0, 1e4, 1e5) if tick <= largest]
        bar.set_ticks([-t for t in reversed(decades)] + [0.0, *decades])
        look.plain_numbers(bar.ax.xaxis)
        figure.text(0.47, 0.38 / total, "mean residual of a cell in units of the noise of one reading", fontsize=8)
        figure.text(0.02, 1.0 - 0.25 / total, "Residuals over the record", fontsize=12, fontweight="bold")
    return figure


def _label(axes: Axes, found: _Map, model: str, first: bool) -> None:
    axes.grid(False)
    axes.set_ylim(len(found.labels), 0)
    axes.set_yticks(np.arange(len(found.labels)) + 0.5, found.labels if first else [], fontsize=7)
    axes.tick_params(length=0, labelsize=7)
    axes.set_facecolor("#f1f1f1")
    axes.set_title(f"{found.title}, {model}", loc="left", color=look.FAINT, fontsize=9)


def _map(fits: list[ChannelFit], run_names: tuple[str, ...]) -> _Map:
    group, labels, same = _conditions(fits[0], run_names)
    position = fits[0].position * UM
    edges = _edges(position, group)
    bins = np.clip(np.searchsorted(edges, position, side="right") - 1, 0, len(edges) - 2)
    shape = (len(labels), len(edges) - 1)
    cell = group * shape[1] + bins
    count = np.bincount(cell, minlength=shape[0] * shape[1])
    values = []
    for fit in fits:
        total = np.bincount(cell, (fit.measured - fit.predicted) / fit.std, minlength=count.size)
        values.append(np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(shape))
    port = f", port {fits[0].channel[-1].upper()}" if fits[0].channel in ("pressure_a", "pressure_b") else ""
    return _Map(f"{TITLES.get(fits[0].test, fits[0].test).partition(',')[0]}{port}{same}", labels, edges, values)


def _edges(position: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Cells where the readings are: benches step finely around null and coarsely elsewhere."""
    densest = int(np.bincount(group).argmax())
    steps = len(np.unique(np.round(position[group == densest], 1)))
    cells = min(MOST_BINS, max(4, int(0.7 * steps)))
    edges = np.unique(np.quantile(position, np.linspace(0.0, 1.0, cells + 1)))
    return edges if len(edges) > 1 else edges[0] + np.array([-0.5, 0.5])


def _conditions(fit: ChannelFit, run_names: tuple[str, ...]) -> tuple[np.ndarray, list[str], str]:
    """(row of the map of each reading, label of each row, what all share): temperature, supply pressure, direction, and
    the run where there are few."""
    t_group, temperatures = temperature_groups(fit)
    p_group, pressures = pressure_groups(fit)
    keys = np.stack([t_group, p_group, fit.run, np.where(fit.direction > 0, 0, 1)], axis=1).astype(int)
    apart = np.unique(keys, axis=0)
    by_run = len(np.unique(np.delete(keys, 2, axis=1), axis=0)) < len(apart) <= MOST_ROWS
    if not by_run:
        keys[:, 2] = 0
    rows, group = np.unique(keys, axis=0, return_inverse=True)
    several = [len(temperatures) > 1, len(pressures) > 1, by_run, True]
    labels = []
    for t, p, run, falling in rows:
        words = (
            f"{temperatures[t]:.0f} degC",
            f"{pressures[p]:.0f} bar",
            run_label(int(run), run_names),
            direction_word(-1 if falling else 1),
        )
        labels.append(", ".join(word for word, shown in zip(words, several, strict=True) if shown))
    same = [f"{temperatures[0]:.0f} degC"] * (not several[0]) + [f"{pressures[0]:.0f} bar"] * (not several[1])
    return group.reshape(-1), labels, "".join(f", {word}" for word in same)
