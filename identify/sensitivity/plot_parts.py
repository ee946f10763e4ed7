"""What the figures of a study share: a colour per factor, axes of position, keys."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .. import plot_style as look
from .factors import FACTORS


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
