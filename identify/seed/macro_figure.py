"""Figure of the Eq. 6 macro-model: the curves it draws, what it misses, and its parameters with their error bars."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from matplotlib.figure import Figure

from .. import plot_style as look
from ..macro_fit import TO_SI, MacroFit
from ..macro_variant import TwoTermFit
from .leakage_claims import L_MIN
from .leakage_figures import title


CST, UM = 1e6, 1e6
SYMBOLS = (("$X_0$", "um"), ("$Q_0$", "l/min"), ("$k$", "um/(l/min)"))


def macro_figure(macro: MacroFit, two_terms: Sequence[TwoTermFit], drawn: Sequence[int]) -> Figure:
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
            label = f"{macro.fits[i].temperature - 273.15:.0f} °C, {CST * viscosity[i]:.0f} cSt"
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
