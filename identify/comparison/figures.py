"""Draw a comparison: every difference with its interval, beside that of two separate fits."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thermohyd.identify.report import style as look

from .result import ComparisonResult, Difference
from .words import with_unit


DIFFERS, SAME, BLIND, APART = "#b3341f", "#2f6fb0", "#8f8f8f", "#d3dae2"
COLOURS = {"differs": DIFFERS, "same": SAME, "cannot tell": BLIND}
ROW = 0.34  # inches
LINEAR = 6.0  # errors on either side of 0 that are drawn to scale
FAR = 12.0  # from here on the axis is logarithmic


def comparison_figures(result: ComparisonResult) -> dict[str, Figure]:
    """{file name without ending: figure}."""
    return {"differences": differences_figure(result)}


def differences_figure(result: ComparisonResult) -> Figure:
    """Differences in the errors of two separate fits: the joint fit's 95 % intervals in colour, those of two fits in grey."""
    shown = [row for row in result.rows if row.std is not None and row.difference is not None]
    with look.style():
        height = max(len(shown), 3) * ROW + 1.45
        figure = Figure(figsize=(10.0, height))
        axes = figure.add_axes((0.19, 0.78 / height, 0.46, 1.0 - 1.45 / height))
        axes.axvline(0.0, color=look.INK, linewidth=0.9)
        largest = 3.0
        for place, row in enumerate(shown):
            largest = max(largest, _draw(axes, place, row))
        if largest > FAR:
            axes.set_xscale("symlog", linthresh=LINEAR)
            ticks = [t for t in (2.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4) if t <= 1.3 * largest]
            ticks = ticks if len(ticks) < 7 else ticks[1::2]
            axes.set_xticks([*(-t for t in reversed(ticks)), 0.0, *ticks])
            look.plain_numbers(axes.xaxis)
        axes.set_xlim(-1.25 * largest, 1.25 * largest)
        axes.set_ylim(max(len(shown), 3) - 0.4, -0.6)
        axes.set_yticks(range(len(shown)), [row.name for row in shown])
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(f"{result.names[1]} minus {result.names[0]}, in errors of two separate fits")
        figure.text(0.02, 1.0 - 0.3 / height, "What differs", fontsize=12, fontweight="bold")
        handles = [
            Line2D([], [], color=DIFFERS, marker="o", linewidth=2.4, label="differs"),
            Line2D([], [], color=SAME, marker="o", linewidth=2.4, label="no difference"),
            Line2D([], [], color=BLIND, marker="o", linewidth=2.4, label="cannot tell"),
            Line2D([], [], color=APART, linewidth=6.0, label="95 %, two separate fits"),
        ]
        figure.legend(handles=handles, loc="lower left", ncols=4, bbox_to_anchor=(0.18, 0.02), borderpad=0.0)
    return figure


def _draw(axes: Axes, place: int, row: Difference) -> float:
    """One row; returns how far it reaches."""
    assert row.ci95 is not None
    assert row.difference is not None
    size = row.std_apart or row.std or 1.0
    middle, low, high = (value / size for value in (row.difference, *row.ci95))
    colour = COLOURS[row.state]
    axes.plot((middle - 1.96, middle + 1.96), (place, place), color=APART, linewidth=7.0, solid_capstyle="butt")
    axes.plot((low, high), (place, place), color=colour, linewidth=2.4)
    axes.plot((middle,), (place,), marker="o", color=colour, markersize=5.0)
    words = with_unit(row.difference, row.std, row.shown)
    weight = "bold" if row.state == "differs" else "normal"
    axes.annotate(words, (1.02, place), xycoords=("axes fraction", "data"), va="center", fontsize=8, weight=weight)
    return float(np.max(np.abs((low, high))))
