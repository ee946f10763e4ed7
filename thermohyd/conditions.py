"""The operating points of a test: one entry per row, in the order of the sweep."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Conditions(eqx.Module):
    """Where the valve is run. Every array has shape (rows,), SI units, pressures gauge.

    position: spool position as read [m]; supply_pressure, return_pressure [Pa]; temperature: of the oil supplied [K].
    load_pressure: imposed p_A - p_B [Pa], for the load-flow test. time [s], direction (+1, -1: sign of the motion) and
    run (0, 1, ...: which sweep) serve the effects that depend on the sweep, rate (dx/dt as read [m/s]) those that depend
    on its speed.
    """

    position: Float[Array, " rows"]
    supply_pressure: Float[Array, " rows"]
    return_pressure: Float[Array, " rows"]
    temperature: Float[Array, " rows"]
    load_pressure: Float[Array, " rows"] | None = None
    time: Float[Array, " rows"] | None = None
    direction: Float[Array, " rows"] | None = None
    run: Float[Array, " rows"] | None = None
    rate: Float[Array, " rows"] | None = None


def operating_points(
    position: float | Array,
    *,
    supply_pressure: float | Array,
    temperature: float | Array,
    return_pressure: float | Array = 0.0,
    load_pressure: float | Array | None = None,
) -> Conditions:
    """Conditions from numbers and arrays that broadcast to one row per operating point (SI units, gauge pressures)."""
    given = [position, supply_pressure, return_pressure, temperature]
    if load_pressure is not None:
        given.append(load_pressure)
    arrays = jnp.broadcast_arrays(*(jnp.atleast_1d(jnp.asarray(a, dtype=jnp.result_type(float))) for a in given))
    x, ps, pt, t = arrays[:4]
    return Conditions(x, ps, pt, t, load_pressure=arrays[4] if load_pressure is not None else None)
