"""Draw a sensitivity study: the curves with their normalised sensitivities, the temperature drifts, and the Sobol indices.

All share a colour per factor, a position axis stretched about null, and one key.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from thermohyd.identify.bench.columns import unit_of_test
from thermohyd.identify.bench.shown_units import BAR, CELSIUS, figure_unit
from thermohyd.identify.report import style as look

from .curves import TESTS
from .drift import CAUSES
from .factors import FACTORS
from .result import SensitivityResult
from .words import OF_DRIFT, SHORT, conditions_in_words, with_unit


# Two tones of seven hues: parameters of the valve in the strong ones, conditions and oil in the pale ones, dashed.
_STRONG = ("#2f6fb0", "#c8553d", "#3a8a4d", "#d99a00", "#7b52a1", "#222222", "#8c6d46")
_PALE = ("#57b6c9", "#e58fb1", "#93b53c", "#f06a1d", "#a9a0e0", "#9a9a9a", "#d0a97a")
COLOURS = dict(zip(FACTORS, (*_STRONG, *_PALE), strict=True))
TITLES = {"leakage": "Leakage", "pressure_gain": "Load pressure (pressure-gain test)", "flow_gain": "Control flow"}
CAUSE_COLOURS = dict(
    zip(
        ("viscosity", "density", "bulk modulus", "heating", "clearance"),
        ("#2f6fb0", "#d99a00", "#93b53c", "#c8553d", "#7b52a1"),
        strict=True,
    )
)


def dashes(name: str) -> str:
    """Solid for the identified parameters and the slot width, dashed for what the bench sets and the oil."""
    return "-" if FACTORS.index(name) < len(_STRONG) else "--"


def sheet(title: str, subtitle: str, width: float, height: float) -> Figure:
    """An empty figure with its title."""
    figure = Figure(figsize=(width, height))
    figure.text(0.02, 1.0 - 0.30 / height, title, fontsize=12, fontweight="bold")
    figure.text(0.02, 1.0 - 0.52 / height, subtitle, fontsize=9, color=look.FAINT)
    return figure


def position_axis(axes: Axes, stroke: float) -> None:
    """A position axis [% of stroke] stretched about null as the square root; data are drawn at `stretched` positions."""
    shares = np.array([-100, -50, -20, -5, 0, 5, 20, 50, 100])
    axes.set_xticks(stretched(shares * 0.01 * stroke, stroke), [f"{s}" for s in shares])
    axes.set_xlim(-1.0, 1.0)
    axes.tick_params(axis="x", labelsize=7.5)


def stretched(position: np.ndarray, stroke: float) -> np.ndarray:
    return np.sign(position) * np.sqrt(np.abs(position) / stroke)


def key_of_factors(figure: Figure, names: Sequence[str], y: float, columns: int = 7) -> None:
    """A legend under the panels."""
    handles = [Line2D([], [], color=COLOURS[name], ls=dashes(name), linewidth=1.8) for name in names]
    figure.legend(handles, list(names), loc="lower center", ncols=columns, bbox_to_anchor=(0.5, y))


def pale(share: float) -> str:
    """White to blue for a share between 0 and 1."""
    red, green, blue = (1.0 + share * (end - 1.0) for end in (0.184, 0.435, 0.690))
    return to_hex((red, green, blue))


SHOWN = 0.02  # factors whose sensitivity never exceeds this share of the largest are left out


def curve_figure(result: SensitivityResult, test: str) -> Figure:
    """The curve, and d ln y/d ln theta over the position at the coldest, the study's own and the hottest temperature."""
    c, s = result.curves, result.subject
    stroke = s.model.valve.stroke
    relative = "the reading" if test == "leakage" else "the curve's largest reading"
    with look.style():
        figure = sheet(
            f"{TITLES[test]}: what moves it",
            f"{s.name}, supply {s.supply_pressure * BAR:.0f} bar. Sensitivities relative to {relative}, per relative change "
            "of the factor; dagger: per tolerance",
            12.0,
            4.6,
        )
        axes = figure.subplots(1, 4, gridspec_kw={"width_ratios": (1.15, 1.0, 1.0, 1.0)})
        figure.subplots_adjust(left=0.06, right=0.985, top=0.80, bottom=0.245, wspace=0.24)
        _draw_curve(axes[0], result, test)
        normalised = c.normalised(test)
        shown = worth_showing(normalised)
        chosen = list(dict.fromkeys((s.temperatures[0], s.temperature, s.temperatures[-1])))
        largest = 1.08 * float(np.abs(normalised[shown]).max())
        for panel, temperature in zip(axes[1:], chosen, strict=False):
            rows = c.rows_at(temperature, s.supply_pressure)
            x = stretched(c.position[rows], stroke)
            for i in shown:
                name = c.factors[i].name
                panel.plot(x, normalised[i, rows], color=COLOURS[name], linestyle=dashes(name), linewidth=1.4)
            panel.set_title(f"sensitivities at {temperature - CELSIUS:.0f} °C", loc="left", color=look.FAINT)
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


