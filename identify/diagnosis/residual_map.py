"""Figure of where the models miss: residuals in noise units over the position, one row per condition and direction."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure

from .. import plot_style as look
from ..fit_result import ChannelFit, FitResult
from ..sweep_drawing import TITLES, pressure_groups, run_label, temperature_groups
from .condition_words import direction_word


MOST_BINS = 60
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
    position = fits[0].position * 1e6
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
