"""Draw the figures of a diagnosis, in the order in which a report shows them.

Here: each test before and after the effects were added (data with both models, and the residuals of both on one scale), and
which model quantity would have to vary with what: empirical curves, not causes. Maps and evidence come from their own modules.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import display_unit
from thermohyd.identify.bench.test_record import is_dynamic
from thermohyd.identify.diagnosis.result import DiagnosisResult, Term, Variation
from thermohyd.identify.diagnosis.where import residual_map
from thermohyd.identify.fitting.result import ChannelFit, FitResult

from . import style as look
from .diagnosis_words import changed, excess, p_words, percent
from .evidence_figures import candidate_figure, evidence_figure, exchange_figure
from .fit_figures import dynamic_figure, test_figures
from .style import READINGS, TITLES, Sweep, condition_legend, draw_residuals, largest_residual, scatter, sweeps_of


LINES = (
    Line2D([], [], color=look.INK, linestyle=":", label="dotted: ideal valve"),
    Line2D([], [], color=look.INK, label="line: final model, with its 95 % band"),
)


def before_after_figure(before: ChannelFit, after: ChannelFit, name: str, run_names: tuple[str, ...] = ()) -> Figure:
    """One channel; `before` and `after` hold the same rows. `name` says what the final model is, in a few words."""
    with look.style():
        figure = Figure(figsize=(10.0, 6.4))
        grid = figure.subplots(2, 2, sharex=True, gridspec_kw={"height_ratios": (1.9, 1.0)})
        figure.subplots_adjust(left=0.075, right=0.985, top=0.90, bottom=0.165, wspace=0.19, hspace=0.19)
        old, new = sweeps_of(before), sweeps_of(after)
        _draw_data(grid[0][0], after, old, new)
        _draw_gap(grid[0][1], after, old, new)
        largest = max(largest_residual(old), largest_residual(new))
        for axes, sweeps, fit, words in ((grid[1][0], old, before, "ideal valve"), (grid[1][1], new, after, name)):
            draw_residuals(axes, sweeps, labelled=sweeps is old, largest=largest)
            axes.set_title(
                f"residuals, {words}: reduced chi-square {excess(fit.reduced_chi2)}", loc="left", color=look.FAINT
            )
        port = f", port {after.channel[-1].upper()}" if after.channel in ("pressure_a", "pressure_b") else ""
        figure.text(0.075, 0.958, f"{TITLES.get(after.test, after.test)}{port}", fontsize=12, fontweight="bold")
        condition_legend(figure, after, run_names, LINES)
    return figure


def _reading(fit: ChannelFit) -> str:
    return READINGS.get(fit.channel, fit.channel)


def _size(fit: ChannelFit) -> float:
    return 3.4 if len(fit.measured) < 600 else 2.2


def _draw_data(axes: Axes, fit: ChannelFit, old: list[Sweep], new: list[Sweep]) -> None:
    for sweep in new:
        scatter(axes, sweep, sweep.measured, _size(fit))
    for former, sweep in zip(old, new, strict=True):
        if sweep.first:
            low, high = sweep.predicted - sweep.band, sweep.predicted + sweep.band
            axes.fill_between(sweep.x, low, high, color=sweep.colour, alpha=0.22, linewidth=0.0)
            axes.plot(former.x, former.predicted, color=sweep.colour, linestyle=":")
        axes.plot(sweep.x, sweep.predicted, color=sweep.colour)
    axes.set_title("bench and both models", loc="left", color=look.FAINT)
    look.label_axes(axes, "", f"{_reading(fit)} [{fit.unit.label}]")


def _draw_gap(axes: Axes, fit: ChannelFit, old: list[Sweep], new: list[Sweep]) -> None:
    """What the bench shows beyond the ideal valve, and what the final model makes of it."""
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8, linestyle=":")
    for former, sweep in zip(old, new, strict=True):
        scatter(axes, sweep, former.measured - former.predicted, _size(fit))
    banded = set()
    for former, sweep in zip(old, new, strict=True):
        added = sweep.predicted - former.predicted
        sort = (sweep.colour, sweep.marker, sweep.upward)
        if sort not in banded:  # one band is enough where repeated sweeps lie on each other
            low, high = added - sweep.band, added + sweep.band
            axes.fill_between(sweep.x, low, high, color=sweep.colour, alpha=0.22, linewidth=0.0)
        banded.add(sort)
        axes.plot(sweep.x, added, color=sweep.colour)
    shown = [former.measured - former.predicted for former in old]
    axes.set_ylim(*look.outer_limits([*shown, *(n.predicted - o.predicted for o, n in zip(old, new, strict=True))]))
    axes.set_title("bench beyond the ideal valve; line: what was added to it", loc="left", color=look.FAINT)
    look.label_axes(axes, "", f"{_reading(fit)} - ideal valve [{fit.unit.label}]")


def same_rows(before: ChannelFit, after: ChannelFit) -> bool:
    """Whether the two fits can be compared row by row."""
    return len(before.measured) == len(after.measured) and bool(np.array_equal(before.position, after.position))


MOST_PANELS = 6
ROW, CURVE, LEARNED = 2.5, "#6b6b6b", "#2f6fb0"


def variation_figure(variations: tuple[Variation, ...]) -> Figure:
    """One panel per variation, the best first, with a band of 95 %."""
    return _panels(
        variations[:MOST_PANELS], "What would have to vary to close the gap (fitted curves, not causes)", _draw
    )


def term_figure(terms: tuple[Term, ...]) -> Figure:
    """One panel per typed term, the best first: what its place is shifted by, over what it goes with, with a band of 95 %."""
    return _panels(terms[:MOST_PANELS], "Where in the circuit, and with what (places, not causes)", _draw_term)


def _panels[T](shown: Sequence[T], title: str, draw: Callable[[Axes, T], None]) -> Figure:
    with look.style():
        columns = min(3, len(shown))
        rows = -(-len(shown) // columns)
        height = rows * ROW + 0.75
        figure = Figure(figsize=(10.0, height))
        grid = figure.subplots(rows, columns, squeeze=False)
        figure.subplots_adjust(
            left=0.085, right=0.985, top=1.0 - 0.85 / height, bottom=0.55 / height, wspace=0.32, hspace=0.60
        )
        for axes, one in zip(grid.flat, shown, strict=False):
            draw(axes, one)
        for axes in list(grid.flat)[len(shown) :]:
            axes.set_axis_off()
        figure.text(0.02, 1.0 - 0.28 / height, title, fontsize=12, fontweight="bold")
    return figure


# Of a term's variable, where it is a column that has a unit of its own.
_AXES = {"m": ("um", 1e6), "Pa": ("bar", 1e-5), "m3/s": ("l/min", 6e4), "Pa/s": ("bar/s", 1e-5), "m/s": ("um/s", 1e6)}
_AXES_IN_MOTION = _AXES | {"m/s": ("mm/s", 1e3)}


def scaled_axes(found: Term) -> tuple[tuple[str, float], tuple[str, float]]:
    """(unit, factor from SI) of a term's variable, and of what its place is shifted by."""
    axes_of = _AXES_IN_MOTION if found.moving else _AXES
    of = lambda name, unit: ("mm", 1e3) if "piston" in name and unit == "m" else axes_of.get(unit, (unit, 1.0))
    shift = ("%", 100.0) if found.place_unit == "1" else of(found.place, found.place_unit)
    return of(found.variable, found.variable_unit), shift


