"""The three static tests and all their derivatives, row by row: the one program behind every local figure of a study."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import Valve

from .factors import FACTORS
from .varied import LAWS, by_name, nominal_values, varied


TESTS = ("leakage", "pressure_gain", "flow_gain")
READING = {"leakage": "leakage_flow", "pressure_gain": "load_pressure", "flow_gain": "flow"}
COLUMNS = (*FACTORS, *LAWS)
ROWS = 4096  # rows per evaluation: one compiled program for every study, whose memory stays flat


def three_tests(valve: Valve, conditions: Conditions) -> Float[Array, "3 rows"]:
    """Leakage [m3/s], load pressure [Pa] and control flow [m3/s] at the same operating points: the three static tests."""
    return jnp.concatenate([_blocked(valve, conditions), control_flow(valve, conditions)[None]])


def _blocked(valve: Valve, conditions: Conditions) -> Float[Array, "2 rows"]:
    found = blocked_port_readings(valve, conditions)
    return jnp.stack([found["leakage_flow"], found["load_pressure"]])


@eqx.filter_jit
def readings_and_slopes(
    valve: Valve, conditions: Conditions, values: Float[Array, "columns rows"]
) -> tuple[Float[Array, "3 rows"], Float[Array, "3 columns rows"]]:
    """The three tests and their derivatives to everything in `COLUMNS`, at values of it that may differ from row to row.

    A reading depends on the factors through its own row only. One reverse pass per reading over factors spread over the
    rows therefore gives every column at once, however many there are (forward mode gives the same numbers, a column at
    a time).
    """
    of = lambda test: lambda spread: test(*varied(valve, conditions, by_name(spread, COLUMNS)))
    blocked, pull_blocked = jax.vjp(of(_blocked), values)
    flow, pull_flow = jax.vjp(of(control_flow), values)
    one = jnp.ones_like(flow)
    slopes = jax.vmap(lambda which: pull_blocked(which[:, None] * one)[0])(jnp.eye(2, dtype=one.dtype))
    return jnp.concatenate([blocked, flow[None]]), jnp.concatenate([slopes, pull_flow(one)[0][None]])


def nominal_rows(valve: Valve, rows: int) -> Float[Array, "columns rows"]:
    """Values of `COLUMNS` that change nothing, for so many rows."""
    nominal = nominal_values(valve)
    return jnp.stack([jnp.broadcast_to(nominal[name], (rows,)) for name in COLUMNS])


def slopes_at(
    valve: Valve,
    position: np.ndarray,
    supply_pressure: np.ndarray,
    return_pressure: np.ndarray,
    temperature: np.ndarray,
    values: np.ndarray | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(3, rows) readings and (3, columns, rows) slopes at any number of operating points (SI), piece by piece.

    values: (columns, rows) of `COLUMNS` as `varied` takes them; None: the valve as it is.
    """
    count = len(position)
    given = np.stack([position, supply_pressure, return_pressure, temperature])
    whole = np.asarray(nominal_rows(valve, count)) if values is None else values
    readings, slopes = np.empty((3, count)), np.empty((3, len(COLUMNS), count))
    for first in range(0, count, ROWS):
        if progress is not None and first:
            progress(f"differentiating {first:,} of {count:,} operating points")
        index = np.minimum(np.arange(first, first + ROWS), count - 1)
        rows = slice(first, min(first + ROWS, count))
        found = readings_and_slopes(valve, Conditions(*jnp.asarray(given[:, index])), jnp.asarray(whole[:, index]))
        readings[:, rows], slopes[..., rows] = (np.asarray(part)[..., : rows.stop - first] for part in found)
    return readings, slopes
