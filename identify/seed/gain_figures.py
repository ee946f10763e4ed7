"""Figures 6 to 8 of the seed paper, its gains, and the effect of heat at two supply pressures."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from .. import plot_style as look
from .curves import MODELS, SeedCurves
from .flow_claims import SMALL, bar_flow_gain
from .leakage_claims import L_MIN, heat_gap
from .leakage_figures import LINES, key, model_keys, per_temperature, sheet, title
from .pressure_claims import OPENINGS, bar_secant, bar_slope


CELSIUS = 273.15
WARM = "oil temperature [°C]"


def figure_6(curves: SeedCurves, nominal_pressure: float) -> Figure:
    """bar K_PX against temperature at 1 and 3 % opening: as slope of the load pressure, and as secant from null."""
    with look.style():
        figure, panels = sheet("Figure 6: non-dimensional pressure gain against temperature, 70 bar")
        ways = ((bar_slope, "slope at the opening"), (bar_secant, "secant from null to the opening"))
        for axes, (way, words) in zip(panels, ways, strict=True):
            for colour, share in zip(look.temperature_colours(len(OPENINGS)), OPENINGS, strict=True):
                for model, gain in zip(MODELS, way(curves, share, nominal_pressure), strict=True):
                    label = f"{100 * share:g} % opening" if model == "HM" else None
                    axes.plot(curves.temperature - CELSIUS, gain, color=colour, linestyle=LINES[model], label=label)
            axes.set_ylim(0.0, 38.0)
            title(axes, words)
        look.label_axes(panels[0], WARM, "$\\bar K_{PX}$ [-]")
        look.label_axes(panels[1], WARM, "")
        model_keys(panels[0])
        key(figure, panels[0])
    return figure


def figure_7(curves: SeedCurves, drawn: Sequence[int]) -> Figure:
    """Flow curves with connected ports at several temperatures, HM and THM."""
    with look.style():
        figure, (left, right) = sheet("Figure 7: flow against opening, ports connected, 70 bar")
        flow = curves.flow[:, 0] * L_MIN
        per_temperature(left, curves, drawn, flow)
        per_temperature(right, curves, drawn, flow, 0.1)
        title(left, "whole stroke")
        title(right, "around null")
        look.label_axes(left, "opening [% of stroke]", "flow [l/min]")
        look.label_axes(right, "opening [% of stroke]", "")
        model_keys(left)
        key(figure, left)
    return figure


def figure_8(curves: SeedCurves, nominal_flow: float) -> Figure:
    """bar K_QX against temperature at a small opening, linear and, with the large openings beside it, logarithmic."""
    with look.style():
        figure, panels = sheet("Figure 8: non-dimensional flow gain against temperature, 70 bar")
        colours = look.temperature_colours(2)
        for axes, shares in zip(panels, ((SMALL,), (SMALL, 1.0)), strict=True):
            for colour, share in zip(colours, shares, strict=False):
                for model, gain in zip(MODELS, bar_flow_gain(curves, share, nominal_flow), strict=True):
                    label = f"{100 * share:g} % opening" if model == "HM" else None
                    axes.plot(curves.temperature - CELSIUS, gain, color=colour, linestyle=LINES[model], label=label)
        panels[0].set_ylim(0.0)
        title(panels[0], "small opening")
        title(panels[1], "small opening and full stroke, logarithmic")
        panels[1].set_yscale("log")
        look.plain_numbers(panels[1].yaxis)
        look.label_axes(panels[0], WARM, "$\\bar K_{QX}$ [-]")
        look.label_axes(panels[1], WARM, "")
        model_keys(panels[1])
        key(figure, panels[1])
    return figure


def heat_figure(curves: SeedCurves) -> Figure:
    """What the heat of throttling changes, THM over HM, at both supply pressures, and how much more at the second."""
    quantities = (
        ("leakage", 0.0, "leakage at null"),
        ("pressure_gain", 0.01, "$K_{PX}$ at 1 %"),
        ("flow_gain", SMALL, "$K_{QX}$ at 1 %"),
    )
    with look.style():
        figure, (left, right) = sheet("Heat of throttling kept in the oil: THM against HM")
        warm = curves.temperature - CELSIUS
        for colour, (name, share, words) in zip(look.temperature_colours(3), quantities, strict=True):
            gaps = [100.0 * heat_gap(curves, name, share, supply) for supply in (0, 1)]
            for gap, line in zip(gaps, ("-", ":"), strict=True):
                left.plot(warm, gap, color=colour, linestyle=line, label=words if line == "-" else None)
            right.plot(warm, gaps[1] / gaps[0], color=colour)
        for supply, line in zip(curves.supply, ("-", ":"), strict=True):
            left.plot([], [], color=look.INK, linestyle=line, label=f"{supply / 1e5:.0f} bar")
        left.axhline(5.0, color=look.FAINT, linewidth=0.8, label="the paper's 5 %")
        left.set_ylim(0.0)
        right.set_ylim(0.0, 4.0)
        right.axhline(3.0, color=look.FAINT, linewidth=0.8)
        title(left, "difference in %")
        title(right, f"difference at {curves.supply[1] / 1e5:.0f} bar over that at {curves.supply[0] / 1e5:.0f} bar")
        look.label_axes(left, WARM, "THM over HM [%]")
        look.label_axes(right, WARM, "")
        key(figure, left)
    return figure
