"""Figure of a fit's parameters: how well each is known, and which go together."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import plot_style as look
from .display_units import display_unit
from .fit_result import FitResult


def parameter_figure(result: FitResult) -> Figure:
    """How well each fitted parameter is known, and the matrix of correlations."""
    with look.style():
        figure = Figure(figsize=(10.0, 0.36 * max(len(result.free), 4) + 1.9))
        axes = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.25, 1.0)})
        figure.subplots_adjust(left=0.155, right=0.95, top=0.88, bottom=0.32, wspace=0.95)
        _precision(axes[0], result)
        _correlation_matrix(figure, axes[1], result)
    return figure


def _precision(axes: Axes, result: FitResult) -> None:
    for row, name in enumerate(result.free):
        estimate = result.parameters[name]
        unit = display_unit(estimate.unit)
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


def _correlation_matrix(figure: Figure, axes: Axes, result: FitResult) -> None:
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
    figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03)
