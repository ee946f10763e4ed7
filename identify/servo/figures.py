"""Draw a servo study: step responses, Bode diagram, and the figures of the loop against temperature."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from thermohyd.control_loop import FrequencyResponse, Margins
from thermohyd.identify.bench.shown_units import BAR, decibel
from thermohyd.identify.report import style as look

from .performance_figures import LINES, WARM, draw_bode
from .study import MODELS, ServoStudy
from .words import conditions_in_words


HERTZ = 1.0 / (2.0 * np.pi)
BELOW, ABOVE = 30.0, 12.0  # how far a Bode diagram reaches beyond the lowest and the highest crossover
FIRST = 2e-3  # s: where the logarithmic time axis begins
TANGENT = 6.0  # K, half of it to either side
FORMULA = "#3a8a4d"


def phase(response: np.ndarray) -> np.ndarray:
    """Degrees, unwrapped from the lowest pulsation on."""
    return np.rad2deg(np.unwrap(np.angle(response), axis=-1))


def _sheet(
    study: ServoStudy, title: str, shape: tuple[int, int], size: tuple[float, float], left: float
) -> tuple[Figure, np.ndarray]:
    figure = Figure(figsize=size)
    panels = figure.subplots(*shape)
    figure.text(left, 0.955, f"{title}: {conditions_in_words(study)}", fontsize=12, fontweight="bold")
    return figure, panels


def step_figure(study: ServoStudy) -> Figure:
    """Piston, spool, pressure and heat after the step, over the logarithm of time; a colour per temperature."""
    with look.style():
        figure, panels = _sheet(study, "Step responses", (2, 2), (10.0, 6.6), 0.075)
        figure.subplots_adjust(left=0.075, right=0.985, top=0.885, bottom=0.165, wspace=0.19, hspace=0.2)
        s, colours = study.subject, look.temperature_colours(len(study.celsius))
        longest = 0.0
        for model, sweep in study.steps.items():
            r = sweep.readings
            curves = (
                100.0 * (np.asarray(r.piston_position) - np.asarray(r.piston_position)[:, :1]) / s.step,
                100.0 * np.asarray(r.spool_position) / s.model.valve.stroke,
                BAR * np.asarray(r.pressure_a),
                np.maximum(np.asarray(r.temperature_a), np.asarray(r.temperature_b)) - sweep.temperature[:, None],
            )
            for axes, curve in zip(panels.flat, curves, strict=True):
                if model == "HM" and axes is panels[1, 1]:
                    continue  # isothermal
                for i, colour in enumerate(colours):
                    label = f"{study.celsius[i]:.0f} °C" if model == "THM" else None
                    axes.plot(
                        r.time[i][1:],
                        curve[i][1:],
                        color=colour,
                        linestyle=LINES["HM" if model == "THM" else "THM"],
                        label=label,
                    )
            longest = max(longest, float(np.max(np.asarray(r.time))))
        titles = ("piston position [% of the step]", "spool position [% of stroke]", "pressure in chamber A [bar]",
                  "warmest chamber over the oil supplied [K]")  # fmt: skip
        for axes, title in zip(panels.flat, titles, strict=True):
            axes.set_xscale("log")
            axes.set_xlim(FIRST, longest)
            look.plain_numbers(axes.xaxis)
            axes.set_title(title, loc="left", color=look.FAINT)
        panels[0, 0].axhline(90.0, color=look.FAINT, linewidth=0.8, linestyle=":", zorder=1)
        for axes in panels[1]:
            axes.set_xlabel("time from the step [s]")
        _models_key(panels[0, 0])
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(
            handles,
            labels,
            loc="lower center",
            ncols=_columns(len(labels)),
            bbox_to_anchor=(0.53, 0.0),
            handlelength=2.4,
        )
    return figure


def shown_pulsations(study: ServoStudy) -> np.ndarray:
    """Which of the pulsations lie about the crossovers."""
    loop, f = study.loops["THM"], study.loops["THM"].figures
    crossings = np.concatenate([np.asarray(f.gain_crossover), np.asarray(f.phase_crossover)])
    known = crossings[np.isfinite(crossings)]
    low, high = (known.min() / BELOW, known.max() * ABOVE) if known.size else (loop.pulsation[0], loop.pulsation[-1])
    return (loop.pulsation >= low) & (loop.pulsation <= high)


def bode_of_study(study: ServoStudy) -> Figure:
    """Open and closed loop of the linearised equations, THM."""
    loop, f = study.loops["THM"], study.loops["THM"].figures
    rows = shown_pulsations(study)
    opened = np.asarray(loop.opened)
    curves = FrequencyResponse(loop.pulsation[rows] * HERTZ, np.abs(opened)[:, rows], phase(opened)[:, rows])
    margins = Margins(
        np.asarray(f.gain_margin), np.where(loop.stable, np.asarray(f.phase_margin), np.nan),
        np.asarray(f.phase_crossover) * HERTZ, np.asarray(f.gain_crossover) * HERTZ,
    )  # fmt: skip
    title = f"Position loop at {study.subject.supply_pressure * BAR:.4g} bar, linearised at rest"
    # An unstable loop has no response to show.
    closed = np.where(loop.stable[:, None], np.abs(loop.closed)[:, rows], np.nan)
    return draw_bode(title, study.subject.temperatures, curves, closed, margins, "frequency [Hz]")


@dataclass(frozen=True)
class _Panel:
    """values and, where there is one, the slope per kelvin and the linear formula's values, by model."""

    title: str
    values: Callable[[ServoStudy, str], np.ndarray]
    slope: Callable[[ServoStudy, str], np.ndarray] | None = None
    formula: Callable[[ServoStudy, str], np.ndarray] | None = None
    large: Callable[[ServoStudy, str], np.ndarray] | None = None
    logarithmic: bool = False
    limit: float | None = None


