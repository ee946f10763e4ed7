"""How every figure of the project looks: sizes, colours and markers in one place. No pyplot: no global state."""

import io
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter


DPI = 130
MARKERS = ("o", "s", "D", "^", "v", "P", "X")
INK, GRID, FAINT = "#222222", "#e3e3e3", "#8a8a8a"
MOST_GROUPS = len(MARKERS)

# Held only while a figure is made and written, never set globally. A fixed salt makes the same SVG from the same data.
STYLE: dict[Any, Any] = {
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
