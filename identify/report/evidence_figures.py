"""Draw where the evidence for effects lies: of a named effect along the sweeps, of the whole library, and on held-out rows.

The first is over the position, by temperature and direction; the last is the exchange test.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thermohyd.identify.bench.shown_units import CELSIUS, UM, effect_unit
from thermohyd.identify.bench.test_record import kind_of_test
from thermohyd.identify.diagnosis.result import Candidate, DiagnosisResult, Evidence

from . import style as look
from .diagnosis_words import percent, reading_words, with_unit


BINS = 48
MOST_PANELS = 4  # a channel that holds less than the four largest is left out
ROW = 2.3  # inches
# What the rows of a dynamic test are drawn over.
AXES = {"step": "time [s]", "frequency": "frequency [Hz]"}


def evidence_figure(parts: list[Evidence]) -> Figure:
    """All channels of one effect; each panel says which share of the effect's z its rows hold."""
    total = sum(float(part.contribution.sum()) for part in parts)
    chosen = sorted(parts, key=lambda part: -abs(float(part.contribution.sum())))[:MOST_PANELS]
    celsius, means = look.group(np.concatenate([part.temperature for part in chosen]) - CELSIUS, 4.0)
    colours = look.temperature_colours(len(means))
    with look.style():
        columns = min(2, len(chosen))
        rows = -(-len(chosen) // columns)
        height = rows * ROW + 1.25
        figure = Figure(figsize=(10.0, height))
        grid = figure.subplots(rows, columns, squeeze=False)
        figure.subplots_adjust(
            left=0.075, right=0.985, top=1.0 - 0.62 / height, bottom=0.85 / height, wspace=0.17, hspace=0.42
        )
        start = 0
        for axes, part in zip(grid.flat, chosen, strict=False):
            stop = start + len(part.position)
            _draw(axes, part, celsius[start:stop], colours)
            share = float(part.contribution.sum()) / total if total else 0.0
            axes.set_title(
                f"{reading_words(part.test, part.channel)}: {percent(share)} of the evidence",
                loc="left",
                color=look.FAINT,
            )
            axes.set_xlabel(AXES.get(kind_of_test(part.test), "spool position [um]"))
            start = stop
        for axes in list(grid.flat)[len(chosen) :]:
            axes.set_axis_off()
        for axes in grid[:, 0]:
            axes.set_ylabel("contribution to z")
        figure.text(
            0.075,
            1.0 - 0.28 / height,
            f"Where the evidence for {parts[0].effect} sits (z = {total:+.1f})",
            fontsize=12,
            fontweight="bold",
        )
        _legend(figure, colours, means, height, swept=any(kind_of_test(part.test) not in AXES for part in chosen))
    return figure


def _draw(axes: Axes, part: Evidence, group: np.ndarray, colours: list[str]) -> None:
    """Sums over bins of the position, one step line per temperature and direction."""
    position = part.position * (1.0 if kind_of_test(part.test) in AXES else UM)
    bins = max(4, min(BINS, len(position) // 4))
    edges = np.linspace(position.min(), position.max() + 1e-9, bins + 1)
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
    for index, colour in enumerate(colours):
        for rising in (True, False):
            rows = (group == index) & ((part.direction > 0) == rising)
            if rows.any():
                sums, _ = np.histogram(position[rows], edges, weights=part.contribution[rows])
                solid = rising or kind_of_test(part.test) in AXES
                axes.stairs(sums, edges, color=colour, linestyle="-" if solid else "--", linewidth=1.1)


def _legend(figure: Figure, colours: list[str], means: list[float], height: float, *, swept: bool) -> None:
    handles = [
        Line2D([], [], color=colour, linewidth=3.0, label=f"{mean:.0f} degC")
        for colour, mean in zip(colours, means, strict=True)
    ]
    if swept:
        handles += [
            Line2D([], [], color=look.INK, label="position rising"),
            Line2D([], [], color=look.INK, linestyle="--", label="position falling"),
        ]
    figure.legend(
        handles=handles, loc="lower left", ncols=len(handles), bbox_to_anchor=(0.065, 0.06 / height), borderpad=0.0
    )


NAMED, RIVAL, OTHER, BLIND = "#2f6fb0", "#d99a00", "#9fb3c8", "#d6d6d6"
BAR = 0.235  # inches


def candidate_figure(result: DiagnosisResult) -> Figure:
    """|z| of each effect beside the ideal valve, before anything was added, the largest first."""
    named = {effect.name for effect in result.effects}
    rivals = {rival.name for effect in result.effects for rival in effect.alternatives}
    shown = sorted(
        (c for c in result.candidates if math.isfinite(c.z)), key=lambda c: (c.state != "testable", -abs(c.z))
    )
    with look.style():
        height = max(6, len(shown)) * BAR + 1.2
        figure = Figure(figsize=(10.0, height))
        axes = figure.add_axes((0.18, 0.62 / height, 0.44, 1.0 - 1.2 / height))
        for row, c in enumerate(shown):
            colour = (
                BLIND
                if c.state != "testable" or _wrong_sign(c)
                else NAMED
                if c.name in named
                else RIVAL
                if c.name in rivals
                else OTHER
            )
            axes.barh(row, abs(c.z), color=colour, height=0.72)
            weight = "bold" if c.name in named else "normal"
            axes.annotate(
                _words(c, named, rivals),
                (1.015, row),
                xycoords=("axes fraction", "data"),
                va="center",
                fontsize=8,
                weight=weight,
            )
        _finish(axes, result, shown)
        axes.annotate("amount of this effect alone", (1.015, -1.05), xycoords=("axes fraction", "data"), fontsize=8)
        figure.text(0.02, 1.0 - 0.28 / height, "Evidence for each effect", fontsize=12, fontweight="bold")
    return figure


def _wrong_sign(c: Candidate) -> bool:
    """Whether the data ask for an amount that the effect cannot have."""
    return bool(c.state == "testable" and c.estimate == 0.0 and abs(c.z) > 1.0)


def _words(c: Candidate, named: set[str], rivals: set[str]) -> str:
    if c.state != "testable":
        return "absorbed: the free parameters swallow it" if c.state == "absorbed" else "not testable here"
    if _wrong_sign(c):
        return "would need the sign that it cannot have"
    words = ["NAMED"] if c.name in named else ["rival"] if c.name in rivals else []
    estimate = with_unit(c.estimate, effect_unit(c.name, c.unit))
    words += [estimate] if estimate else []
    words += [f"alone closes {percent(c.gap_closed)}"] if math.isfinite(c.gap_closed) else []
    return ", ".join(words)


def _finish(axes: Axes, result: DiagnosisResult, shown: list[Candidate]) -> None:
    largest = max((abs(c.z) for c in shown), default=1.0)
    level = result.critical_level
    if level is not None and math.isfinite(level):
        axes.axvline(level, color=look.INK, linewidth=0.9, linestyle="--")
        axes.annotate(
            f"must pass {level:.1f}",
            (level, 1.0),
            xycoords=("data", "axes fraction"),
            fontsize=8,
            ha="center",
            va="bottom",
        )
        largest = max(largest, level)
    if largest > 40.0:
        axes.set_xscale("symlog", linthresh=10.0)
        axes.set_xticks([t for t in (0.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 1000.0, 1e4, 1e5) if t <= 1.2 * largest])
        look.plain_numbers(axes.xaxis)
    axes.set_xlim(0.0, 1.08 * largest)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_yticks(range(len(shown)), [c.name for c in shown])
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"evidence |z| in units of the noise, each effect alone beside the {result.plain_model}")


def exchange_figure(result: DiagnosisResult) -> Figure | None:
    """How much of the gap on held-out rows the named effects close, and others in their place; None without them."""
    held = result.held_out
    if held is None or not result.effects or not held.exchange:
        return None
    bars = [(" + ".join(effect.name for effect in result.effects), held.gap_closed, NAMED)]
    bars += [(f"instead: {name}", share, OTHER) for name, share in held.exchange.items()]
    bars = [bar for bar in bars if math.isfinite(bar[1])]
    with look.style():
        height = len(bars) * 1.3 * BAR + 1.25
        figure = Figure(figsize=(10.0, height))
        axes = figure.add_axes((0.34, 0.62 / height, 0.55, 1.0 - 1.25 / height))
        for row, (_, share, colour) in enumerate(bars):
            axes.barh(row, 100.0 * share, color=colour, height=0.7)
            axes.annotate(f" {percent(share)}", (max(100.0 * share, 0.0), row), va="center", fontsize=8)
        axes.set_yticks(range(len(bars)), [name for name, _, _ in bars])
        axes.set_ylim(len(bars) - 0.4, -0.6)
        low = max(
            -40.0, min(0.0, *(105.0 * share for _, share, _ in bars))
        )  # one that makes it worse says so in figures
        axes.set_xlim(low, max(100.0, *(108.0 * s for _, s, _ in bars)))
        axes.axvline(0.0, color=look.FAINT, linewidth=0.8)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(f"share of the gap closed on the {held.rows:,} rows that took no part [%]")
        figure.text(0.02, 1.0 - 0.28 / height, "Exchange test", fontsize=12, fontweight="bold")
    return figure
