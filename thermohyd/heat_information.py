"""From which measurement the share eta of kept heat can be told: test, position, temperature, supply pressure.

Fisher information: a sweep says of eta what its readings change per unit of it, in units of their noise, less what the six
geometric parameters could imitate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .actuator_performance import with_heat
from .conditions import Conditions, operating_points
from .static_tests import blocked_port_readings, control_flow
from .valve import Valve


TESTS = ("leakage", "pressure_gain", "flow_gain")
SIX = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
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


@eqx.filter_jit
def _readings_and_slopes(
    valve: Valve, conditions: Conditions
) -> tuple[Float[Array, "tests rows"], Float[Array, "parameters tests rows"]]:
    """The three readings, and their derivatives: eta first, then the six."""
    assert valve.heat_retention is not None
    values = jnp.stack([valve.heat_retention, *(getattr(valve, name) for name in SIX)])

    def readings(values: Float[Array, " parameters"]) -> Float[Array, "tests rows"]:
        moved = replace(valve, heat_retention=values[0], **dict(zip(SIX, values[1:], strict=True)))
        closed = blocked_port_readings(moved, conditions)
        return jnp.stack([closed["leakage_flow"], closed["load_pressure"], control_flow(moved, conditions)])

    return jax.vmap(lambda unit: jax.jvp(readings, (values,), (unit,)), out_axes=(None, 0))(jnp.eye(values.size))


def standard_error(columns: np.ndarray) -> float:
    """Of the parameter in column 0 of (rows, parameters), derivatives in units of noise, with all others unknown.

    1/|g|, g what is left of its column when the best combination of the others is taken off.
    """
    own, others = columns[:, 0], columns[:, 1:]
    size = float(np.linalg.norm(own))
    if others.size:
        lengths = np.linalg.norm(others, axis=0)
        scaled = others[:, lengths > 0.0] / lengths[lengths > 0.0]
        own = own - scaled @ np.linalg.lstsq(scaled, own, rcond=1e-12)[0]
    left = float(np.linalg.norm(own))
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
    >>> from thermohyd import eta_identifiability
    >>> from thermohyd.identify.seed.seed_valve import seed_valve
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
