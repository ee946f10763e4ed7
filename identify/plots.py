"""Figures of a fit: data beside the model for each test, and the residuals in units of the noise."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from . import plot_style as look
from .display_units import reading_unit
from .fit_result import ChannelFit, FitResult


TITLES = {
    "leakage": "Leakage, blocked ports",
    "pressure_gain": "Pressure gain, blocked ports",
    "flow_gain": "Flow gain, connected ports",
    "load_flow": "Load flow",
}
READINGS = {
    "leakage_flow": "leakage",
    "flow": "flow",
    "load_pressure": "load pressure",
    "pressure_a": "pressure A",
    "pressure_b": "pressure B",
}
# More points than this are thinned evenly for the picture: the eye cannot tell, and the files stay small.
MOST_POINTS = 4000


@dataclass(frozen=True)
class _Sweep:
    """The rows of a channel under one temperature, supply pressure, run and direction, in bench units."""

    x: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    band: np.ndarray
    residual: np.ndarray
    colour: str
    marker: str
    upward: bool
    first: bool  # of its temperature and supply pressure: one band is enough where many sweeps lie on each other


def test_figures(result: FitResult) -> dict[str, Figure]:
    """{test: figure}, one column of panels per channel; a single channel gets a second, closer view."""
    figures = {}
    with look.style():
        for test in dict.fromkeys(fit.test for fit in result.channels):
            fits = [fit for fit in result.channels if fit.test == test]
            figures[test] = _test_figure(test, fits, _null(result))
    return figures


def _null(result: FitResult) -> float:
    estimate = result.parameters.get("null_bias")
    return 0.0 if estimate is None else estimate.value * 1e6


def _test_figure(test: str, fits: list[ChannelFit], null: float) -> Figure:
    figure = Figure(figsize=(10.0, 5.6))
    views = [(fit, "whole") for fit in fits]
    if len(fits) == 1:
        views.append((fits[0], "logarithmic" if test == "leakage" else "null"))
    grid = figure.subplots(2, len(views), squeeze=False, sharex="col", gridspec_kw={"height_ratios": (2.6, 1.0)})
    figure.subplots_adjust(left=0.075, right=0.985, top=0.90, bottom=0.19, wspace=0.17, hspace=0.09)
    for column, (fit, view) in enumerate(views):
        sweeps = _sweeps(fit)
        _draw_data(grid[0][column], fit, sweeps, view, null)
        _draw_residuals(grid[1][column], sweeps, first=column == 0 or len(fits) > 1)
    figure.text(0.075, 0.955, TITLES.get(test, test), fontsize=12, fontweight="bold")
    _legend(figure, fits[0])
    return figure


def _temperature_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float]]:
    return look.group(fit.temperature - 273.15, 4.0)


def _pressure_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float]]:
    bar = fit.supply_pressure * 1e-5
    return look.group(bar, max(4.0, 0.06 * float(bar.max())))


def _sweeps(fit: ChannelFit) -> list[_Sweep]:
    unit = reading_unit(fit.channel).factor
    t_group, temperatures = _temperature_groups(fit)
    p_group, _ = _pressure_groups(fit)
    colours = look.temperature_colours(len(temperatures))
    step = -(-len(fit.measured) // MOST_POINTS)
    sweeps = []
    banded: set[tuple[int, int]] = set()
    keys = np.stack([t_group, p_group, fit.run, np.sign(fit.direction)], axis=1).astype(int)
    for key in np.unique(keys, axis=0):
        condition = (int(key[0]), int(key[1]))
        rows = np.flatnonzero((keys == key).all(axis=1))
        rows = rows[np.argsort(fit.position[rows], kind="stable")][::step]
        sweeps.append(
            _Sweep(
                x=fit.position[rows] * 1e6,
                measured=fit.measured[rows] * unit,
                predicted=fit.predicted[rows] * unit,
                band=1.96 * fit.predicted_std[rows] * unit,
                residual=(fit.measured[rows] - fit.predicted[rows]) / fit.std[rows],
                colour=colours[key[0]],
                marker=look.MARKERS[key[1] % len(look.MARKERS)],
                upward=bool(key[3] >= 0),
                first=condition not in banded,
            )
        )
        banded.add(condition)
    return sweeps


def _scatter(axes: Axes, sweep: _Sweep, y: np.ndarray, size: float) -> None:
    # scatters become a picture inside the SVG: thousands of vector markers make it slow to open
    axes.plot(
        sweep.x,
        y,
        linestyle="none",
        marker=sweep.marker,
        markersize=size,
        markeredgewidth=0.7,
        markeredgecolor=sweep.colour,
        markerfacecolor=sweep.colour if sweep.upward else "white",
        alpha=0.75,
        rasterized=True,
    )


def _draw_data(axes: Axes, fit: ChannelFit, sweeps: list[_Sweep], view: str, null: float) -> None:
    size = 3.6 if len(fit.measured) < 600 else 2.4
    for sweep in sweeps:
        _scatter(axes, sweep, sweep.measured, size)
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


def _zoom_to_null(axes: Axes, sweeps: list[_Sweep], null: float) -> None:
    half = 0.2 * max(float(np.abs(sweep.x - null).max()) for sweep in sweeps)
    inside = [np.abs(sweep.x - null) <= half for sweep in sweeps]
    if any(keep.any() for keep in inside):
        axes.set_xlim(null - half, null + half)
        shown = [np.r_[s.measured[keep], s.predicted[keep]] for s, keep in zip(sweeps, inside, strict=True)]
        axes.set_ylim(*look.outer_limits(shown))


def _draw_residuals(axes: Axes, sweeps: list[_Sweep], first: bool) -> None:
    axes.axhspan(-1.96, 1.96, color=look.GRID, alpha=0.7, linewidth=0.0)
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
    for sweep in sweeps:
        _scatter(axes, sweep, sweep.residual, 2.0)
    largest = max(float(np.abs(sweep.residual).max()) for sweep in sweeps)
    if largest > 30.0:  # a model that misses badly: keep the small residuals readable beside the large
        look.symmetric_logarithmic(axes, largest, linear=5.0)
    axes.set_ylim(-1.1 * max(largest, 3.0), 1.1 * max(largest, 3.0))
    look.label_axes(axes, "spool position [um]", "residual / noise" if first else "")


def _legend(figure: Figure, fit: ChannelFit) -> None:
    _, temperatures = _temperature_groups(fit)
    _, pressures = _pressure_groups(fit)
    colours = look.temperature_colours(len(temperatures))

    def dot(marker: str, face: str, words: str) -> Line2D:
        return Line2D([], [], linestyle="none", marker=marker, color=look.INK, markerfacecolor=face, label=words)

    conditions = [
        Line2D([], [], color=colour, linewidth=3.0, label=f"{round(celsius)} degC")
        for colour, celsius in zip(colours, temperatures, strict=True)
    ]
    conditions += [dot(m, look.INK, f"{bar:.0f} bar") for m, bar in zip(look.MARKERS, pressures, strict=False)]
    signs = [Line2D([], [], color=look.INK, label="line: model, with its 95 % band")]
    if np.any(fit.direction < 0) and np.any(fit.direction > 0):
        signs += [dot("o", look.INK, "filled: position rising"), dot("o", "white", "open: position falling")]
    for height, handles in ((0.045, conditions), (0.008, signs)):
        figure.legend(
            handles=handles, loc="lower left", ncols=len(handles), bbox_to_anchor=(0.065, height), borderpad=0.0
        )