def worth_showing(normalised: np.ndarray) -> list[int]:
    """Which factors ever move the curve by more than a share of what the largest does."""
    size = np.abs(normalised).max(axis=1)
    return [int(i) for i in np.flatnonzero(size > SHOWN * size.max())]


def _draw_curve(axes: Axes, result: SensitivityResult, test: str) -> None:
    c, s = result.curves, result.subject
    unit = unit_of_test(test)
    for temperature, colour in zip(s.temperatures, look.temperature_colours(len(s.temperatures)), strict=True):
        rows = c.rows_at(temperature, s.supply_pressure)
        axes.plot(
            stretched(c.position[rows], s.model.valve.stroke),
            c.value[test][rows] * unit.factor,
            color=colour,
            label=f"{temperature - CELSIUS:.0f} °C",
        )
    if test == "leakage":
        axes.set_yscale("log")
        look.plain_numbers(axes.yaxis)
    axes.set_title("the curve", loc="left", color=look.FAINT)
    position_axis(axes, s.model.valve.stroke)
    look.label_axes(axes, "position [% of stroke]", f"{TITLES[test].split(' (')[0].lower()} [{unit.label}]")
    axes.legend(loc="best", fontsize=7.5)


# The others follow one of these: K_QP the flow gain, time constant the loop gain, errors the pressure gain.
DRAWN = (
    "null_leakage",
    "open_leakage",
    "full_flow",
    "null_flow_gain",
    "null_pressure_gain",
    "natural_frequency",
    "damping_ratio",
    "loop_gain",
    "stability_ratio",
)


def drift_figure(result: SensitivityResult) -> Figure:
    """Stacked contributions to d ln(figure)/dT, and the figure itself in grey on its own axis."""
    drifts = [result.drifts[name] for name in DRAWN if name in result.drifts]
    rows = -(-len(drifts) // 3)
    with look.style():
        height = 2.9 * rows + 1.3
        s = result.subject
        figure = sheet(
            "Drift with temperature, and its causes",
            f"{s.name}, supply {s.supply_pressure * BAR:.0f} bar. Areas add up to the drift (black)",
            12.0,
            height,
        )
        grid = figure.subplots(rows, 3, squeeze=False)
        figure.subplots_adjust(
            left=0.055, right=0.945, top=1.0 - 1.0 / height, bottom=0.85 / height, wspace=0.42, hspace=0.36
        )
        for panel, drift in zip(grid.flat, drifts, strict=False):
            t = drift.temperature - CELSIUS
            parts = 100.0 * drift.parts / drift.value
            up, down = np.zeros(len(t)), np.zeros(len(t))
            for cause, part in zip(CAUSES, parts, strict=True):
                above, below = np.maximum(part, 0.0), np.minimum(part, 0.0)
                panel.fill_between(t, up, up + above, color=CAUSE_COLOURS[cause], alpha=0.8, linewidth=0.0)
                panel.fill_between(t, down, down + below, color=CAUSE_COLOURS[cause], alpha=0.8, linewidth=0.0)
                up, down = up + above, down + below
            panel.plot(t, 100.0 * drift.relative, color=look.INK, linewidth=1.6)
            size = max(float(up.max()), float(-down.min()), 0.1)
            panel.set_ylim(min(1.15 * float(down.min()), -0.06 * size), 1.15 * max(float(up.max()), 0.06 * size))
            panel.set_xlim(t[0], t[-1])
            panel.axhline(0.0, color=look.FAINT, linewidth=0.7)
            unit = figure_unit(drift.unit)
            panel.set_title(f"{OF_DRIFT[drift.name]}  (dotted, right: {unit.label or '-'})", loc="left", fontsize=9)
            look.label_axes(panel, "temperature [°C]", "drift [%/K]")
            own = panel.twinx()
            own.plot(t, drift.value * unit.factor, color=look.FAINT, linestyle=":", linewidth=1.6)
            own.set_ylim(0.0, 1.1 * float(np.abs(drift.value * unit.factor).max()))
            own.grid(False)
            own.spines["right"].set_visible(True)
            own.tick_params(axis="y", colors=look.FAINT)
        for panel in list(grid.flat)[len(drifts) :]:
            panel.set_visible(False)
        marks = [Patch(color=CAUSE_COLOURS[cause]) for cause in CAUSES]
        marks += [Line2D([], [], color=look.INK), Line2D([], [], color=look.FAINT, linestyle=":")]
        figure.legend(marks, [*CAUSES, "whole drift", "value (right)"], loc="lower center", ncols=7)
    return figure


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
