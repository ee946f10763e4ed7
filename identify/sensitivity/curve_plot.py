"""Figures of the curves: one per test, the curve at each temperature and its normalised sensitivities at three of them."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import plot_style as look
from .bench_units import OF_TEST
from .plot_parts import COLOURS, TITLES, dashes, key_of_factors, position_axis, sheet, stretched
from .result import SensitivityResult


SHOWN = 0.02  # factors whose sensitivity never exceeds this share of the largest are left out


def curve_figure(result: SensitivityResult, test: str) -> Figure:
    """The curve, and d ln y/d ln theta over the position at the coldest, the study's own and the hottest temperature."""
    c, s = result.curves, result.subject
    stroke = s.model.valve.stroke
    relative = "the reading" if test == "leakage" else "the curve's largest reading"
    with look.style():
        figure = sheet(
            f"{TITLES[test]}: what moves it",
            f"{s.name}, supply {s.supply_pressure * 1e-5:.0f} bar. Sensitivities relative to {relative}, per relative change "
            "of the factor; dagger: per tolerance",
            12.0,
            4.6,
        )
        axes = figure.subplots(1, 4, gridspec_kw={"width_ratios": (1.15, 1.0, 1.0, 1.0)})
        figure.subplots_adjust(left=0.06, right=0.985, top=0.80, bottom=0.245, wspace=0.24)
        _draw_curve(axes[0], result, test)
        normalised = c.normalised(test)
        shown = _worth_showing(normalised)
        chosen = list(dict.fromkeys((s.temperatures[0], s.temperature, s.temperatures[-1])))
        largest = 1.08 * float(np.abs(normalised[shown]).max())
        for panel, temperature in zip(axes[1:], chosen, strict=False):
            rows = c.rows_at(temperature, s.supply_pressure)
            x = stretched(c.position[rows], stroke)
            for i in shown:
                name = c.factors[i].name
                panel.plot(x, normalised[i, rows], color=COLOURS[name], linestyle=dashes(name), linewidth=1.4)
            panel.set_title(f"sensitivities at {temperature - 273.15:.0f} °C", loc="left", color=look.FAINT)
            panel.axhline(0.0, color=look.FAINT, linewidth=0.7)
            panel.set_ylim(-largest, largest)
            position_axis(panel, stroke)
            panel.set_xlabel("position [% of stroke]")
        for panel in axes[1 + len(chosen) :]:
            panel.set_visible(False)
        names = [c.factors[i].name for i in shown]
        key_of_factors(figure, names, 0.01)
        for text, i in zip(figure.legends[0].get_texts(), shown, strict=True):
            text.set_text(c.factors[i].name + ("" if c.factors[i].relative else " †"))
    return figure


def _worth_showing(normalised: np.ndarray) -> list[int]:
    size = np.abs(normalised).max(axis=1)
    return [int(i) for i in np.flatnonzero(size > SHOWN * size.max())]


def _draw_curve(axes: Axes, result: SensitivityResult, test: str) -> None:
    c, s = result.curves, result.subject
    unit = OF_TEST[test]
    for temperature, colour in zip(s.temperatures, look.temperature_colours(len(s.temperatures)), strict=True):
        rows = c.rows_at(temperature, s.supply_pressure)
        axes.plot(
            stretched(c.position[rows], s.model.valve.stroke),
            c.value[test][rows] * unit.factor,
            color=colour,
            label=f"{temperature - 273.15:.0f} °C",
        )
    if test == "leakage":
        axes.set_yscale("log")
        look.plain_numbers(axes.yaxis)
    axes.set_title("the curve", loc="left", color=look.FAINT)
    position_axis(axes, s.model.valve.stroke)
    look.label_axes(axes, "position [% of stroke]", f"{TITLES[test].split(' (')[0].lower()} [{unit.label}]")
    axes.legend(loc="best", fontsize=7.5)
