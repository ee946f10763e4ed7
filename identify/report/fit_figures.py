"""Draw the figures of a fit: data beside the model with residuals in units of the noise, and how well each parameter is known.

Static tests are drawn over the position; dynamic ones as time histories of every run, or as Bode diagrams. No JAX.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from thermohyd.identify.bench.shown_units import UM
from thermohyd.identify.bench.test_record import is_dynamic, kind_of_test
from thermohyd.identify.fitting.result import ChannelFit, FitResult

from . import style as look
from .style import READINGS, TITLES, Sweep, condition_legend, draw_residuals, scatter, sweeps_of


MOST_RUNS = 4
BEFORE, AFTER, DATA = "#c9702b", "#1f5fa8", "#8a8a8a"
BAND = 1.96  # standard deviations
CELL = 0.36  # inches: a parameter's row, and its cell in the matrix of correlations

Pair = tuple[ChannelFit | None, ChannelFit]  # before, after


def dynamic_figure(pairs: Sequence[Pair], run_names: Sequence[str], words: tuple[str, str] = ("model", "")) -> Figure:
    """Figure of one dynamic test. pairs: its channels without (None: not shown) and with what was added.

    words: what the final model is called, and the one before.
    """
    with look.style():
        if kind_of_test(pairs[0][1].test) == "frequency":
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
        unit = pair[1].unit.label
        row[0].set_ylabel(f"{pair[1].channel.replace('_', ' ')} [{unit}]")
    for axes, code in zip(grid[0], shown, strict=True):
        name = run_names[code] if code < len(run_names) and run_names[code] else ""
        axes.set_title(f"run {name}" if name else "", loc="left", color=look.FAINT)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    more = f", {len(shown)} of {len(runs)} runs" if len(shown) < len(runs) else ""
    _finish(figure, grid, f"Step test{_own_name(pairs)}{more}")
    return figure


def _draw(axes: Axes, pair: Pair, rows: np.ndarray, words: tuple[str, str]) -> None:
    before, after = pair
    unit = after.unit.factor
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
        unit = pair[1].unit.label
        if pair[1].channel == "amplitude_ratio":
            axes.set_yscale("log")
            look.plain_numbers(axes.yaxis)
        axes.set_ylabel(f"{pair[1].channel.replace('_', ' ')} [{unit}]")
    grid[-1][0].set_xlabel("frequency [Hz]")
    several = f", {len(np.unique(pairs[0][1].run))} operating points" if len(np.unique(pairs[0][1].run)) > 1 else ""
    _finish(figure, grid, f"Frequency response{_own_name(pairs)}{several}")
    return figure


def _own_name(pairs: Sequence[Pair]) -> str:
    """ " (slow)" of step_slow: a record may hold several tests of a kind."""
    name = pairs[0][1].test
    own = name.removeprefix(kind_of_test(name)).strip("_").replace("_", " ")
    return f" ({own})" if own else ""


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


def fit_figures(result: FitResult) -> dict[str, Figure]:
    """{file name without ending: figure}: one per test, and the parameters where some were free."""
    figures = test_figures(result)
    return {**figures, "parameters": parameter_figure(result)} if result.free else figures


def test_figures(result: FitResult) -> dict[str, Figure]:
    """{test: figure}, one column of panels per channel; a single channel gets a second, closer view."""
    figures = {}
    with look.style():
        for test in dict.fromkeys(fit.test for fit in result.channels):
            fits = [fit for fit in result.channels if fit.test == test]
            if is_dynamic(test):
                figures[test] = dynamic_figure([(None, fit) for fit in fits], run_names_of(result, test))
                continue
            record = result.record.tests.get(test)
            figures[test] = _test_figure(test, fits, _null(result), () if record is None else record.run_names)
    return figures


def run_names_of(result: FitResult, test: str) -> tuple[str, ...]:
    """Names of a test's runs, as the user wrote them."""
    record = result.record.tests.get(test)
    return () if record is None else record.run_names


def _null(result: FitResult) -> float:
    estimate = result.parameters.get("null_bias")
    return 0.0 if estimate is None else estimate.value * UM


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
    unit = fit.unit.label
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


def parameter_figure(result: FitResult) -> Figure:
    """How well each fitted parameter is known, and the matrix of correlations."""
    # In inches: a cell of the matrix holds its figure however many parameters there are.
    side = CELL * max(len(result.free), 4)
    width, height, bottom = 8.15 + side, side + 1.8, 1.35
    place = lambda left, wide: (left / width, bottom / height, wide / width, side / height)
    with look.style():
        figure = Figure(figsize=(width, height))
        _precision(figure.add_axes(place(1.55, 2.95)), result)
        _correlation_matrix(
            figure, figure.add_axes(place(7.25, side)), figure.add_axes(place(7.4 + side, 0.12)), result
        )
    return figure


def _precision(axes: Axes, result: FitResult) -> None:
    for row, name in enumerate(result.free):
        estimate = result.parameters[name]
        unit = estimate.shown
        words = "no error bar"
        if estimate.std is not None:
            words = (
                f"{estimate.value * unit.factor:.4g} ± {estimate.std * unit.factor:.2g} {unit.label.replace('-', '')}"
            )
            share = 100.0 * estimate.std / max(abs(estimate.value), 1e-3 * estimate.std)
            axes.plot(min(share, 1000.0), row, "o", color=look.INK, markersize=5)
        axes.annotate(words, (1.02, row), xycoords=("axes fraction", "data"), va="center", fontsize=8)
    axes.set_yticks(range(len(result.free)), result.free)
    axes.set_ylim(len(result.free) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xlim(0.01, 1500.0)
    look.plain_numbers(axes.xaxis)
    axes.set_title("how well each is known", loc="left", color=look.FAINT)
    axes.set_xlabel("standard error in % of the value")


def _correlation_matrix(figure: Figure, axes: Axes, scale: Axes, result: FitResult) -> None:
    count = len(result.free)
    image = axes.imshow(result.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    for i in range(count):
        for j in range(count):
            value = float(result.correlation[i, j])
            if i != j and np.isfinite(value):
                axes.text(
                    j,
                    i,
                    f"{value:+.2f}",
                    ha="center",
                    va="center",
                    fontsize=7,
                    color="white" if abs(value) > 0.6 else look.INK,
                )
    axes.grid(False)
    axes.set_xticks(range(count), result.free, rotation=35, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(count), result.free)
    axes.set_title("correlations", loc="left", color=look.FAINT)
    figure.colorbar(image, cax=scale)
