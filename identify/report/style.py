"""How every figure looks: sizes, colours and markers in one place, and a channel's rows sorted into sweeps that show their conditions.

Colour, marker and fill say temperature, supply pressure and direction. No pyplot: no global state.
"""

import io
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from thermohyd.identify.bench.shown_units import BAR, CELSIUS, UM
from thermohyd.identify.fitting.result import ChannelFit


DPI = 130
MARKERS = ("o", "s", "D", "^", "v", "P", "X")
INK, GRID, FAINT = "#222222", "#e3e3e3", "#8a8a8a"
MOST_GROUPS = len(MARKERS)

# Held only while a figure is made and written, never set globally. A fixed salt makes the same SVG from the same data.
STYLE: dict[Any, Any] = {
    "text.usetex": False,  # a matplotlibrc in the working folder, which Matplotlib reads, would start LaTeX on a text of its own
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titley": 1.0,  # else every drawing searches for a place: a fifth of its time
    "axes.labelsize": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "thermohyd",
}


def style() -> AbstractContextManager[None]:
    """A context manager: the house style while it lasts."""
    return mpl.rc_context(STYLE)


def temperature_colours(count: int) -> list[str]:
    """Colours from cold to hot on a perceptually even map that survives grey printing, without its palest end."""
    places = np.linspace(0.05, 0.80, count) if count > 1 else [0.2]
    return [to_hex(mpl.colormaps["plasma"](float(place))) for place in places]


def group(values: np.ndarray, closeness: float) -> tuple[np.ndarray, list[float]]:
    """Sort conditions into a few groups: (index of each value's group, mean of each group).

    Values whose neighbours lie within `closeness` share a group; where that leaves too many, equal ranges do.
    """
    order = np.sort(values)
    edges = (0.5 * (order[1:] + order[:-1]))[np.diff(order) > closeness]
    if len(edges) >= MOST_GROUPS:
        edges = np.linspace(order[0], order[-1], MOST_GROUPS + 1)[1:-1]
    index = np.searchsorted(edges, values)
    used = np.unique(index)
    return np.searchsorted(used, index), [float(values[index == i].mean()) for i in used]


def png(figure: Figure) -> bytes:
    """The figure as PNG."""
    buffer = io.BytesIO()
    figure.set_dpi(DPI)  # writing an SVG leaves another behind
    FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": "thermohyd"}, pil_kwargs={"compress_level": 4})
    return buffer.getvalue()


def svg(figure: Figure) -> bytes:
    """The figure as SVG, with text as paths and no date, so that it looks and compares the same everywhere."""
    buffer = io.BytesIO()
    figure.set_dpi(DPI)  # of the points that are drawn as a picture inside it
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": "thermohyd"})
    return buffer.getvalue()


def drawn(figures: Mapping[str, Figure]) -> tuple[dict[str, bytes], dict[str, bytes | str]]:
    """({name: SVG}, {file name: content}, an SVG and a PNG per figure)."""
    with style():
        vectors = {name: svg(figure) for name, figure in figures.items()}
        files: dict[str, bytes | str] = {f"{name}.svg": drawing for name, drawing in vectors.items()}
        files |= {f"{name}.png": png(figure) for name, figure in figures.items()}
    return vectors, files


