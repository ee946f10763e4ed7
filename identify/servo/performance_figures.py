"""Draw an actuator's performance: Bode plots of its loop at several temperatures, and its figures against temperature."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import Performance, performance
from thermohyd.control_loop import FrequencyResponse, Margins, loop_frequency_response, loop_margins
from thermohyd.identify.bench.shown_units import CELSIUS, UM, decibel
from thermohyd.identify.report import style as look
from thermohyd.valve import Valve


MODELS = {"HM": 0.0, "THM": 1.0}
LINES = {"HM": "-", "THM": (0, (4.0, 2.0))}
WARM = "oil temperature [°C]"
PULSATIONS = 400  # a curve's points


def bode_figure(
    valve: Valve,
    actuator: Actuator,
    *,
    temperatures: Sequence[float],
    supply_pressure: float,
    heat: float | None = None,
) -> Figure:
    """Open loop (magnitude, phase) and closed loop (magnitude) at temperatures [K], spool dynamics included.

    The margins stand in the key; a dot marks where each is read. supply_pressure in Pa; heat: see `performance`.
    """
    found = performance(
        valve, actuator, temperature=jnp.asarray(temperatures), supply_pressure=supply_pressure, heat=heat
    )
    margins = loop_margins(found, actuator)
    low = float(np.min(np.asarray(found.loop_gain))) / 30.0
    grid = np.geomspace(low, 10.0 * float(np.max(np.asarray(found.natural_frequency))), PULSATIONS)
    # A lightly damped resonance is narrower than any even grid.
    around = np.outer(np.asarray(found.natural_frequency), 1.0 + np.linspace(-0.1, 0.1, 101)).ravel()
    pulsation = np.sort(np.concatenate([grid, around]))
    opened = loop_frequency_response(found, actuator, pulsation)
    closed = loop_frequency_response(found, actuator, pulsation, closed=True)
    return draw_bode(
        f"Position loop at {supply_pressure / 1e5:.0f} bar", temperatures, opened, closed.magnitude, margins
    )


def draw_bode(
    title: str,
    temperatures: Sequence[float],
    opened: FrequencyResponse,
    closed: np.ndarray,
    margins: Margins,
    axis: str = "pulsation [rad/s]",
) -> Figure:
    """The figure of open-loop curves, the closed loop's magnitudes (temperatures, pulsations) and margins at temperatures [K].

    A phase margin of NaN: the loop is unstable. axis: what the abscissa is called; pulsations and crossovers come in its unit.
    """
    pulsation = opened.pulsation
    with look.style():
        figure = Figure(figsize=(10.0, 6.2))
        grid_spec = figure.add_gridspec(2, 2)
        gain = figure.add_subplot(grid_spec[0, 0])
        phase = figure.add_subplot(grid_spec[1, 0], sharex=gain)
        shut = figure.add_subplot(grid_spec[:, 1])
        figure.subplots_adjust(left=0.075, right=0.985, top=0.87, bottom=0.18, wspace=0.2, hspace=0.13)
        figure.text(0.075, 0.945, title, fontsize=12, fontweight="bold")
        for i, colour in enumerate(look.temperature_colours(len(temperatures))):
            kelvin = temperatures[i] - CELSIUS
            angle = "unstable" if np.isnan(margins.phase_margin[i]) else f"{margins.phase_margin[i]:.0f}°"
            words = f"{kelvin:.0f} °C: {decibel(margins.gain_margin[i]):.1f} dB, {angle}"
            gain.plot(pulsation, decibel(opened.magnitude[i]), color=colour, label=words)
            phase.plot(pulsation, opened.phase[i], color=colour)
            shut.plot(pulsation, decibel(closed[i]), color=colour)
            at, across = margins.phase_crossover[i], margins.gain_crossover[i]
            gain.plot(at, -decibel(margins.gain_margin[i]), "o", color=colour, markersize=4)
            phase.plot(across, margins.phase_margin[i] - 180.0, "o", color=colour, markersize=4)
        for axes, level in ((gain, 0.0), (phase, -180.0), (shut, 0.0)):
            axes.set_xscale("log")
            axes.axhline(level, color=look.FAINT, linewidth=0.8, zorder=1)
        gain.set_xlim(pulsation[0], pulsation[-1])
        shut.set_xlim(pulsation[0], pulsation[-1])
        gain.tick_params(labelbottom=False)
        phase.set_yticks(range(-450, -89, 90))
        shut.set_ylim(-60.0, max(10.0, float(np.max(decibel(closed), initial=0.0, where=np.isfinite(closed))) + 3.0))
        gain.set_title("open loop", loc="left", color=look.FAINT)
        shut.set_title("closed loop, position over setpoint", loc="left", color=look.FAINT)
        look.label_axes(gain, "", "magnitude [dB]")
        look.label_axes(phase, axis, "phase [°]")
        look.label_axes(shut, axis, "magnitude [dB]")
        handles, labels = gain.get_legend_handles_labels()
        figure.legend(
            handles,
            labels,
            title="oil temperature: gain margin, phase margin",
            loc="lower center",
            ncols=min(5, -(-len(labels) // (1 + (len(labels) > 5)))),
            bbox_to_anchor=(0.53, 0.0),
        )
    return figure


@dataclass(frozen=True)
class _Panel:
    title: str
    label: str
    values: Callable[[Performance, Margins, Actuator], np.ndarray]
    logarithmic: bool = False
    limit: float | None = None


PANELS = (
    _Panel("natural frequency", "$\\omega_h$ [rad/s]", lambda p, m, a: np.asarray(p.natural_frequency)),
    _Panel("damping ratio", "$\\xi_h$ [-]", lambda p, m, a: np.asarray(p.damping_ratio)),
    _Panel("loop gain over its limit", "$K_l/(2\\xi_h\\omega_h)$ [-]", lambda p, m, a: np.asarray(p.stability_ratio), True, 1.0),
    _Panel("gain margin with the spool", "[dB]", lambda p, m, a: decibel(m.gain_margin), False, 0.0),
    _Panel("time constant", "$\\tau_e$ [s]", lambda p, m, a: np.asarray(p.time_constant), True),
    _Panel("static error, dry friction", "[µm]", lambda p, m, a: UM * np.asarray(p.static_error)),
    _Panel("load error", "[µm]", lambda p, m, a: UM * np.asarray(p.load_error)),
    _Panel("null consumption", "[W]", lambda p, m, a: np.asarray(p.null_consumption), True),
)  # fmt: skip


def performance_figure(
    valve: Valve, actuator: Actuator, *, temperatures: Sequence[float] | np.ndarray, supply_pressures: Sequence[float]
) -> Figure:
    """Eight figures of performance against temperature [K], one colour per supply pressure [Pa], HM solid and THM dashed."""
    warm = np.asarray(temperatures, dtype=float)
    supply = np.asarray(supply_pressures, dtype=float)
    with look.style():
        figure = Figure(figsize=(12.0, 6.2))
        panels = figure.subplots(2, 4)
        figure.subplots_adjust(left=0.06, right=0.985, top=0.86, bottom=0.17, wspace=0.34, hspace=0.34)
        figure.text(0.06, 0.945, "Actuator performance at null", fontsize=12, fontweight="bold")
        for model, heat in MODELS.items():
            found = performance(
                valve,
                actuator,
                temperature=jnp.asarray(warm),
                supply_pressure=jnp.asarray(supply)[:, None],
                heat=jnp.asarray(heat),
            )
            margins = loop_margins(found, actuator)
            for panel, axes in zip(PANELS, panels.flat, strict=True):
                values = np.reshape(panel.values(found, margins, actuator), (supply.size, warm.size))
                _draw(axes, panel, warm, supply, values, model)
        for axes in panels[1]:
            axes.set_xlabel(WARM)
        for model in MODELS:
            panels[0, 0].plot([], [], color=look.INK, linestyle=LINES[model], label=model)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=6, bbox_to_anchor=(0.52, 0.0), handlelength=2.4)
    return figure


def _draw(axes: Axes, panel: _Panel, warm: np.ndarray, supply: np.ndarray, values: np.ndarray, model: str) -> None:
    for colour, pressure, curve in zip(look.temperature_colours(supply.size), supply, values, strict=True):
        label = f"{pressure / 1e5:.0f} bar" if model == "HM" else None
        axes.plot(warm - CELSIUS, curve, color=colour, linestyle=LINES[model], label=label)
    axes.set_title(panel.title, loc="left", color=look.FAINT)
    axes.set_ylabel(panel.label)
    if panel.logarithmic:
        axes.set_yscale("log")
        look.plain_numbers(axes.yaxis)
    elif panel.limit is None:
        axes.set_ylim(0.0, max(axes.get_ylim()[1], 1.08 * float(values.max())))
    if panel.limit is not None:
        axes.axhline(panel.limit, color=look.FAINT, linewidth=0.8, zorder=1)


def performance_plots(
    valve: Valve, actuator: Actuator, *, temperatures: Sequence[float] | np.ndarray, supply_pressures: Sequence[float]
) -> dict[str, bytes]:
    """{name: PNG}: `bode` (at up to five of the temperatures, the first supply pressure) and `performance`."""
    shown = np.asarray(temperatures)[np.unique(np.linspace(0, len(temperatures) - 1, 5).astype(int))]
    with look.style():
        return {
            "bode": look.png(
                bode_figure(
                    valve,
                    actuator,
                    temperatures=[float(t) for t in shown],
                    supply_pressure=supply_pressures[0],
                )
            ),
            "performance": look.png(
                performance_figure(valve, actuator, temperatures=temperatures, supply_pressures=supply_pressures)
            ),
        }
