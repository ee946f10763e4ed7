"""Figure of a test before and after the effects were added: data with both models, what the effects had to explain,
and the residuals of both models on one scale."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .. import plot_style as look
from ..display_units import reading_unit
from ..fit_result import ChannelFit
from ..sweep_drawing import (
    READINGS,
    TITLES,
    Sweep,
    condition_legend,
    draw_residuals,
    largest_residual,
    scatter,
    sweeps_of,
)
from .diagnosis_content import excess


LINES = (
    Line2D([], [], color=look.INK, linestyle=":", label="dotted: ideal valve"),
    Line2D([], [], color=look.INK, label="line: final model, with its 95 % band"),
)


def before_after_figure(before: ChannelFit, after: ChannelFit, name: str, run_names: tuple[str, ...] = ()) -> Figure:
    """One channel; `before` and `after` hold the same rows. `name` says what the final model is, in a few words."""
    with look.style():
        figure = Figure(figsize=(10.0, 6.4))
        grid = figure.subplots(2, 2, sharex=True, gridspec_kw={"height_ratios": (1.9, 1.0)})
        figure.subplots_adjust(left=0.075, right=0.985, top=0.90, bottom=0.165, wspace=0.19, hspace=0.19)
        old, new = sweeps_of(before), sweeps_of(after)
        _draw_data(grid[0][0], after, old, new)
        _draw_gap(grid[0][1], after, old, new)
        largest = max(largest_residual(old), largest_residual(new))
        for axes, sweeps, fit, words in ((grid[1][0], old, before, "ideal valve"), (grid[1][1], new, after, name)):
            draw_residuals(axes, sweeps, labelled=sweeps is old, largest=largest)
            axes.set_title(
                f"residuals, {words}: reduced chi-square {excess(fit.reduced_chi2)}", loc="left", color=look.FAINT
            )
        port = f", port {after.channel[-1].upper()}" if after.channel in ("pressure_a", "pressure_b") else ""
        figure.text(0.075, 0.958, f"{TITLES.get(after.test, after.test)}{port}", fontsize=12, fontweight="bold")
        condition_legend(figure, after, run_names, LINES)
    return figure


def _reading(fit: ChannelFit) -> str:
    return READINGS.get(fit.channel, fit.channel)


def _size(fit: ChannelFit) -> float:
    return 3.4 if len(fit.measured) < 600 else 2.2


def _draw_data(axes: Axes, fit: ChannelFit, old: list[Sweep], new: list[Sweep]) -> None:
    for sweep in new:
        scatter(axes, sweep, sweep.measured, _size(fit))
    for former, sweep in zip(old, new, strict=True):
        if sweep.first:
            low, high = sweep.predicted - sweep.band, sweep.predicted + sweep.band
            axes.fill_between(sweep.x, low, high, color=sweep.colour, alpha=0.22, linewidth=0.0)
            axes.plot(former.x, former.predicted, color=sweep.colour, linestyle=":")
        axes.plot(sweep.x, sweep.predicted, color=sweep.colour)
    axes.set_title("bench and both models", loc="left", color=look.FAINT)
    look.label_axes(axes, "", f"{_reading(fit)} [{reading_unit(fit.channel).label}]")


def _draw_gap(axes: Axes, fit: ChannelFit, old: list[Sweep], new: list[Sweep]) -> None:
    """What the bench shows beyond the ideal valve, and what the final model makes of it."""
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8, linestyle=":")
    for former, sweep in zip(old, new, strict=True):
        scatter(axes, sweep, former.measured - former.predicted, _size(fit))
    banded = set()
    for former, sweep in zip(old, new, strict=True):
        added = sweep.predicted - former.predicted
        sort = (sweep.colour, sweep.marker, sweep.upward)
        if sort not in banded:  # one band is enough where repeated sweeps lie on each other
            low, high = added - sweep.band, added + sweep.band
            axes.fill_between(sweep.x, low, high, color=sweep.colour, alpha=0.22, linewidth=0.0)
        banded.add(sort)
        axes.plot(sweep.x, added, color=sweep.colour)
    shown = [former.measured - former.predicted for former in old]
    axes.set_ylim(*look.outer_limits([*shown, *(n.predicted - o.predicted for o, n in zip(old, new, strict=True))]))
    axes.set_title("bench beyond the ideal valve; line: what was added to it", loc="left", color=look.FAINT)
    look.label_axes(axes, "", f"{_reading(fit)} - ideal valve [{reading_unit(fit.channel).label}]")


def same_rows(before: ChannelFit, after: ChannelFit) -> bool:
    """Whether the two fits can be compared row by row."""
    return len(before.measured) == len(after.measured) and bool(np.array_equal(before.position, after.position))
