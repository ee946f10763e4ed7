"""From which measurement the share eta of kept heat can be told: standard error of eta by test, position, temperature, supply pressure.

By Fisher information: a sweep says of eta what its readings change per unit of it, in units of their noise, less what the six
geometric parameters could imitate. Two figures: what the wall takes of the heat, and these standard errors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thermohyd.actuator_performance import with_heat
from thermohyd.conditions import Conditions, operating_points
from thermohyd.identify.bench.shown_units import CELSIUS, UM
from thermohyd.identify.fitting.parameters import OF_THE_EDGES
from thermohyd.identify.report import style as look
from thermohyd.numerics import quickly
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import Valve


TESTS = ("leakage", "pressure_gain", "flow_gain")
# Below this share of its length a column's part that the others cannot imitate is rounding.
ROUNDING = 1e-9


class EtaIdentifiability(NamedTuple):
    """Standard errors of eta; axes tests, supply pressures, temperatures, positions in that order. Infinite: cannot be told.

    slope: d(reading)/d(eta) in units of the reading's noise (tests, pressures, temperatures, positions). One sweep over the
    positions: held with the six parameters known, free with all six unknown (tests, pressures, temperatures).
    all_tests: the three sweeps together, six unknown (pressures, temperatures). all_temperatures: the sweeps of a test at
    all temperatures together, six unknown (tests, pressures). noise: standard deviation, SI (tests, pressures, temperatures).
    """

    tests: tuple[str, ...]
    supply_pressure: np.ndarray
    temperature: np.ndarray
    position: np.ndarray
    eta: float
    noise: np.ndarray
    slope: np.ndarray
    held: np.ndarray
    free: np.ndarray
    all_tests: np.ndarray
    all_temperatures: np.ndarray


@quickly
def _readings_and_slopes(
    valve: Valve, conditions: Conditions
) -> tuple[Float[Array, "tests rows"], Float[Array, "parameters tests rows"]]:
    """The three readings, and their derivatives: eta first, then the six."""
    assert valve.heat_retention is not None
    values = jnp.stack([valve.heat_retention, *(getattr(valve, name) for name in OF_THE_EDGES)])

    def readings(values: Float[Array, " parameters"]) -> Float[Array, "tests rows"]:
        moved = replace(valve, heat_retention=values[0], **dict(zip(OF_THE_EDGES, values[1:], strict=True)))
        closed = blocked_port_readings(moved, conditions)
        return jnp.stack([closed["leakage_flow"], closed["load_pressure"], control_flow(moved, conditions)])

    return jax.vmap(lambda unit: jax.jvp(readings, (values,), (unit,)), out_axes=(None, 0))(jnp.eye(values.size))


def standard_error(columns: np.ndarray) -> float:
    """Standard error of the parameter in column 0 of (rows, parameters), derivatives in units of noise, with all others unknown.

    1/|g|, g what is left of its column when the best combination of the others is taken off.
    """
    wanted, others = columns[:, 0], columns[:, 1:]
    size = float(np.linalg.norm(wanted))
    if others.size:
        lengths = np.linalg.norm(others, axis=0)
        scaled = others[:, lengths > 0.0] / lengths[lengths > 0.0]
        wanted = wanted - scaled @ np.linalg.lstsq(scaled, wanted, rcond=1e-12)[0]
    left = float(np.linalg.norm(wanted))
    return 1.0 / left if left > ROUNDING * size else float("inf")


def eta_identifiability(
    valve: Valve,
    *,
    temperature: ArrayLike | Sequence[float],
    supply_pressure: ArrayLike | Sequence[float],
    position: ArrayLike | Sequence[float],
    eta: float = 0.5,
    noise: Mapping[str, float] | None = None,
    return_pressure: float = 0.0,
) -> EtaIdentifiability:
    """Standard error of eta per test, supply pressure [Pa] and temperature [K], from one sweep over `position` [m] each.

    Linear about `eta` and the valve's own parameters. noise: standard deviation of one reading of "leakage" [m3/s],
    "pressure_gain" [Pa], "flow_gain" [m3/s]; those not given are 0.5 % of the largest reading of their sweep. Errors fall
    with the square root of the number of positions and with the noise.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> import numpy as np
    >>> from thermohyd import seed_valve
    >>> from thermohyd.identify import eta_identifiability
    >>> found = eta_identifiability(seed_valve(), temperature=[253.15, 343.15], supply_pressure=[210e5],
    ...                             position=np.linspace(-20e-6, 20e-6, 41))
    >>> for name, held, free in zip(found.tests, found.held[:, 0, 0], found.free[:, 0, 0]):
    ...     print(f"{name}: {held:.3f} with the six parameters known, {free:.2g} without")
    leakage: 0.011 with the six parameters known, 1.2 without
    pressure_gain: 0.029 with the six parameters known, 1.1 without
    flow_gain: 0.009 with the six parameters known, 43 without
    """
    p, t, x = (np.atleast_1d(np.asarray(a, dtype=float)) for a in (supply_pressure, temperature, position))
    grid = np.meshgrid(p, t, x, indexing="ij")
    shape = grid[0].shape
    rows = operating_points(
        jnp.asarray(grid[2].ravel()),
        supply_pressure=jnp.asarray(grid[0].ravel()),
        temperature=jnp.asarray(grid[1].ravel()),
        return_pressure=return_pressure,
    )
    readings, slopes = (np.asarray(a) for a in _readings_and_slopes(with_heat(valve, eta), rows))
    sweeps = readings.reshape(len(TESTS), *shape)
    largest = np.max(np.abs(sweeps), axis=-1)
    given = noise or {}
    unit = np.stack([np.full(largest[i].shape, given.get(name, np.nan)) for i, name in enumerate(TESTS)])
    unit = np.where(np.isnan(unit), 0.005 * largest, unit)
    # (tests, pressures, temperatures, positions, parameters)
    columns = np.moveaxis(slopes.reshape(-1, len(TESTS), *shape) / unit[..., None], 0, -1)

    def errors(blocks: np.ndarray, kept: int) -> np.ndarray:
        """Of blocks (..., rows, parameters), the first `kept` parameters unknown."""
        flat = blocks.reshape(-1, *blocks.shape[-2:])
        return np.array([standard_error(block[:, :kept]) for block in flat]).reshape(blocks.shape[:-2])

    k = columns.shape[-1]
    by_condition = np.moveaxis(columns, 0, 2).reshape(p.size, t.size, -1, k)
    by_test = columns.reshape(len(TESTS), p.size, -1, k)
    return EtaIdentifiability(
        tests=TESTS,
        supply_pressure=p,
        temperature=t,
        position=x,
        eta=eta,
        noise=unit,
        slope=columns[..., 0],
        held=errors(columns, 1),
        free=errors(columns, k),
        all_tests=errors(by_condition, k),
        all_temperatures=errors(by_test, k),
    )


if TYPE_CHECKING:
    from thermohyd.wall_tests import HeatStudy


NAMES = {"leakage": "leakage test", "pressure_gain": "pressure-gain test", "flow_gain": "flow-gain test"}
MOST_TEMPERATURES = 6
LARGEST_ERROR = 1e3  # of eta, drawn: eta lies between 0 and 1


def _title(axes: Axes, words: str) -> None:
    axes.set_title(words, loc="left", color=look.FAINT)


def _spread(count: int, most: int = MOST_TEMPERATURES) -> list[int]:
    """At most `most` indices, ends included."""
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, most)).round()})


def heat_study_figure(
    study: "HeatStudy", heading: str = "Heat exchange with the wall: from no contact to perfect contact"
) -> Figure:
    """eta, and leakage, pressure gain and flow gain relative to the isothermal model, against h_w A_w.

    Ticks at the left edge are the adiabatic model (THM); the line at 0 % is the isothermal one (HM).
    """
    conductance = study.wall_conductance
    drawn = _spread(study.temperature.size)
    with look.style():
        figure = Figure(figsize=(10.0, 7.0))
        panels = figure.subplots(2, 2, sharex=True)
        figure.subplots_adjust(left=0.085, right=0.985, top=0.88, bottom=0.15, wspace=0.2, hspace=0.22)
        figure.text(0.085, 0.95, heading, fontsize=12, fontweight="bold")
        fields = ("leakage_flow", "pressure_gain", "flow_gain")
        titles = ("leakage", "pressure gain $K_{PX}$", "flow gain $K_{QX}$")
        for colour, i in zip(look.temperature_colours(len(drawn)), drawn, strict=True):
            label = f"{study.temperature[i] - CELSIUS:.0f} °C"
            panels[0, 0].plot(conductance, study.between.eta[:, i], color=colour, label=label)
            for axes, field in zip(panels.ravel()[1:], fields, strict=True):
                hm = getattr(study.hm, field)[i]
                axes.plot(conductance, 100.0 * (getattr(study.between, field)[:, i] / hm - 1.0), color=colour)
                thm = 100.0 * (getattr(study.thm, field)[i] / hm - 1.0)
                axes.plot([0.0, 0.03], [thm, thm], color=colour, linewidth=3.0, transform=axes.get_yaxis_transform())
        _title(panels[0, 0], "share of the heat kept in the ports, $\\eta=\\exp(-NTU)$")
        for axes, words in zip(panels.ravel()[1:], titles, strict=True):
            _title(axes, f"{words}, above the isothermal model [%]")
            axes.axhline(0.0, color=look.FAINT, linewidth=0.8)
        for axes in panels.ravel():
            axes.set_xscale("log")
            look.plain_numbers(axes.xaxis)
            axes.set_xlim(conductance.min(), conductance.max())
        for axes in panels[1]:
            look.label_axes(axes, "$h_w A_w$ of one port [W/K]", "")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=len(drawn), bbox_to_anchor=(0.53, 0.02))
        figure.text(0.985, 0.025, "thick marks: adiabatic model", ha="right", color=look.FAINT, fontsize=8)
    return figure


def identifiability_figure(
    found: "EtaIdentifiability", heading: str = "From which measurement can eta be told?"
) -> Figure:
    """Above: what one unit of eta changes at each position, in units of noise. Below: standard error of eta by temperature.

    One column per test, the highest supply pressure above, every supply pressure below; solid with the six parameters
    unknown, dashed with them known. Errors above 1 say that the sweep does not tell eta at all.
    """
    tests, top = len(found.tests), int(np.argmax(found.supply_pressure))
    drawn, pressures = _spread(found.temperature.size), _spread(found.supply_pressure.size, 3)
    celsius = found.temperature - CELSIUS
    with look.style():
        figure = Figure(figsize=(11.0, 7.2))
        panels = figure.subplots(2, tests, squeeze=False)
        figure.subplots_adjust(left=0.075, right=0.985, top=0.87, bottom=0.15, wspace=0.2, hspace=0.42)
        figure.text(0.075, 0.95, heading, fontsize=12, fontweight="bold")
        for column, name in enumerate(found.tests):
            upper, lower = panels[:, column]
            for colour, i in zip(look.temperature_colours(len(drawn)), drawn, strict=True):
                upper.plot(UM * found.position, found.slope[column, top, i], color=colour, label=f"{celsius[i]:.0f} °C")
            _title(upper, f"{NAMES[name]}, {found.supply_pressure[top] / 1e5:.0f} bar")
            look.label_axes(upper, "opening [µm]", "change per unit of $\\eta$ [noise]" if column == 0 else "")
            for marker, j in zip(look.MARKERS, pressures, strict=False):
                words = f"{found.supply_pressure[j] / 1e5:.0f} bar"
                for errors, line, kind in ((found.free, "-", "unknown"), (found.held, "--", "known")):
                    value = np.clip(errors[column, j], None, LARGEST_ERROR)
                    lower.plot(
                        celsius,
                        value,
                        line,
                        color=look.INK,
                        marker=marker,
                        markersize=4.0,
                        label=f"{words}, six {kind}",
                    )
            lower.axhline(1.0, color=look.FAINT, linewidth=0.8)
            lower.set_yscale("log")
            look.label_axes(lower, "oil temperature [°C]", "standard error of $\\eta$" if column == 0 else "")
        low = min(axes.get_ylim()[0] for axes in panels[1])
        high = max(axes.get_ylim()[1] for axes in panels[1])
        for axes in panels[1]:
            axes.set_ylim(low, high)
            look.plain_numbers(axes.yaxis)
        panels[0, 0].legend(loc="upper right")
        handles, labels = panels[1, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=6, bbox_to_anchor=(0.53, 0.015))
    return figure
