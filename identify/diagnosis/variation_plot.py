"""Figure of the second tier: which model quantity would have to vary with what. Empirical curves, not causes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plot_style as look
from ..display_units import display_unit
from .condition_words import condition_unit
from .diagnosis_content import p_words, percent
from .result import Variation


MOST_PANELS = 6
ROW, CURVE, LEARNED = 2.5, "#6b6b6b", "#2f6fb0"


def variation_figure(variations: tuple[Variation, ...]) -> Figure:
    """One panel per variation, the best first, with a band of 95 %."""
    shown = variations[:MOST_PANELS]
    with look.style():
        columns = min(3, len(shown))
        rows = -(-len(shown) // columns)
        height = rows * ROW + 0.75
        figure = Figure(figsize=(10.0, height))
        grid = figure.subplots(rows, columns, squeeze=False)
        figure.subplots_adjust(
            left=0.085, right=0.985, top=1.0 - 0.85 / height, bottom=0.55 / height, wspace=0.32, hspace=0.60
        )
        for axes, variation in zip(grid.flat, shown, strict=False):
            _draw(axes, variation)
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
        figure.text(
            0.02,
            1.0 - 0.28 / height,
            "What would have to vary to close the gap (fitted curves, not causes)",
            fontsize=12,
            fontweight="bold",
        )
    return figure


def _draw(axes: Axes, found: Variation) -> None:
    unit, factor, offset = condition_unit(found.variable)
    label, scale = ("%", 100.0) if found.unit in ("1", "dimensionless", "") else _unit(found.unit)
    order = np.argsort(found.variable_values)
    x = found.variable_values[order] * factor + offset
    y, band = found.curve[order] * scale, 1.96 * found.band[order] * scale
    colour = LEARNED if found.learned else CURVE
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
    axes.fill_between(x, y - band, y + band, color=colour, alpha=0.22, linewidth=0.0)
    axes.plot(x, y, color=colour)
    figures = [f"closes {percent(found.gap_closed)}"] if np.isfinite(found.gap_closed) else []
    p = p_words(found.p_value)
    figures += [f"p {p}" if p.startswith("<") else f"p = {p}"] if p else []
    axes.set_title(
        f"{found.quantity.replace('_', ' ')}{' (LEARNED)' if found.learned else ''}\n{', '.join(figures)}",
        loc="left",
        color=look.INK if found.learned else look.FAINT,
        fontsize=9,
    )
    axes.set_xlabel(f"{found.variable.replace('_', ' ')}{f' [{unit}]' if unit else ''}")
    axes.set_ylabel(f"change [{label}]")


def _unit(si_unit: str) -> tuple[str, float]:
    unit = display_unit(si_unit)
    return unit.label, unit.factor
