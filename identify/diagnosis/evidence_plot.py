"""Figure of where the evidence for a named effect sits: over the position, by temperature and sweep direction."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .. import plot_style as look
from .diagnosis_content import percent, reading_words
from .result import Evidence


BINS = 48
MOST_PANELS = 4  # a channel that holds less than the four largest is left out
ROW = 2.3  # inches
# What the rows of a dynamic test are drawn over.
AXES = {"step": "time [s]", "frequency": "frequency [Hz]"}


def evidence_figure(parts: list[Evidence]) -> Figure:
    """All channels of one effect; each panel says which share of the effect's z its rows hold."""
    total = sum(float(part.contribution.sum()) for part in parts)
    chosen = sorted(parts, key=lambda part: -abs(float(part.contribution.sum())))[:MOST_PANELS]
    celsius, means = look.group(np.concatenate([part.temperature for part in chosen]) - 273.15, 4.0)
    colours = look.temperature_colours(len(means))
    with look.style():
        columns = min(2, len(chosen))
        rows = -(-len(chosen) // columns)
        height = rows * ROW + 1.25
        figure = Figure(figsize=(10.0, height))
        grid = figure.subplots(rows, columns, squeeze=False)
        figure.subplots_adjust(
            left=0.075, right=0.985, top=1.0 - 0.62 / height, bottom=0.85 / height, wspace=0.17, hspace=0.42
        )
        start = 0
        for axes, part in zip(grid.flat, chosen, strict=False):
            stop = start + len(part.position)
            _draw(axes, part, celsius[start:stop], colours)
            share = float(part.contribution.sum()) / total if total else 0.0
            axes.set_title(
                f"{reading_words(part.test, part.channel)}: {percent(share)} of the evidence",
                loc="left",
                color=look.FAINT,
            )
            axes.set_xlabel(AXES.get(part.test, "spool position [um]"))
            start = stop
        for axes in list(grid.flat)[len(chosen) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("contribution to z")
        figure.text(
            0.075,
            1.0 - 0.28 / height,
            f"Where the evidence for {parts[0].effect} sits (z = {total:+.1f})",
            fontsize=12,
            fontweight="bold",
        )
        _legend(figure, colours, means, height, swept=any(part.test not in AXES for part in chosen))
    return figure


def _draw(axes: Axes, part: Evidence, group: np.ndarray, colours: list[str]) -> None:
    """Sums over bins of the position, one step line per temperature and direction."""
    position = part.position * (1.0 if part.test in AXES else 1e6)
    bins = max(4, min(BINS, len(position) // 4))
    edges = np.linspace(position.min(), position.max() + 1e-9, bins + 1)
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
    for index, colour in enumerate(colours):
        for rising in (True, False):
            rows = (group == index) & ((part.direction > 0) == rising)
            if rows.any():
                sums, _ = np.histogram(position[rows], edges, weights=part.contribution[rows])
                solid = rising or part.test in AXES
                axes.stairs(sums, edges, color=colour, linestyle="-" if solid else "--", linewidth=1.1)


def _legend(figure: Figure, colours: list[str], means: list[float], height: float, *, swept: bool) -> None:
    handles = [
        Line2D([], [], color=colour, linewidth=3.0, label=f"{mean:.0f} degC")
        for colour, mean in zip(colours, means, strict=True)
    ]
    if swept:
        handles += [
            Line2D([], [], color=look.INK, label="position rising"),
            Line2D([], [], color=look.INK, linestyle="--", label="position falling"),
        ]
    figure.legend(
        handles=handles, loc="lower left", ncols=len(handles), bbox_to_anchor=(0.065, 0.06 / height), borderpad=0.0
    )
