"""Figures of a fit: data beside the model for each test, and the residuals in units of the noise."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from . import plot_style as look
from .display_units import reading_unit
from .dynamic.plots import dynamic_figure
from .fit_result import ChannelFit, FitResult
from .record import DYNAMIC_TESTS
from .sweep_drawing import READINGS, TITLES, Sweep, condition_legend, draw_residuals, scatter, sweeps_of


def test_figures(result: FitResult) -> dict[str, Figure]:
    """{test: figure}, one column of panels per channel; a single channel gets a second, closer view."""
    figures = {}
    with look.style():
        for test in dict.fromkeys(fit.test for fit in result.channels):
            fits = [fit for fit in result.channels if fit.test == test]
            if test in DYNAMIC_TESTS:
                figures[test] = dynamic_figure([(None, fit) for fit in fits], run_names_of(result, test))
                continue
            record = result.record.tests.get(test)
            figures[test] = _test_figure(test, fits, _null(result), () if record is None else record.run_names)
    return figures


def run_names_of(result: FitResult, test: str) -> tuple[str, ...]:
    """Names of a test's runs, as the user wrote them."""
    record = result.record.all_tests.get(test)
    return () if record is None else record.run_names


def _null(result: FitResult) -> float:
    estimate = result.parameters.get("null_bias")
    return 0.0 if estimate is None else estimate.value * 1e6


def _test_figure(test: str, fits: list[ChannelFit], null: float, run_names: tuple[str, ...]) -> Figure:
    figure = Figure(figsize=(10.0, 5.6))
    views = [(fit, "whole") for fit in fits]
    if len(fits) == 1:
        views.append((fits[0], "logarithmic" if test == "leakage" else "null"))
    grid = figure.subplots(2, len(views), squeeze=False, sharex="col", gridspec_kw={"height_ratios": (2.6, 1.0)})
    figure.subplots_adjust(left=0.075, right=0.985, top=0.90, bottom=0.19, wspace=0.17, hspace=0.09)
    for column, (fit, view) in enumerate(views):
        sweeps = sweeps_of(fit)
        _draw_data(grid[0][column], fit, sweeps, view, null)
        draw_residuals(grid[1][column], sweeps, labelled=column == 0 or len(fits) > 1)
    figure.text(0.075, 0.955, TITLES.get(test, test), fontsize=12, fontweight="bold")
    condition_legend(figure, fits[0], run_names)
    return figure


def _draw_data(axes: Axes, fit: ChannelFit, sweeps: list[Sweep], view: str, null: float) -> None:
    size = 3.6 if len(fit.measured) < 600 else 2.4
    for sweep in sweeps:
        scatter(axes, sweep, sweep.measured, size)
    for sweep in sweeps:
        if sweep.first:
            low, high = sweep.predicted - sweep.band, sweep.predicted + sweep.band
            axes.fill_between(sweep.x, low, high, color=sweep.colour, alpha=0.22, linewidth=0.0)
        axes.plot(sweep.x, sweep.predicted, color=sweep.colour)
    unit = reading_unit(fit.channel).label
    title = {"whole": "whole sweep", "null": "around null", "logarithmic": "logarithmic"}[view]
    axes.set_title(f"{READINGS.get(fit.channel, fit.channel)}, {title}", loc="left", color=look.FAINT)
    look.label_axes(axes, "", f"{READINGS.get(fit.channel, fit.channel)} [{unit}]" if view == "whole" else "")
    if view == "null":
        _zoom_to_null(axes, sweeps, null)
    elif view == "logarithmic":
        positive = np.concatenate([s.predicted[s.predicted > 0.0] for s in sweeps])
        if positive.size:
            axes.set_yscale("log")
            axes.set_ylim(0.5 * positive.min(), 2.0 * positive.max())
            if positive.max() < 50.0 * positive.min():
                axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            look.plain_numbers(axes.yaxis)


def _zoom_to_null(axes: Axes, sweeps: list[Sweep], null: float) -> None:
    half = 0.2 * max(float(np.abs(sweep.x - null).max()) for sweep in sweeps)
    inside = [np.abs(sweep.x - null) <= half for sweep in sweeps]
    if any(keep.any() for keep in inside):
        axes.set_xlim(null - half, null + half)
        shown = [np.r_[s.measured[keep], s.predicted[keep]] for s, keep in zip(sweeps, inside, strict=True)]
        axes.set_ylim(*look.outer_limits(shown))
