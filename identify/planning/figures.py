"""Draw a plan: the least visible amounts beside the usual ones, and which effects look alike."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.report import style as look

from .result import PlannedEffect, PlanResult


USUAL, SEEN, ALONE, HIDDEN = "#d3dae2", "#2f6fb0", "#d99a00", "#b3341f"
ROW = 0.235  # inches
LOWEST, HIGHEST = 1e-3, 8.0  # of the largest usual amount
CELL = 0.3  # inches
STRONG = 0.5  # cosine from which on a cell says its number


def plan_figures(result: PlanResult) -> dict[str, Figure]:
    """{file name without ending: figure}, in the order in which the page shows them."""
    found = {"least": least_figure(result)}
    if len(result.order) > 1:
        found["confusion"] = confusion_figure(result)
    return found


def least_figure(result: PlanResult) -> Figure:
    """Amounts over the largest usual one: usual ones as bars, the least that is found, and from where on it is told from all others."""
    shown = [effect for effect in result.effects if effect.least is not None]
    with look.style():
        height = max(len(shown), 4) * ROW + 1.4
        figure = Figure(figsize=(10.0, height))
        axes = figure.add_axes((0.2, 0.82 / height, 0.5, 1.0 - 1.4 / height))
        axes.set_xscale("log")
        axes.set_xlim(LOWEST, HIGHEST)
        axes.axvline(1.0, color=look.FAINT, linewidth=0.9, linestyle="--")
        for place, effect in enumerate(shown):
            _draw(axes, place, effect)
        axes.set_ylim(max(len(shown), 4) - 0.4, -0.6)
        axes.set_yticks(range(len(shown)), [effect.name for effect in shown])
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        look.plain_numbers(axes.xaxis)
        axes.set_xlabel("amount over the largest usual one")
        figure.text(0.02, 1.0 - 0.3 / height, "What the planned tests will find", fontsize=12, fontweight="bold")
        handles = [
            Patch(color=USUAL, label="usual amounts"),
            Line2D(
                [],
                [],
                color=SEEN,
                marker="o",
                linestyle="none",
                label=f"found in {100.0 * result.power:.0f} % of records",
            ),
            Line2D([], [], color=ALONE, marker="D", linestyle="none", label="told from all others"),
            Line2D([], [], color=HIDDEN, marker="o", linestyle="none", label="found only beyond what is usual"),
        ]
        figure.legend(handles=handles, loc="lower left", ncols=4, bbox_to_anchor=(0.19, 0.02), borderpad=0.0)
    return figure


def _draw(axes: Axes, place: int, effect: PlannedEffect) -> None:
    assert effect.least is not None
    most, least = effect.usual[1], effect.least / effect.usual[1]
    axes.barh(place, 1.0 - effect.usual[0] / most, left=effect.usual[0] / most, color=USUAL, height=0.6)
    at = float(np.clip(least, LOWEST, HIGHEST))
    axes.plot(
        (at,), (place,), marker="o" if least >= LOWEST else "<", color=SEEN if effect.seen else HIDDEN, markersize=5.0
    )
    if effect.alone is not None:
        axes.plot((min(effect.alone / most, HIGHEST),), (place,), marker="D", color=ALONE, markersize=4.0, zorder=1.5)
    unit = effect.shown
    words = f"from {significant(effect.least * unit.factor, 2)}{'' if unit.label in ('', '-') else f' {unit.label}'}"
    axes.annotate(words, (1.02, place), xycoords=("axes fraction", "data"), va="center", fontsize=8)


def confusion_figure(result: PlanResult) -> Figure:
    """Cosines of what the parameters leave of every two effects, those that look alike beside each other."""
    order = _beside_each_other(np.abs(result.correlation))
    names = [result.order[i] for i in order]
    cosine = np.abs(result.correlation[np.ix_(order, order)])
    count = len(names)
    with look.style():
        size = max(count, 6) * CELL
        figure = Figure(figsize=(size + 3.2, size + 2.9))
        width, height = figure.get_size_inches()
        axes = figure.add_axes((2.1 / width, 0.35 / height, size / width, size / height))
        image = axes.imshow(cosine, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        axes.set_xticks(range(count), names, rotation=90)
        axes.set_yticks(range(count), names)
        axes.xaxis.tick_top()
        axes.tick_params(length=0)
        axes.grid(visible=False)
        for i in range(count):
            for j in range(count):
                if i != j and cosine[i, j] >= STRONG:
                    colour = "white" if cosine[i, j] > 0.7 else look.INK
                    axes.text(
                        j,
                        i,
                        f"{cosine[i, j]:.2f}".removeprefix("0"),
                        ha="center",
                        va="center",
                        fontsize=6,
                        color=colour,
                    )
        bar = figure.add_axes(((2.25 + size) / width, 0.35 / height, 0.16 / width, size / height))
        figure.colorbar(image, cax=bar)
        bar.set_title("cosine", fontsize=8)
        figure.text(0.02, 1.0 - 0.3 / height, "Which effects look alike", fontsize=12, fontweight="bold")
    return figure


def _beside_each_other(cosine: np.ndarray) -> list[int]:
    """An order in which each effect stands beside the one that it looks like most among those left."""
    left, order = list(range(len(cosine))), []
    at = int(np.argmax(cosine.sum(axis=0)))
    while True:
        order.append(at)
        left.remove(at)
        if not left:
            return order
        at = max(left, key=lambda i: cosine[at, i])
