"""What the wall takes of the heat, and from which measurement that can be told: two figures."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import plot_style as look


if TYPE_CHECKING:
    from thermohyd.heat_information import EtaIdentifiability
    from thermohyd.wall_tests import HeatStudy


CELSIUS = 273.15
NAMES = {"leakage": "leakage test", "pressure_gain": "pressure-gain test", "flow_gain": "flow-gain test"}
MOST_TEMPERATURES = 6
LARGEST_ERROR = 1e3  # of eta, drawn: eta lies between 0 and 1


def _title(axes: Axes, words: str) -> None:
    axes.set_title(words, loc="left", color=look.FAINT)


def _spread(count: int, most: int = MOST_TEMPERATURES) -> list[int]:
    """At most `most` indices, ends included."""
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, most)).round()})


def heat_study_figure(
    study: "HeatStudy", heading: str = "Heat exchange with the wall: from no contact to perfect contact"
) -> Figure:
    """eta, and leakage, pressure gain and flow gain relative to the isothermal model, against h_w A_w.

    Ticks at the left edge are the adiabatic model (THM); the line at 0 % is the isothermal one (HM).
    """
    conductance = study.wall_conductance
    drawn = _spread(study.temperature.size)
    with look.style():
        figure = Figure(figsize=(10.0, 7.0))
        panels = figure.subplots(2, 2, sharex=True)
        figure.subplots_adjust(left=0.085, right=0.985, top=0.88, bottom=0.15, wspace=0.2, hspace=0.22)
        figure.text(0.085, 0.95, heading, fontsize=12, fontweight="bold")
        fields = ("leakage_flow", "pressure_gain", "flow_gain")
        titles = ("leakage", "pressure gain $K_{PX}$", "flow gain $K_{QX}$")
        for colour, i in zip(look.temperature_colours(len(drawn)), drawn, strict=True):
            label = f"{study.temperature[i] - CELSIUS:.0f} °C"
            panels[0, 0].plot(conductance, study.between.eta[:, i], color=colour, label=label)
            for axes, field in zip(panels.ravel()[1:], fields, strict=True):
                hm = getattr(study.hm, field)[i]
                axes.plot(conductance, 100.0 * (getattr(study.between, field)[:, i] / hm - 1.0), color=colour)
                thm = 100.0 * (getattr(study.thm, field)[i] / hm - 1.0)
                axes.plot([0.0, 0.03], [thm, thm], color=colour, linewidth=3.0, transform=axes.get_yaxis_transform())
        _title(panels[0, 0], "share of the heat kept in the ports, $\\eta=\\exp(-NTU)$")
        for axes, words in zip(panels.ravel()[1:], titles, strict=True):
            _title(axes, f"{words}, above the isothermal model [%]")
            axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
        for axes in panels.ravel():
            axes.set_xscale("log")
            look.plain_numbers(axes.xaxis)
            axes.set_xlim(conductance.min(), conductance.max())
        for axes in panels[1]:
            look.label_axes(axes, "$h_w A_w$ of one port [W/K]", "")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=len(drawn), bbox_to_anchor=(0.53, 0.02))
        figure.text(0.985, 0.025, "thick marks: adiabatic model", ha="right", color=look.FAINT, fontsize=8)
    return figure


def identifiability_figure(
    found: "EtaIdentifiability", heading: str = "From which measurement can eta be told?"
) -> Figure:
    """Above: what one unit of eta changes at each position, in units of noise. Below: standard error of eta by temperature.

    One column per test, the highest supply pressure above, every supply pressure below; solid with the six parameters
    unknown, dashed with them known. Errors above 1 say that the sweep does not tell eta at all.
    """
    tests, top = len(found.tests), int(np.argmax(found.supply_pressure))
    drawn, pressures = _spread(found.temperature.size), _spread(found.supply_pressure.size, 3)
    celsius = found.temperature - CELSIUS
    with look.style():
        figure = Figure(figsize=(11.0, 7.2))
        panels = figure.subplots(2, tests, squeeze=False)
        figure.subplots_adjust(left=0.075, right=0.985, top=0.87, bottom=0.15, wspace=0.2, hspace=0.42)
        figure.text(0.075, 0.95, heading, fontsize=12, fontweight="bold")
        for column, name in enumerate(found.tests):
            upper, lower = panels[:, column]
            for colour, i in zip(look.temperature_colours(len(drawn)), drawn, strict=True):
                upper.plot(
                    1e6 * found.position, found.slope[column, top, i], color=colour, label=f"{celsius[i]:.0f} °C"
                )
            _title(upper, f"{NAMES[name]}, {found.supply_pressure[top] / 1e5:.0f} bar")
            look.label_axes(upper, "opening [µm]", "change per unit of $\\eta$ [noise]" if column == 0 else "")
            for marker, j in zip(look.MARKERS, pressures, strict=False):
                words = f"{found.supply_pressure[j] / 1e5:.0f} bar"
                for errors, line, kind in ((found.free, "-", "unknown"), (found.held, "--", "known")):
                    value = np.clip(errors[column, j], None, LARGEST_ERROR)
                    lower.plot(
                        celsius,
                        value,
                        line,
                        color=look.INK,
                        marker=marker,
                        markersize=4.0,
                        label=f"{words}, six {kind}",
                    )
            lower.axhline(1.0, color=look.FAINT, linewidth=0.8)
            lower.set_yscale("log")
            look.label_axes(lower, "oil temperature [°C]", "standard error of $\\eta$" if column == 0 else "")
        low = min(axes.get_ylim()[0] for axes in panels[1])
        high = max(axes.get_ylim()[1] for axes in panels[1])
        for axes in panels[1]:
            axes.set_ylim(low, high)
            look.plain_numbers(axes.yaxis)
        panels[0, 0].legend(loc="upper right")
        handles, labels = panels[1, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=6, bbox_to_anchor=(0.53, 0.015))
    return figure