def _small(study: ServoStudy, model: str, name: str) -> np.ndarray:
    """A small-signal figure; NaN where the loop is unstable, but for its gain margin."""
    values = np.asarray(getattr(study.loops[model].figures, name))
    return values if name == "gain_margin" else np.where(study.loops[model].stable, values, np.nan)


def _drift(study: ServoStudy, model: str, name: str) -> np.ndarray:
    return np.asarray(getattr(study.loops[model].slope, name))


PANELS = (
    _Panel("time to 90 % [ms]", lambda s, m: 1e3 * s.steps[m].figures.time_to_90, logarithmic=True),
    _Panel("settling to 2 % [ms]", lambda s, m: 1e3 * s.steps[m].figures.settling_time, logarithmic=True),
    _Panel("overshoot [%]", lambda s, m: 100.0 * s.steps[m].figures.overshoot),
    _Panel(
        "gain margin [dB]",
        lambda s, m: decibel(_small(s, m, "gain_margin")),
        lambda s, m: 20.0 / np.log(10.0) * _drift(s, m, "gain_margin") / _small(s, m, "gain_margin"),
        lambda s, m: decibel(s.linear[m].gain_margin),
        lambda s, m: decibel(s.large_margin(m)),
        limit=0.0,
    ),
    _Panel(
        "phase margin [°]",
        lambda s, m: _small(s, m, "phase_margin"),
        lambda s, m: _drift(s, m, "phase_margin"),
        lambda s, m: np.where(s.loops[m].stable, s.linear[m].phase_margin, np.nan),
        limit=0.0,
    ),
    _Panel(
        "bandwidth, -3 dB [Hz]",
        lambda s, m: HERTZ * _small(s, m, "bandwidth"),
        lambda s, m: HERTZ * _drift(s, m, "bandwidth"),
        logarithmic=True,
    ),
)


def trend_figure(study: ServoStudy) -> Figure:
    """Six figures against temperature, HM beside THM; short lines: exact derivatives; crosses: the linear formulas."""
    with look.style():
        figure, panels = _sheet(study, "The loop against temperature", (2, 3), (11.0, 6.4), 0.055)
        figure.subplots_adjust(left=0.055, right=0.985, top=0.885, bottom=0.165, wspace=0.2, hspace=0.24)
        for panel, axes in zip(PANELS, panels.flat, strict=True):
            for model in MODELS:
                _draw(axes, panel, study, model)
            axes.set_title(panel.title, loc="left", color=look.FAINT)
            if panel.logarithmic:
                axes.set_yscale("log")
                axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                look.plain_numbers(axes.yaxis)
            if panel.limit is not None:
                axes.axhline(panel.limit, color=look.FAINT, linewidth=0.8, zorder=1)
            if not panel.logarithmic and panel.limit is None:
                axes.set_ylim(0.0, max(1.0, axes.get_ylim()[1]))
        for axes in panels.flat:
            air = 0.05 * float(np.ptp(study.celsius)) + TANGENT
            axes.set_xlim(study.celsius[0] - air, study.celsius[-1] + air)
        for axes in panels[1]:
            axes.set_xlabel(WARM)
        key = panels[1, 0]
        handles, labels = key.get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=5, bbox_to_anchor=(0.52, 0.0), handlelength=2.4)
    return figure


def _draw(axes: Axes, panel: _Panel, study: ServoStudy, model: str) -> None:
    colour = look.temperature_colours(2)[0] if model == "THM" else "#c8553d"
    values = panel.values(study, model)
    label = "THM: the oil keeps its heat" if model == "THM" else "HM: isothermal"
    axes.plot(
        study.celsius, values, "o", color=colour, markersize=3.5, label=label, linestyle="-", linewidth=0.6, alpha=0.95
    )
    if panel.slope is not None:
        slope = panel.slope(study, model)
        ends = np.stack([study.celsius - 0.5 * TANGENT, study.celsius + 0.5 * TANGENT])
        heights = np.stack([values - 0.5 * TANGENT * slope, values + 0.5 * TANGENT * slope])
        axes.plot(ends, heights, color=colour, linewidth=2.2, zorder=3)
        if model == "HM":
            axes.plot([], [], color=look.INK, linewidth=2.2, label="exact derivative with temperature")
    if panel.large is not None:
        axes.plot(study.celsius, panel.large(study, model), color=colour, linestyle=":", linewidth=1.3)
        if model == "HM":
            axes.plot([], [], color=look.INK, linestyle=":", linewidth=1.3, label="left for large motions (GM*)")
    if panel.formula is not None:
        words = "linear formula at null" if model == "HM" else None
        axes.plot(study.celsius, panel.formula(study, model), "x", color=FORMULA, markersize=6, label=words, zorder=4)


def _columns(entries: int) -> int:
    """Of a legend: one row, or two full ones."""
    return entries if entries <= 8 else -(-entries // 2)


def _models_key(axes: Axes) -> None:
    for name, line in (("THM", LINES["HM"]), ("HM", LINES["THM"])):
        axes.plot([], [], color=look.INK, linestyle=line, label=name)
