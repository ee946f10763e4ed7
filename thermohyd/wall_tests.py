"""The static tests and gains of a valve whose wall takes part of the heat: HM, THM and everything between them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .conditions import Conditions, operating_points
from .heat import HeatExchange, wall_state
from .numerics import kept
from .oil import density
from .valve import Valve, read_out, true_conditions, true_oil


class WallReadings(eqx.Module):
    """Readings and gains at each operating point, shape (rows,): SI units; eta and wall temperature of the leakage test.

    leakage_flow [m3/s] and load_pressure [Pa] with closed ports, flow [m3/s] with joined ones, and the slopes over the
    position pressure_gain [Pa/m] and flow_gain [m2/s]. eta: exp(-NTU), mean of both ports weighted by their flows.
    """

    leakage_flow: Float[Array, " rows"]
    load_pressure: Float[Array, " rows"]
    flow: Float[Array, " rows"]
    pressure_gain: Float[Array, " rows"]
    flow_gain: Float[Array, " rows"]
    eta: Float[Array, " rows"]
    wall_temperature: Float[Array, " rows"]
    return_temperature: Float[Array, " rows"]


def _closed(valve: Valve, exchange: HeatExchange, conditions: Conditions) -> dict[str, Float[Array, " rows"]]:
    true, oil = true_conditions(valve, conditions), true_oil(valve)
    state = wall_state(valve, oil, exchange, true, joined=False)
    ports = state.ports
    out = jnp.sum(ports.outflow, axis=0)
    leakage = out / density(oil, true.return_pressure, state.return_temperature)
    load = ports.pressure[0] - ports.pressure[1]
    return {
        "leakage_flow": read_out(valve, "leakage_flow", leakage, conditions, true, oil),
        "load_pressure": read_out(valve, "load_pressure", load, conditions, true, oil),
        "eta": jnp.sum(state.eta * ports.inflow, axis=0) / out,
        "wall_temperature": state.wall_temperature,
        "return_temperature": state.return_temperature,
    }


def _joined(valve: Valve, exchange: HeatExchange, conditions: Conditions) -> Float[Array, " rows"]:
    true, oil = true_conditions(valve, conditions), true_oil(valve)
    ports = wall_state(valve, oil, exchange, true, joined=True).ports
    value = (ports.inflow[0] - ports.outflow[0]) / density(oil, ports.pressure[0], ports.temperature[0])
    return read_out(valve, "flow", value, conditions, true, oil)


@kept
def wall_readings(valve: Valve, exchange: HeatExchange, conditions: Conditions) -> WallReadings:
    """All static readings and gains with heat exchange; shape (rows,), differentiable in everything.

    The valve's own heat_retention takes no part. Raises ValueError for effects that tie the ports together (`wall_state`).
    """
    one = jnp.ones_like(conditions.position)
    closed, slopes = jax.jvp(
        lambda x: _closed(valve, exchange, replace(conditions, position=x)), (conditions.position,), (one,)
    )
    flow, flow_gain = jax.jvp(
        lambda x: _joined(valve, exchange, replace(conditions, position=x)), (conditions.position,), (one,)
    )
    return WallReadings(**closed, flow=flow, flow_gain=flow_gain, pressure_gain=slopes["load_pressure"])


class HeatStudy(NamedTuple):
    """Between HM and THM: readings of shape (conductances, temperatures); `hm` and `thm` of shape (temperatures,)."""

    wall_conductance: np.ndarray
    temperature: np.ndarray
    between: WallReadings
    hm: WallReadings
    thm: WallReadings


def heat_study(
    valve: Valve,
    *,
    wall_conductance: ArrayLike | Sequence[float],
    temperature: ArrayLike | Sequence[float],
    supply_pressure: float,
    position: float = 0.0,
    return_pressure: float = 0.0,
    ambient_conductance: float = float("inf"),
    ambient_temperature: float | None = None,
) -> HeatStudy:
    """Leakage and gains as functions of h_w A_w [W/K] and oil temperature [K], with both extremes, in one program.

    The extremes are the wall in perfect contact with oil and air at the supply's temperature (HM) and no contact (THM).

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd import heat_study
    >>> from thermohyd.seed_paper import seed_valve
    >>> found = heat_study(seed_valve(), wall_conductance=[0.1, 10.0], temperature=[273.15, 343.15], supply_pressure=70e5)
    >>> above = found.between.leakage_flow / found.hm.leakage_flow - 1.0
    >>> for conductance, row in zip(found.wall_conductance, 100.0 * above):
    ...     print(f"{conductance:4.1f} W/K: {row[0]:.2f} and {row[1]:.2f} % above the isothermal leakage")
     0.1 W/K: 3.48 and 1.48 % above the isothermal leakage
    10.0 W/K: 0.00 and 0.13 % above the isothermal leakage
    """
    conductance, warm = (np.atleast_1d(np.asarray(a, dtype=float)) for a in (wall_conductance, temperature))
    # Rows: conductances by temperatures, then the two extremes.
    grid = [a.ravel() for a in np.meshgrid(conductance, warm, indexing="ij")]
    inf, none = np.full(warm.size, np.inf), np.zeros(warm.size)
    h = np.concatenate([grid[0], inf, none])
    t = np.concatenate([grid[1], warm, warm])
    air = t if ambient_temperature is None else np.concatenate([np.full(grid[0].size, ambient_temperature), warm, warm])
    taken = np.concatenate([np.full(grid[0].size, ambient_conductance), inf, inf])
    found = wall_readings(
        valve,
        HeatExchange(jnp.asarray(h), jnp.asarray(taken), jnp.asarray(air)),
        operating_points(
            position, supply_pressure=supply_pressure, return_pressure=return_pressure, temperature=jnp.asarray(t)
        ),
    )
    n = grid[0].size
    hm, thm = (jax.tree.map(lambda a, i=i: a[n + i * warm.size : n + (i + 1) * warm.size], found) for i in (0, 1))
    between = jax.tree.map(lambda a: a[:n].reshape(conductance.size, warm.size), found)
    return HeatStudy(conductance, warm, between, hm, thm)
