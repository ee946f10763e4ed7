"""Figure of the temperature drifts: %/K of each figure over the temperature, and what it consists of."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .. import plot_style as look
from .bench_units import bench_unit
from .drift import CAUSES
from .plot_parts import CAUSE_COLOURS, sheet
from .result import SensitivityResult
from .words import OF_DRIFT


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
            f"{s.name}, supply {s.supply_pressure * 1e-5:.0f} bar. Areas add up to the drift (black)",
            12.0,
            height,
        )
        grid = figure.subplots(rows, 3, squeeze=False)
        figure.subplots_adjust(
            left=0.055, right=0.945, top=1.0 - 1.0 / height, bottom=0.85 / height, wspace=0.42, hspace=0.36
        )
        for panel, drift in zip(grid.flat, drifts, strict=False):
            t = drift.temperature - 273.15
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
            unit = bench_unit(drift.unit)
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
