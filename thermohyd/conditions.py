"""The operating points of a test: one entry per row, in the order of the sweep."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .arguments import ArgumentValueError, as_array, check_length, check_pressure, check_temperature, known
from .numerics import require_float64


class Conditions(eqx.Module):
    """Where the valve is run. Every array has shape (rows,), SI units, pressures gauge.

    position: spool position as read [m]; supply_pressure, return_pressure [Pa]; temperature: of the oil supplied [K].
    load_pressure: imposed p_A - p_B [Pa], for the load-flow test. time [s], direction (+1, -1: sign of the motion) and
    run (0, 1, ...: which sweep) serve the effects that depend on the sweep, rate (dx/dt as read [m/s]) those that depend
    on its speed.

    Known values are checked, traced ones never: ArgumentValueError for a wrong unit (bar, degC, um), RuntimeError in single
    precision.
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

    def __check_init__(self) -> None:
        require_float64("operating_points")
        check_length("position", self.position)
        check_pressure("supply_pressure", self.supply_pressure, supply=True)
        check_pressure("return_pressure", self.return_pressure)
        check_temperature("temperature", self.temperature)
        if self.load_pressure is not None:
            check_pressure("load_pressure", self.load_pressure, difference=True)


def operating_points(
    position: float | Array,
    *,
    supply_pressure: float | Array,
    temperature: float | Array,
    return_pressure: float | Array = 0.0,
    load_pressure: float | Array | None = None,
) -> Conditions:
    """Conditions from numbers and arrays that broadcast to one row per operating point (SI units, gauge pressures).

    Raises ArgumentValueError for a wrong unit (bar, degC, um) or for arrays whose lengths do not go together,
    ArgumentTypeError for what is no number, RuntimeError in single precision.
    """
    require_float64("operating_points")
    given = {
        "position": position,
        "supply_pressure": supply_pressure,
        "return_pressure": return_pressure,
        "temperature": temperature,
    }
    if load_pressure is not None:
        given["load_pressure"] = load_pressure
    columns = {name: as_array(value) for name, value in given.items()}
    for name, column in columns.items():
        known(name, column)
    try:
        arrays = jnp.broadcast_arrays(*(jnp.atleast_1d(column) for column in columns.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {jnp.shape(column)}" for name, column in columns.items())
        raise ArgumentValueError(f"operating points need numbers or arrays of one shape, not {shapes}") from None
    x, ps, pt, t = arrays[:4]
    return Conditions(x, ps, pt, t, load_pressure=arrays[4] if load_pressure is not None else None)


def sweep_direction(position: Float[Array, " rows"], run: Float[Array, " rows"] | None) -> Float[Array, " rows"]:
    """+1 or -1: sign of the last change of position within a run, whose rows stand together.

    A repeated position keeps the direction, rows before the first movement take that of the first; +1 without any.
    """
    rows = jnp.arange(position.shape[0])
    steps = jnp.sign(jnp.diff(position, prepend=position[:1]))
    starts = rows == 0
    if run is not None:
        starts = starts | (jnp.diff(run, prepend=run[:1]) != 0.0)
    moved = (steps != 0.0) & ~starts
    first = jax.lax.cummax(jnp.where(starts, rows, 0))
    # The row that starts the next run, seen from each row.
    after = jax.lax.cummin(jnp.where(jnp.append(starts[1:], True), rows + 1, rows.size), reverse=True)
    last = jax.lax.cummax(jnp.where(moved, rows, -1))
    coming = jax.lax.cummin(jnp.where(moved, rows, rows.size), reverse=True)
    ahead = jnp.where(coming < after, steps[jnp.minimum(coming, rows.size - 1)], 1.0)
    return jnp.where(last >= first, steps[jnp.maximum(last, 0)], ahead)
