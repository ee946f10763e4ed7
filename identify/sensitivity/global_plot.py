"""Figures of the global study: Sobol indices of each figure with their bounds, and total indices along the curves."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .. import plot_style as look
from .bench_units import with_unit
from .plot_parts import COLOURS, TITLES, dashes, key_of_factors, position_axis, sheet, stretched
from .result import SensitivityResult
from .row_slopes import TESTS
from .words import SHORT, conditions_in_words


FIRST, INTERACTION = "#2f6fb0", "#b9cfe6"


def sobol_figure(result: SensitivityResult) -> Figure:
    """First-order and total index of every factor on every figure, 95 % intervals, and the derivative-based bound."""
    sobol, bound = result.tolerances.sobol, result.tolerances.derivative.bound
    order = result.ranking()
    names = list(SHORT)
    with look.style():
        figure = sheet(
            "Which tolerance matters: Sobol indices",
            f"{result.subject.name}, {conditions_in_words(result)}; {sobol.evaluations:,} evaluations of the three static tests",
            12.0,
            7.4,
        )
        grid = figure.subplots(2, 4, sharey=True)
        figure.subplots_adjust(left=0.14, right=0.985, top=0.875, bottom=0.075, wspace=0.10, hspace=0.30)
        for panel, name in zip(grid.flat, names, strict=False):
            o = sobol.outputs.index(name)
            for row, i in enumerate(order):
                total, first = float(sobol.total[o, i]), min(float(sobol.first[o, i]), float(sobol.total[o, i]))
                panel.barh(row, total, color=INTERACTION, height=0.7)
                panel.barh(row, max(first, 0.0), color=FIRST, height=0.7)
                if total > 0.002:
                    half = float(sobol.total_ci[o, i])
                    panel.plot([max(total - half, 0.0), total + half], [row, row], color=look.INK, linewidth=1.0)
                    panel.plot(min(float(bound[o, i]), 1.085), row, "D", color="#c8553d", markersize=3.2)
            std = float(np.sqrt(sobol.variance[o]))
            output = result.outputs[o]
            panel.set_title(f"{SHORT[name]}: {_spread(result.nominal[o], std, output.unit)}", loc="left", fontsize=9)
            panel.set_xlim(0.0, 1.1)
            panel.grid(axis="y", visible=False)
            panel.tick_params(axis="y", length=0)
        grid[0][0].set_yticks(range(len(order)), [result.factors[i].name for i in order])
        grid[0][0].set_ylim(len(order) - 0.4, -0.6)
        for panel in grid[1][:3]:
            panel.set_xlabel("share of the variance")
        grid[0][3].set_xlabel("share of the variance")
        last = grid[1][3]
        last.set_visible(False)
        marks = [
            Patch(color=FIRST),
            Patch(color=INTERACTION),
            Line2D([], [], color=look.INK),
            Line2D([], [], color="#c8553d", marker="D", linestyle="", markersize=4),
        ]
        figure.legend(
            marks,
            [
                "alone (first order)",
                "with interactions (total)",
                "95 % interval of the total",
                "bound from derivatives",
            ],
            loc="center",
            bbox_to_anchor=(0.885, 0.27),
            fontsize=9,
        )
    return figure


def _spread(value: float, std: float, unit: str) -> str:
    words = with_unit(value, unit, 3)
    return f"{words} ± {100 * std / abs(value):.2g} %" if abs(value) > std else f"{words} ± {with_unit(std, unit, 2)}"


def along_figure(result: SensitivityResult) -> Figure:
    """Total index of every factor on the reading at every position of the three tests."""
    study, stroke = result.tolerances, 1.0
    with look.style():
        figure = sheet(
            "Which tolerance matters where: total indices along the curves",
            f"{result.subject.name}, {conditions_in_words(result)}",
            12.0,
            4.7,
        )
        axes = figure.subplots(1, 3, sharey=True)
        figure.subplots_adjust(left=0.055, right=0.985, top=0.80, bottom=0.26, wspace=0.12)
        largest = np.max([table.max(axis=1) for table in study.along.values()], axis=0)
        shown = [int(i) for i in np.flatnonzero(largest > 0.02)]
        for panel, test in zip(axes, TESTS, strict=True):
            for i in shown:
                name = result.factors[i].name
                panel.plot(
                    stretched(study.shares, stroke),
                    study.along[test][i],
                    color=COLOURS[name],
                    linestyle=dashes(name),
                    marker="o",
                    markersize=2.0,
                )
            panel.set_title(TITLES[test], loc="left", color=look.FAINT)
            position_axis(panel, stroke)
            panel.set_xlabel("position [% of stroke]")
        axes[0].set_ylim(0.0, 1.05)
        axes[0].set_ylabel("share of the reading's variance")
        key_of_factors(figure, [result.factors[i].name for i in shown], 0.01)
    return figure