def _draw_term(axes: Axes, found: Term) -> None:
    (x_unit, x_size), (label, scale) = scaled_axes(found)
    closes = f"closes {percent(max(found.gap_closed, 0.0))}" if np.isfinite(found.gap_closed) else ""
    figures = f"{found.law}{f', {closes}' if closes else ''}"
    _draw_curve(
        axes,
        found.place,
        figures,
        found.variable_values * x_size,
        found.curve * scale,
        found.band * scale,
        found.learned,
    )
    axes.set_xlabel(f"{found.variable.replace('_', ' ')}{f' [{x_unit}]' if x_unit != '1' else ''}")
    axes.set_ylabel(f"shift [{label}]")


def _draw(axes: Axes, found: Variation) -> None:
    unit = column_unit(found.variable)
    label, scale = ("%", 100.0) if found.unit in ("1", "dimensionless", "") else _unit(found.unit)
    order = np.argsort(found.variable_values)
    figures = [f"closes {percent(found.gap_closed)}"] if np.isfinite(found.gap_closed) else []
    p = p_words(found.p_value)
    figures += [f"p {p}" if p.startswith("<") else f"p = {p}"] if p else []
    x = unit.of(found.variable_values[order])
    curve, band = found.curve[order] * scale, found.band[order] * scale
    _draw_curve(axes, found.quantity, ", ".join(figures), x, curve, band, found.learned)
    axes.set_xlabel(f"{found.variable.replace('_', ' ')}{f' [{unit.label}]' if unit.label else ''}")
    axes.set_ylabel(f"change [{label}]")