def plain_numbers(axis: Axis) -> None:
    """Write 0.1, 1, 10 on a logarithmic axis, not powers of ten."""
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def symmetric_logarithmic(axes: Axes, largest: float, linear: float) -> None:
    """A y axis from -largest to largest, linear near zero, with few plain labels that cannot overlap."""
    axes.set_yscale("symlog", linthresh=linear)
    decades = [10.0**k for k in range(1, 12) if linear < 10.0**k <= largest]
    ticks = [sign * decade for sign in (-1.0, 1.0) for decade in decades[:: 1 + len(decades) // 3]]
    axes.set_yticks(sorted([0.0, *ticks]))
    plain_numbers(axes.yaxis)


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Both labels at once; empty ones are left out."""
    if x:
        axes.set_xlabel(x)
    if y:
        axes.set_ylabel(y)


def outer_limits(values: Sequence[np.ndarray]) -> tuple[float, float]:
    """Limits that hold all finite values with a little air."""
    flat = np.concatenate([np.ravel(v) for v in values])
    flat = flat[np.isfinite(flat)]
    low, high = (float(flat.min()), float(flat.max())) if flat.size else (0.0, 1.0)
    air = 0.05 * (high - low) or 1.0
    return low - air, high + air


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
    return group(fit.temperature - CELSIUS, 4.0)


def pressure_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float]]:
    """(group of each row, bar of supply pressure of each group)."""
    bar = fit.supply_pressure * BAR
    return group(bar, max(4.0, 0.06 * float(bar.max())))


def colour_groups(fit: ChannelFit) -> tuple[np.ndarray, list[float], bool]:
    """(group of each row, what each group stands for, whether that is a run): degC, or the runs at one temperature."""
    group, temperatures = temperature_groups(fit)
    runs, of_run = np.unique(fit.run, return_inverse=True)
    if len(temperatures) == 1 and 1 < len(runs) <= MOST_GROUPS:
        return of_run.reshape(-1), [float(run) for run in runs], True
    return group, temperatures, False


def sweeps_of(fit: ChannelFit) -> list[Sweep]:
    """Every sweep of a channel, thinned where the eye cannot tell."""
    unit = fit.unit.factor
    t_group, shown, _ = colour_groups(fit)
    p_group, _ = pressure_groups(fit)
    colours = temperature_colours(len(shown))
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
                x=fit.position[rows] * UM,
                measured=fit.measured[rows] * unit,
                predicted=fit.predicted[rows] * unit,
                band=1.96 * fit.predicted_std[rows] * unit,
                residual=(fit.measured[rows] - fit.predicted[rows]) / fit.std[rows],
                colour=colours[key[0]],
                marker=MARKERS[key[1] % len(MARKERS)],
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
    axes.axhspan(-1.96, 1.96, color=GRID, alpha=0.7, linewidth=0.0)
    axes.axhline(0.0, color=FAINT, linewidth=0.8)
    for sweep in sweeps:
        scatter(axes, sweep, sweep.residual, 2.0)
    largest = largest_residual(sweeps) if largest is None else largest
    if largest > 30.0:  # a model that misses badly: keep the small residuals readable beside the large
        symmetric_logarithmic(axes, largest, linear=5.0)
    axes.set_ylim(-1.1 * max(largest, 3.0), 1.1 * max(largest, 3.0))
    label_axes(axes, "spool position [um]", "residual / noise" if labelled else "")


def largest_residual(sweeps: list[Sweep]) -> float:
    """The largest residual of all sweeps in units of the noise."""
    return max(float(np.abs(sweep.residual).max()) for sweep in sweeps)


def condition_legend(
    figure: Figure, fit: ChannelFit, run_names: Sequence[str] = (), lines: Sequence[Line2D] = ()
) -> None:
    """Two lines below a figure: what colours and markers stand for, then the `lines` and the directions."""
    _, shown, by_run = colour_groups(fit)
    _, pressures = pressure_groups(fit)
    colours = temperature_colours(len(shown))

    def dot(marker: str, face: str, words: str) -> Line2D:
        return Line2D([], [], linestyle="none", marker=marker, color=INK, markerfacecolor=face, label=words)

    conditions = [
        Line2D([], [], color=colour, linewidth=3.0, label=run_label(round(x), run_names) if by_run else f"{x:.0f} degC")
        for colour, x in zip(colours, shown, strict=True)
    ]
    conditions += [dot(m, INK, f"{bar:.0f} bar") for m, bar in zip(MARKERS, pressures, strict=False)]
    signs = [*lines] or [Line2D([], [], color=INK, label="line: model, with its 95 % band")]
    if np.any(fit.direction < 0) and np.any(fit.direction > 0):
        signs += [dot("o", INK, "filled: position rising"), dot("o", "white", "open: position falling")]
    for height, handles in ((0.045, conditions), (0.008, signs)):
        figure.legend(
            handles=handles, loc="lower left", ncols=len(handles), bbox_to_anchor=(0.065, height), borderpad=0.0
        )


def run_label(run: int, names: Sequence[str]) -> str:
    """What a run is called, cut to a length that figures can hold."""
    return f"run {names[run][:LONGEST_NAME] if run < len(names) else run}"
