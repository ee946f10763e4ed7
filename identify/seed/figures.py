"""Draw the seed paper's Figures 3 to 8, its gains, the effect of heat at two supply pressures, and the Eq. 6 macro-model."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thermohyd.identify.bench.shown_units import CELSIUS, CST, L_MIN
from thermohyd.identify.flow_curve_fit import TO_SI, FlowCurveFit, TwoTermFit
from thermohyd.identify.report import style as look

from .blocked_port_claims import BAR_VISCOSITY, BARS, PRESSURE_OPENINGS, bar_secant, bar_slope, heat_gap
from .curves import MODELS, SeedCurves
from .flow_claims import SMALL, bar_flow_gain


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
    return f"{curves.temperature[index] - CELSIUS:.0f} °C, {CST * curves.viscosity[index]:.0f} cSt"


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
        warm = curves.temperature - CELSIUS
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


WARM = "oil temperature [°C]"


def figure_6(curves: SeedCurves, nominal_pressure: float) -> Figure:
    """bar K_PX against temperature at 1 and 3 % opening: as slope of the load pressure, and as secant from null."""
    with look.style():
        figure, panels = sheet("Figure 6: non-dimensional pressure gain against temperature, 70 bar")
        ways = ((bar_slope, "slope at the opening"), (bar_secant, "secant from null to the opening"))
        for axes, (way, words) in zip(panels, ways, strict=True):
            for colour, share in zip(look.temperature_colours(len(PRESSURE_OPENINGS)), PRESSURE_OPENINGS, strict=True):
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


SYMBOLS = (("$X_0$", "um"), ("$Q_0$", "l/min"), ("$k$", "um/(l/min)"))


def macro_figure(macro: FlowCurveFit, two_terms: Sequence[TwoTermFit], drawn: Sequence[int]) -> Figure:
    """Above: flow curves with Eq. 6 over them, and the largest error of the opening by viscosity. Below: X0, Q0 and k."""
    with look.style():
        figure = Figure(figsize=(10.0, 7.4))
        figure.text(0.075, 0.955, "Eq. 6: X = X₀ tanh(Q/Q₀) + k Q, HM, 70 bar", fontsize=12, fontweight="bold")
        grid = figure.add_gridspec(2, 6, left=0.075, right=0.985, top=0.90, bottom=0.13, hspace=0.36, wspace=1.5)
        viscosity = np.array([fit.viscosity for fit in macro.fits])
        axes = figure.add_subplot(grid[0, :3])
        fine = np.linspace(-1.0, 1.0, 801)
        law = eqx.filter_jit(macro.model.position)  # op by op it would compile twenty small programs
        for colour, i in zip(look.temperature_colours(len(drawn)), drawn, strict=True):
            curve = macro.flow[i] * L_MIN
            axes.plot(curve[::8], 100.0 * macro.position[::8] / macro.stroke, ".", color=colour, markersize=3.5)
            flow = fine * np.abs(macro.flow[i]).max()
            opening = np.asarray(law(flow, viscosity[i : i + 1]))
            label = f"{macro.fits[i].temperature - CELSIUS:.0f} °C, {CST * viscosity[i]:.0f} cSt"
            axes.plot(flow * L_MIN, 100.0 * opening / macro.stroke, color=colour, label=label)
        title(axes, "points: full model; lines: smooth laws")
        look.label_axes(axes, "flow [l/min]", "opening [% of stroke]")
        axes = figure.add_subplot(grid[0, 3:])
        for values, line, words in (
            ([fit.worst for fit in macro.fits], "-", "each temperature alone"),
            ([fit.smooth_worst for fit in macro.fits], "--", "smooth laws"),
            ([fit.worst for fit in two_terms], ":", "a second tanh term, alone"),
        ):
            axes.plot(
                CST * viscosity, 100.0 * np.array(values) / macro.stroke, color=look.INK, linestyle=line, label=words
            )
        axes.set_xscale("log")
        look.plain_numbers(axes.xaxis)
        axes.set_ylim(0.0)
        axes.legend(loc="upper left")
        title(axes, "largest error of the opening")
        look.label_axes(axes, "kinematic viscosity [cSt]", "% of stroke")
        smooth = np.array(eqx.filter_jit(macro.model.parameters)(np.geomspace(viscosity.min(), viscosity.max(), 200)))
        for column, (symbol, unit) in enumerate(SYMBOLS):
            axes = figure.add_subplot(grid[1, 2 * column : 2 * column + 2])
            values, std = np.array([(f.values[column], f.std[column]) for f in macro.fits]).T / TO_SI[column]
            axes.errorbar(CST * viscosity, values, std, fmt="o", color=look.INK, markersize=3.5, elinewidth=0.8)
            axes.plot(
                CST * np.geomspace(viscosity.min(), viscosity.max(), 200),
                smooth[column] / TO_SI[column],
                color="#b5367a",
            )
            axes.set_xscale("log")
            look.plain_numbers(axes.xaxis)
            if values.max() > 15.0 * values.min():
                axes.set_yscale("log")
                look.plain_numbers(axes.yaxis)
            else:
                axes.set_ylim(0.0)
            title(axes, f"{symbol} [{unit}]")
            look.label_axes(axes, "kinematic viscosity [cSt]", "")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=6, bbox_to_anchor=(0.53, 0.005))
    return figure