def _draw_curve(
    axes: Axes, what: str, figures: str, x: np.ndarray, curve: np.ndarray, std: np.ndarray, learned: bool
) -> None:
    """A curve with its 95 % band, and above it what it is of."""
    colour, band = LEARNED if learned else CURVE, 1.96 * std
    axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
    axes.fill_between(x, curve - band, curve + band, color=colour, alpha=0.22, linewidth=0.0)
    axes.plot(x, curve, color=colour)
    axes.set_title(
        f"{what.replace('_', ' ')}{' (LEARNED)' if learned else ''}\n{figures}",
        loc="left",
        color=look.INK if learned else look.FAINT,
        fontsize=9,
    )


def _unit(si_unit: str) -> tuple[str, float]:
    unit = display_unit(si_unit)
    return unit.label, unit.factor


def diagnosis_figures(result: DiagnosisResult) -> dict[str, Figure]:
    """{file name without ending: figure}; a model that stayed as it was is drawn once, not before and after."""
    names = {name: test.run_names for name, test in result.record.tests.items()}
    figures = _tests(result, names)
    before, after = (_static(fit) for fit in (result.before, result.after))
    if before.channels:
        figures["residual_map"] = residual_map(before, after if comparable(result) else None, names)
    if result.candidates:
        figures["candidates"] = candidate_figure(result)
    for effect in dict.fromkeys(part.effect for part in result.evidence):
        figures[f"evidence_{effect}"] = evidence_figure([part for part in result.evidence if part.effect == effect])
    exchange = exchange_figure(result)
    if exchange is not None:
        figures["exchange"] = exchange
    if result.terms:
        figures["terms"] = term_figure(result.terms)
    if result.variations:
        figures["variations"] = variation_figure(result.variations)
    return figures


def _static(fit: FitResult) -> FitResult:
    """The channels of static tests, which have a map; a time history shows its residuals itself."""
    return replace(fit, channels=tuple(c for c in fit.channels if not is_dynamic(c.test)))


def comparable(result: DiagnosisResult) -> bool:
    """Whether there are two models to draw, over the same rows."""
    pairs = zip(result.before.channels, result.after.channels, strict=False)
    return (
        changed(result)
        and len(result.before.channels) == len(result.after.channels)
        and all(same_rows(before, after) for before, after in pairs)
    )


def added_words(result: DiagnosisResult) -> str:
    """What the final model is called: "with hysteresis"."""
    added = [effect.name for effect in result.effects]
    added += [f"learned {variation.quantity}" for variation in result.variations if variation.learned]
    added += [f"a learned term, {term.place}" for term in result.terms if term.learned]
    return f"with {added[0]}" if len(added) == 1 else f"with {len(added)} effects"


def _tests(result: DiagnosisResult, run_names: dict[str, tuple[str, ...]]) -> dict[str, Figure]:
    if not comparable(result):
        return test_figures(result.after)
    words = added_words(result)
    figures = {}
    pairs = list(zip(result.before.channels, result.after.channels, strict=True))
    for test in dict.fromkeys(after.test for _, after in pairs if is_dynamic(after.test)):
        own = [pair for pair in pairs if pair[1].test == test]
        figures[test] = dynamic_figure(own, run_names.get(test, ()), (words, "plain model"))
    for before, after in pairs:
        if is_dynamic(after.test):
            continue
        alone = sum(fit.test == before.test for fit in result.before.channels) == 1
        name = before.test if alone else f"{before.test}_{before.channel}"
        figures[name] = before_after_figure(before, after, words, run_names.get(before.test, ()))
    return figures
