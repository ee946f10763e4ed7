"""Figures 3 to 5 of the seed paper: leakage against opening, as bars, and against temperature."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plot_style as look
from .curves import MODELS, SeedCurves
from .leakage_claims import BAR_VISCOSITY, BARS, L_MIN


LINES = {"HM": "-", "THM": (0, (4.0, 2.0))}
BAR_COLOURS = {"HM": "#8a8a8a", "THM": "#b5367a"}
OPENINGS = (0.0, 0.025, 0.05, 0.1)  # of Figure 5


def sheet(title: str, columns: int = 2, ratios: Sequence[float] | None = None) -> tuple[Figure, list[Axes]]:
    """A figure with a heading and panels side by side; to be called inside the house style."""
    figure = Figure(figsize=(10.0, 4.6))
    panels = figure.subplots(1, columns, squeeze=False, gridspec_kw={"width_ratios": ratios} if ratios else None)
    figure.subplots_adjust(left=0.075, right=0.985, top=0.85, bottom=0.23, wspace=0.21)
    figure.text(0.075, 0.94, title, fontsize=12, fontweight="bold")
    return figure, list(panels[0])


def title(axes: Axes, words: str) -> None:
    """What a panel shows, in the house's faint hand."""
    axes.set_title(words, loc="left", color=look.FAINT)


def key(figure: Figure, axes: Axes, columns: int = 7) -> None:
    """One legend below all panels."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=columns, bbox_to_anchor=(0.53, 0.0), handlelength=2.4)


def temperature_label(curves: SeedCurves, index: int) -> str:
    """Such as "28 °C, 100 cSt"."""
    return f"{curves.temperature[index] - 273.15:.0f} °C, {1e6 * curves.viscosity[index]:.0f} cSt"


def model_keys(axes: Axes) -> None:
    """Invisible lines that put HM and THM into the legend."""
    for model in MODELS:
        axes.plot([], [], color=look.INK, linestyle=LINES[model], label=model)


def per_temperature(
    axes: Axes, curves: SeedCurves, drawn: Sequence[int], values: np.ndarray, share: float = 1.0, models: int = 2
) -> None:
    """Curves (2, temperatures, openings) against opening in % of the stroke, up to a share of it; HM solid, THM dashed."""
    inside = np.abs(curves.opening) <= share + 1e-12
    for colour, index in zip(look.temperature_colours(len(drawn)), drawn, strict=True):
        for model in range(models):
            axes.plot(
                100.0 * curves.opening[inside],
                values[model, index, inside],
                color=colour,
                linestyle=LINES[MODELS[model]],
                label=temperature_label(curves, index) if model == 0 else None,
            )
    axes.set_xlim(-100.0 * share, 100.0 * share)


def figure_3(curves: SeedCurves, drawn: Sequence[int]) -> Figure:
    """Leakage against opening at several temperatures, HM and THM."""
    with look.style():
        figure, (left, right) = sheet("Figure 3: leakage against opening, 70 bar")
        leakage = curves.leakage[:, 0] * L_MIN
        per_temperature(left, curves, drawn, leakage, 0.12)
        title(left, "around null")
        look.label_axes(left, "opening [% of stroke]", "leakage [l/min]")
        left.set_ylim(0.0)
        per_temperature(right, curves, drawn, leakage)
        title(right, "whole stroke, logarithmic")
        right.set_yscale("log")
        look.plain_numbers(right.yaxis)
        look.label_axes(right, "opening [% of stroke]", "")
        model_keys(left)
        key(figure, left)
    return figure


def figure_4(curves: SeedCurves) -> Figure:
    """Leakage bars at 0, 2.5 and 5 % opening at 300 cSt; the same at the second supply pressure."""
    at = curves.at_viscosity(BAR_VISCOSITY)
    with look.style():
        figure, panels = sheet(f"Figure 4: leakage at {temperature_label(curves, at)}")
        for supply, axes in enumerate(panels):
            flows = np.array([curves.leakage[:, supply, at, curves.at_opening(share)] for share in BARS]) * L_MIN
            for model, name in enumerate(MODELS):
                place = np.arange(len(BARS)) + 0.38 * (model - 0.5)
                axes.bar(place, flows[:, model], 0.36, color=BAR_COLOURS[name], label=name)
            for i, (hm, thm) in enumerate(flows):
                axes.annotate(
                    f"{100.0 * (thm / hm - 1.0):+.1f} %",
                    (i + 0.19, thm),
                    (0, 3),
                    textcoords="offset points",
                    ha="center",
                )
            axes.set_xticks(range(len(BARS)), [f"{100 * share:g} %" for share in BARS])
            axes.grid(False, axis="x")
            axes.set_ylim(0.0, 1.12 * flows.max())
            title(axes, f"{curves.supply[supply] / 1e5:.0f} bar, THM against HM in %")
            look.label_axes(axes, "opening", "leakage [l/min]" if supply == 0 else "")
        key(figure, panels[0])
    return figure


def figure_5(curves: SeedCurves) -> Figure:
    """Leakage against temperature for several openings."""
    with look.style():
        figure, (left, right) = sheet("Figure 5: leakage against temperature, 70 bar")
        warm = curves.temperature - 273.15
        for colour, share in zip(look.temperature_colours(len(OPENINGS)), OPENINGS, strict=True):
            at = curves.at_opening(share)
            for model, name in enumerate(MODELS):
                label = f"{100 * share:g} % opening" if model == 0 else None
                for axes in (left, right):
                    values = curves.leakage[model, 0, :, at] * L_MIN
                    axes.plot(warm, values, color=colour, linestyle=LINES[name], label=label)
        left.set_ylim(0.0)
        title(left, "linear")
        title(right, "logarithmic")
        right.set_yscale("log")
        look.plain_numbers(right.yaxis)
        look.label_axes(left, "oil temperature [°C]", "leakage [l/min]")
        look.label_axes(right, "oil temperature [°C]", "")
        model_keys(left)
        key(figure, left)
    return figure
