"""Interactive curves of a page as data: views with panels, traces that can be switched off, and the conditions to choose from.

A page's script (templates/curves.js) draws them; what is written here knows nothing of pixels. Values are in bench units.
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from markupsafe import Markup


Scale = Literal["linear", "log", "symlog", "root"]  # root: stretched about zero, as the square root
DIGITS = 5
MOST_POINTS = 2400  # of a channel: a page stays small, and the caption says that points are left out


@dataclass(frozen=True)
class Axis:
    """The abscissa, or a panel with its ordinate. rules: levels, or ranges (low, high), that are marked; include: values that
    the axis must hold; log: the reader may choose a logarithmic axis; tall: height, relative; names: of rows in place of an
    ordinate, y being the row."""

    label: str
    unit: str = ""
    scale: Scale = "linear"
    ticks: tuple[float, ...] = ()
    rules: tuple[float | tuple[float, float], ...] = ()
    include: tuple[float, ...] = ()
    log: bool = False
    tall: float = 1.0
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layer:
    """A kind of trace that the reader switches on and off. colour: of the palette, -1: ink, None: that of its condition.

    kind: "interval" goes from x to x2, "bar" from zero to x, both on rows; "band" from y to y2.
    """

    name: str
    kind: Literal["points", "line", "band", "bar", "interval"]
    dash: Literal["line", "dash", "dot", "mix"] = "line"
    colour: int | None = None
    shown: bool = True
    hollow: bool = False
    wide: bool = False
    faint: bool = False


@dataclass(frozen=True)
class Draw:
    """One trace of a series. words: what to say of each point in place of its value; plain: the panel's name is not said."""

    layer: int
    y: np.ndarray | Sequence[float]
    panel: int = 0
    y2: np.ndarray | Sequence[float] | None = None
    x2: np.ndarray | Sequence[float] | None = None
    words: Sequence[str] | None = None
    plain: bool = False


@dataclass(frozen=True)
class Series:
    """Traces over one abscissa, under the same conditions. at: for each of a view's conditions, which of its values."""

    at: tuple[int, ...]
    x: np.ndarray | Sequence[float]
    draw: tuple[Draw, ...]


@dataclass(frozen=True)
class Condition:
    """What a reader may choose from; `on`: values that are shown at first, all where it is empty."""

    name: str
    values: tuple[str, ...]
    on: tuple[int, ...] = ()


@dataclass(frozen=True)
class View:
    """One picture. colour, mark, hollow: which of the conditions says colour, shape, and filled or hollow points.

    palette: "warm" goes from cold to hot, "kind" tells apart.
    """

    title: str
    x: Axis
    panels: tuple[Axis, ...]
    layers: tuple[Layer, ...]
    series: tuple[Series, ...]
    conditions: tuple[Condition, ...] = ()
    colour: int | None = None
    mark: int | None = None
    hollow: int | None = None
    palette: Literal["warm", "kind"] = "kind"
    note: str = ""


