"""A picture per parameter: its profile with nested intervals, the covariance's parabola, and the posterior's histogram beneath. No JAX."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.uncertainty.result import KnownParameter, Posterior

from . import style as look


PREFIX = "profile_"
LINE, DRAWS, PARABOLA, RING = "#1f5fa8", "#9fbfdf", "#8a8a8a", "#c9702b"
BEYOND = 1.35  # of the largest rise that an interval stands for: what is above it is not drawn
BINS = 40
ROOM_FOR_WORDS = 1.2  # of the highest bar, where no profile is drawn


def knowledge_figures(result: FitResult) -> dict[str, Figure]:
    """{profile_<parameter>: figure} of every parameter with a profile or draws."""
    known = result.knowledge
    if known is None:
        return {}
    drawn = known.posterior if known.posterior is not None and known.posterior.parameters else None
    with look.style():
        return {
            f"{PREFIX}{name}": _figure(result, row, drawn)
            for name, row in known.rows.items()
            if row.profile is not None or row.posterior is not None
        }


def _figure(result: FitResult, row: KnownParameter, drawn: Posterior | None) -> Figure:
    figure = Figure(figsize=(5.2, 3.3))
    axes = figure.add_axes((0.13, 0.17, 0.84, 0.66))
    unit = result.parameters[row.name].shown
    if row.posterior is not None and drawn is not None:
        _histogram(axes, drawn.draws[:, :, drawn.names.index(row.name)].ravel() * unit.factor, row, unit.factor)
    if row.profile is not None:
        _profile(axes, row, unit.factor)
    axes.set_xlabel(row.name.replace("_", " ") + ("" if unit.label == "-" else f" [{unit.label}]"))
    axes.xaxis.set_major_locator(MaxNLocator(6))
    shape = "" if row.profile is None else f", profile {row.profile.shape}"
    verdict = row.verdict if row.verdict == "identified" else f"{row.verdict} identified"
    figure.text(0.13, 0.935, row.name.replace("_", " "), fontsize=11, fontweight="bold")
    figure.text(0.13, 0.875, f"{verdict}{shape}", fontsize=8.5, color=look.FAINT)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=7, loc="upper center", ncols=2)
    return figure


def _profile(axes: Axes, row: KnownParameter, factor: float) -> None:
    profile = row.profile
    assert profile is not None
    top = BEYOND * profile.rises[-1]
    points = _seen([(p.value, p.rise, p.pressed) for p in profile.points], top)
    x, y = np.array([p[0] for p in points]) * factor, np.array([p[1] for p in points])
    if row.std is not None:
        wide = np.linspace(x.min(), x.max(), 120)
        inner = next((n for n in profile.intervals if n.level == 0.95), profile.intervals[-1])
        rise = profile.rises[profile.intervals.index(inner)]
        half = 0.5 * (row.ci95[1] - row.ci95[0]) * factor if row.ci95 is not None else 0.0
        if half > 0.0:
            axes.plot(
                wide, rise * ((wide - row.value * factor) / half) ** 2, "--", color=PARABOLA, label="from the error bar"
            )
    axes.plot(x, y, "-o", color=LINE, markersize=3.2, label="profile")
    ringed = [(p[0] * factor, p[1]) for p in points if p[2]]
    if ringed:
        axes.plot(
            *zip(*ringed, strict=True),
            "o",
            color=RING,
            markerfacecolor="none",
            markersize=8,
            label="another at its limit",
        )
    for interval, rise in zip(profile.intervals, profile.rises, strict=True):
        axes.plot([interval.low * factor, interval.high * factor], [rise, rise], color=look.INK, linewidth=0.9)
        words = f"{100.0 * interval.level:.0f} %"
        axes.annotate(
            words, (interval.high * factor, rise), xytext=(3, 0), textcoords="offset points", va="center", fontsize=7
        )
        for end, open_ in ((interval.low, interval.open_low), (interval.high, interval.open_high)):
            axes.plot([end * factor], [rise], marker="|" if not open_ else "x", color=look.INK, markersize=6)
    axes.set_ylim(-0.02 * top, top)
    axes.set_ylabel("chi-square above its least")


def _seen(points: list[tuple[float, float, tuple[str, ...]]], top: float) -> list[tuple[float, float, tuple[str, ...]]]:
    """The points below `top` and the first beyond it on either side."""
    low = [i for i, p in enumerate(points) if p[1] <= top]
    return points[max(low[0] - 1, 0) : low[-1] + 2]


def _histogram(axes: Axes, draws: np.ndarray, row: KnownParameter, factor: float) -> None:
    count, edges = np.histogram(draws, bins=BINS)
    top = BEYOND * row.profile.rises[-1] if row.profile is not None else float(count.max())
    height = count / count.max() * (0.9 * top if row.profile is not None else top)
    axes.stairs(height, edges, fill=True, color=DRAWS, alpha=0.6, label="posterior draws")
    if row.profile is None:
        axes.set_ylabel("draws")
        axes.set_ylim(0.0, ROOM_FOR_WORDS * top)
        if row.std:
            std, middle = row.std * factor, row.value * factor
            x = np.linspace(edges[0], edges[-1], 120)
            law = np.exp(-0.5 * ((x - middle) / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
            axes.plot(x, law * count.sum() * (edges[1] - edges[0]), "--", color=PARABOLA, label="from the error bar")
