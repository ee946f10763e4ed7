"""Figures of dynamic tests: time histories of every run beside the models, and Bode diagrams. No JAX."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plot_style as look
from ..display_units import reading_unit
from ..fit_result import ChannelFit


MOST_RUNS = 4
BEFORE, AFTER, DATA = "#c9702b", "#1f5fa8", "#8a8a8a"
BAND = 1.96  # standard deviations

Pair = tuple[ChannelFit | None, ChannelFit]  # before, after


def dynamic_figure(pairs: Sequence[Pair], run_names: Sequence[str], words: tuple[str, str] = ("model", "")) -> Figure:
    """Figure of one dynamic test. pairs: its channels without (None: not shown) and with what was added.

    words: what the final model is called, and the one before.
    """
    with look.style():
        if pairs[0][1].test == "frequency":
            return _bode(pairs, run_names, words)
        return _histories(pairs, run_names, words)


def _histories(pairs: Sequence[Pair], run_names: Sequence[str], words: tuple[str, str]) -> Figure:
    runs = list(np.unique(pairs[0][1].run))
    shown = runs[:MOST_RUNS]
    figure = Figure(figsize=(3.2 + 3.4 * len(shown), 1.0 + 1.75 * len(pairs)))
    grid = figure.subplots(len(pairs), len(shown), squeeze=False, sharex="col", sharey="row")
    for row, pair in zip(grid, pairs, strict=True):
        for axes, code in zip(row, shown, strict=True):
            _draw(axes, pair, pair[1].run == code, words)
        unit = reading_unit(pair[1].channel).label
        row[0].set_ylabel(f"{pair[1].channel.replace('_', ' ')} [{unit}]")
    for axes, code in zip(grid[0], shown, strict=True):
        name = run_names[code] if code < len(run_names) and run_names[code] else ""
        axes.set_title(f"run {name}" if name else "", loc="left", color=look.FAINT)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    more = f", {len(shown)} of {len(runs)} runs" if len(shown) < len(runs) else ""
    _finish(figure, grid, f"Step test{more}")
    return figure


def _draw(axes: Axes, pair: Pair, rows: np.ndarray, words: tuple[str, str]) -> None:
    before, after = pair
    unit = reading_unit(after.channel).factor
    order = np.flatnonzero(rows)[np.argsort(after.position[rows], kind="stable")]
    x = after.position[order]
    axes.plot(x, after.measured[order] * unit, ".", color=DATA, markersize=2.6, label="bench", rasterized=True)
    if before is not None:
        axes.plot(x, before.predicted[order] * unit, color=BEFORE, linestyle="--", label=words[1])
    low, high = ((after.predicted[order] + sign * BAND * after.predicted_std[order]) * unit for sign in (-1.0, 1.0))
    axes.fill_between(x, low, high, color=AFTER, alpha=0.25, linewidth=0.0, label="95 % band of the parameters")
    axes.plot(x, after.predicted[order] * unit, color=AFTER, label=words[0])


def _bode(pairs: Sequence[Pair], run_names: Sequence[str], words: tuple[str, str]) -> Figure:
    figure = Figure(figsize=(8.0, 1.0 + 2.6 * len(pairs)))
    grid = figure.subplots(len(pairs), 1, squeeze=False, sharex="col")
    for (axes,), pair in zip(grid, pairs, strict=True):
        for code in np.unique(pair[1].run):
            _draw(axes, pair, pair[1].run == code, words)
        axes.set_xscale("log")
        look.plain_numbers(axes.xaxis)
        unit = reading_unit(pair[1].channel).label
        if pair[1].channel == "amplitude_ratio":
            axes.set_yscale("log")
            look.plain_numbers(axes.yaxis)
        axes.set_ylabel(f"{pair[1].channel.replace('_', ' ')} [{unit}]")
    grid[-1][0].set_xlabel("frequency [Hz]")
    several = f", {len(np.unique(pairs[0][1].run))} operating points" if len(np.unique(pairs[0][1].run)) > 1 else ""
    _finish(figure, grid, f"Frequency response{several}")
    return figure


def _finish(figure: Figure, grid: np.ndarray, title: str) -> None:
    height = float(figure.get_figheight())
    figure.subplots_adjust(
        left=0.9 / float(figure.get_figwidth()), right=0.985, top=1.0 - 0.55 / height, bottom=0.75 / height, wspace=0.06,
        hspace=0.14,
    )  # fmt: skip
    figure.align_ylabels(grid[:, 0])
    figure.text(0.02, 1.0 - 0.27 / height, title, fontsize=12, fontweight="bold")
    handles, labels = grid[0][0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="lower center", ncols=4, bbox_to_anchor=(0.5, 0.0))