def views_json(views: Iterable[View]) -> Markup:
    """As the page holds them: JSON in which nothing can end the element that it stands in, whatever users call their valves."""
    text = json.dumps([_view(view) for view in views], separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _view(view: View) -> dict[str, Any]:
    count = 1 + max((series.at[view.colour] for series in view.series), default=0) if view.colour is not None else 0
    content: dict[str, Any] = {
        "title": view.title,
        "x": _axis(view.x),
        "panels": [_axis(panel) for panel in view.panels],
        "layers": [_layer(layer) for layer in view.layers],
        "facets": [_condition(condition) for condition in view.conditions],
        "colour": view.colour,
        "mark": view.mark,
        "hollow": view.hollow,
        "palette": palette_name(view.palette, count),
        "series": [
            {"at": list(series.at), "x": _numbers(series.x), "draw": [_draw(draw) for draw in series.draw]}
            for series in view.series
        ],
    }
    return {**content, **({"note": view.note} if view.note else {})}


def _axis(axis: Axis) -> dict[str, Any]:
    kept = {"label": axis.label, "unit": "" if axis.unit in ("-", "1") else axis.unit, "scale": axis.scale}
    more = {
        "ticks": list(axis.ticks), "rules": [list(r) if isinstance(r, tuple) else r for r in axis.rules], "log": axis.log,
        "include": list(axis.include), "names": list(axis.names), "tall": axis.tall if axis.tall != 1.0 else None,
    }  # fmt: skip
    return kept | {key: value for key, value in more.items() if value}


def _layer(layer: Layer) -> dict[str, Any]:
    kept: dict[str, Any] = {"name": layer.name, "kind": layer.kind, "dash": layer.dash, "shown": layer.shown}
    kept |= {key: True for key in ("hollow", "wide", "faint") if getattr(layer, key)}
    return kept | ({} if layer.colour is None else {"colour": layer.colour})


def _condition(condition: Condition) -> dict[str, Any]:
    kept = {"name": condition.name, "values": list(condition.values)}
    return kept | ({"on": list(condition.on)} if condition.on else {})


def _draw(draw: Draw) -> dict[str, Any]:
    kept: dict[str, Any] = {"layer": draw.layer, "panel": draw.panel, "y": _numbers(draw.y)}
    kept |= {key: _numbers(value) for key in ("y2", "x2") if (value := getattr(draw, key)) is not None}
    return kept | ({} if draw.words is None else {"words": list(draw.words)}) | ({"plain": True} if draw.plain else {})


def _numbers(values: np.ndarray | Sequence[float]) -> list[float | int | None]:
    return [_number(value) for value in np.asarray(values, dtype=float).tolist()]


def _number(value: float) -> float | int | None:
    if not math.isfinite(value):
        return None
    short = float(f"{value:.{DIGITS}g}")
    return int(short) if short.is_integer() and abs(short) < 1e6 else short


def every(rows: int, most: int = MOST_POINTS) -> int:
    """Which one of the rows is drawn, so that they are not more than `most`."""
    return max(1, -(-rows // most))


def left_out(step: int) -> str:
    """What a caption says where only some of the points are drawn."""
    return "" if step == 1 else f"One reading in {step} is drawn; the pictures and the files hold all of them."


# ---- colours ----
# Each has two: on white and on a dark page, with a contrast of at least 3 to 1 there. Those that tell apart stay apart for
# colour-blind readers (tests/identify/report/test_palette.py), beside dashes and shapes that say the same.
KIND = {
    "light": ("#001dc5", "#e73e00", "#1ba46d", "#b04a90", "#5e300e", "#9c56ff", "#3d3d3d"),
    "dark": ("#0fd4ff", "#c24100", "#00906e", "#a2479a", "#f9ac5b", "#965edf", "#c8c8c8"),
}
MOST_WARM = 12


def warm_colours(count: int, dark: bool) -> list[str]:
    """From cold to hot on a perceptually even map, without the end that the page swallows."""
    import matplotlib as mpl
    from matplotlib.colors import to_hex

    low, high = (0.42, 0.93) if dark else (0.03, 0.62)
    places = np.linspace(low, high, count) if count > 1 else [0.5 * (low + high)]
    return [to_hex(mpl.colormaps["plasma"](float(place))) for place in places]


def palette_name(kind: str, count: int) -> str:
    """The beginning of its colours' names in the style sheet: "--kind0", "--warm4-0"."""
    return "kind" if kind == "kind" else f"warm{min(max(count, 1), MOST_WARM)}-"


def palette_css(dark: bool) -> str:
    """The style sheet's colours: those of `KIND`, and those from cold to hot for each count of them."""
    theme = KIND["dark" if dark else "light"]
    named = {f"--kind{i}": theme[i % len(theme)] for i in range(2 * len(theme))}
    for count in range(1, MOST_WARM + 1):
        named |= {f"--warm{count}-{i}": colour for i, colour in enumerate(warm_colours(count, dark))}
    return " ".join(f"{name}: {colour};" for name, colour in named.items())
