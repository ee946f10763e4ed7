"""The rows of a channel sorted into sweeps, and how figures draw them: colour, marker and fill say the conditions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from . import plot_style as look
from .display_units import reading_unit
from .fit_result import ChannelFit


TITLES = {
    "leakage": "Leakage, blocked ports",
    "pressure_gain": "Pressure gain, blocked ports",
    "flow_gain": "Flow gain, connected ports",
    "load_flow": "Load flow",
}
READINGS = {
    "leakage_flow": "leakage",
    "flow": "flow",
    "load_pressure": "load pressure",
    "pressure_a": "pressure A",
    "pressure_b": "pressure B",
}
# More points than this are thinned evenly for the picture: the eye cannot tell, and the files stay small.
MOST_POINTS = 4000
LONGEST_NAME = 14


@dataclass(frozen=True)
class Sweep:
    """The rows of a channel under one temperature, supply pressure, run and direction, in bench units."""

    rows: np.ndarray  # of the channel, sorted by position
    x: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    band: np.ndarray
    residual: np.ndarray
    colour: str
    marker: str
    upward: bool
    first: bool  # of its temperature and supply pressure: one band is enough where many sweeps lie on each other


def temperature_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float]]:
    """(group of each row, degC of each group)."""
    return look.group(fit.temperature - 273.15, 4.0)


def pressure_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float]]:
    """(group of each row, bar of supply pressure of each group)."""
    bar = fit.supply_pressure * 1e-5
    return look.group(bar, max(4.0, 0.06 * float(bar.max())))


def colour_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float], bool]:
    """(group of each row, what each group stands for, whether that is a run): degC, or the runs at one temperature."""
    group, temperatures = temperature_groups(fit)
    runs, of_run = np.unique(fit.run, return_inverse=True)
    if len(temperatures) == 1 and 1 < len(runs) <= look.MOST_GROUPS:
        return of_run.reshape(-1), [float(run) for run in runs], True
    return group, temperatures, False


def sweeps_of(fit: ChannelFit) -> list[Sweep]:
    """Every sweep of a channel, thinned where the eye cannot tell."""
    unit = reading_unit(fit.channel).factor
    t_group, shown, _ = colour_groups(fit)
    p_group, _ = pressure_groups(fit)
    colours = look.temperature_colours(len(shown))
    step = -(-len(fit.measured) // MOST_POINTS)
    sweeps = []
    banded: set[tuple[int, int]] = set()
    keys = np.stack([t_group, p_group, fit.run, np.sign(fit.direction)], axis=1).astype(int)
    for key in np.unique(keys, axis=0):
        condition = (int(key[0]), int(key[1]))
        rows = np.flatnonzero((keys == key).all(axis=1))
        rows = rows[np.argsort(fit.position[rows], kind="stable")][::step]
        sweeps.append(
            Sweep(
                rows=rows,
                x=fit.position[rows] * 1e6,
                measured=fit.measured[rows] * unit,
                predicted=fit.predicted[rows] * unit,
                band=1.96 * fit.predicted_std[rows] * unit,
                residual=(fit.measured[rows] - fit.predicted[rows]) / fit.std[rows],
                colour=colours[key[0]],
                marker=look.MARKERS[key[1] % len(look.MARKERS)],
                upward=bool(key[3] >= 0),
                first=condition not in banded,
            )
        )
        banded.add(condition)
    return sweeps


def scatter(axes: Axes, sweep: Sweep, y: np.ndarray, size: float) -> None:
    """One point per row of a sweep."""
    # scatters become a picture inside the SVG: thousands of vector markers make it slow to open
    axes.plot(
        sweep.x,
        y,
        linestyle="none",
        marker=sweep.marker,
        markersize=size,
        markeredgewidth=0.7,
        markeredgecolor=sweep.colour,
        markerfacecolor=sweep.colour if sweep.upward else "white",
        alpha=0.75,
        rasterized=True,
    )


def draw_residuals(axes: Axes, sweeps: list[Sweep], labelled: bool, largest: float | None = None) -> None:
    """Residuals in units of the noise; `largest`: what the axis must hold, where panels share a scale."""
    axes.axhspan(-1.96, 1.96, color=look.GRID, alpha=0.7, linewidth=0.0)
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
    for sweep in sweeps:
        scatter(axes, sweep, sweep.residual, 2.0)
    largest = largest_residual(sweeps) if largest is None else largest
    if largest > 30.0:  # a model that misses badly: keep the small residuals readable beside the large
        look.symmetric_logarithmic(axes, largest, linear=5.0)
    axes.set_ylim(-1.1 * max(largest, 3.0), 1.1 * max(largest, 3.0))
    look.label_axes(axes, "spool position [um]", "residual / noise" if labelled else "")


def largest_residual(sweeps: list[Sweep]) -> float:
    """The largest residual of all sweeps in units of the noise."""
    return max(float(np.abs(sweep.residual).max()) for sweep in sweeps)


def condition_legend(
    figure: Figure, fit: ChannelFit, run_names: Sequence[str] = (), lines: Sequence[Line2D] = ()
) -> None:
    """Two lines below a figure: what colours and markers stand for, then the `lines` and the directions."""
    _, shown, by_run = colour_groups(fit)
    _, pressures = pressure_groups(fit)
    colours = look.temperature_colours(len(shown))

    def dot(marker: str, face: str, words: str) -> Line2D:
        return Line2D([], [], linestyle="none", marker=marker, color=look.INK, markerfacecolor=face, label=words)

    conditions = [
        Line2D([], [], color=colour, linewidth=3.0, label=run_label(round(x), run_names) if by_run else f"{x:.0f} degC")
        for colour, x in zip(colours, shown, strict=True)
    ]
    conditions += [dot(m, look.INK, f"{bar:.0f} bar") for m, bar in zip(look.MARKERS, pressures, strict=False)]
    signs = [*lines] or [Line2D([], [], color=look.INK, label="line: model, with its 95 % band")]
    if np.any(fit.direction < 0) and np.any(fit.direction > 0):
        signs += [dot("o", look.INK, "filled: position rising"), dot("o", "white", "open: position falling")]
    for height, handles in ((0.045, conditions), (0.008, signs)):
        figure.legend(
            handles=handles, loc="lower left", ncols=len(handles), bbox_to_anchor=(0.065, height), borderpad=0.0
        )


def run_label(run: int, names: Sequence[str]) -> str:
    """What a run is called, cut to a length that figures can hold."""
    return f"run {names[run][:LONGEST_NAME] if run < len(names) else run}"
