"""What acts on the actuator over time: columns that are linear between a record's rows, kept as their bends.

A linear column is start + sum_k bend_k max(t - knot_k, 0): no search for the segment, so nothing branches inside the
vector field, and a delay only shifts the knots. Knots are the rows where the slope really changes; the solver steps
exactly to them.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Real

from thermohyd.arguments import (
    ArgumentTypeError,
    check_length,
    check_pressure,
    check_size,
    check_temperature,
    described,
)
from thermohyd.numerics import require_float64


Kind = Literal["setpoint", "current", "spool_position"]
KINDS = ("setpoint", "current", "spool_position")
# A row is a knot where leaving it out would move the column by more than this share of its largest value: what a CSV of
# 12 digits rounds is no bend.
SAME_LINE = 1e-9


class Linear(eqx.Module):
    """Columns that are linear between knots [s] and constant outside them: start + bends . max(t - knots, 0).

    start: (columns,); knots: (knots,), rising; bends: (knots, columns), changes of slope. No knots: constant.
    """

    start: Float[Array, " columns"]
    knots: Float[Array, " knots"]
    bends: Float[Array, "knots columns"]

    def at(self, time: Float[Array, ""]) -> Float[Array, " columns"]:
        """The columns at a time [s]."""
        if self.knots.shape[-1] == 0:
            return self.start
        # A sum, not a matrix product: XLA fuses it with what it feeds.
        return self.start + jnp.sum(self.bends * jnp.maximum(time - self.knots, 0.0)[:, None], axis=0)

    def shifted(self, delay: Float[Array, "..."]) -> "Linear":
        """The same, a delay [s] later; what it was at its start, it was before."""
        return Linear(self.start, self.knots + delay, self.bends)


class StepInputs(eqx.Module):
    """Rows of a step test, ready for the solver; make it with `step_inputs`. SI units.

    time: (rows,), when readings are wanted. command: one column, setpoint [m], current [A] or spool position [m], by `kind`.
    surroundings: four columns, supply and return pressure [Pa, gauge], oil temperature [K], external force [N]. forced:
    whether that force column was given; without it the actuator's own constant one acts.
    """

    time: Float[Array, " rows"]
    command: Linear
    surroundings: Linear
    kind: Kind = eqx.field(static=True)
    forced: bool = eqx.field(static=True, default=True)


def _knots(time: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Indices of the rows that linear columns (rows, columns) need, first and last included (the swinging door)."""
    size = np.max(np.abs(columns), axis=0)
    slack = SAME_LINE * np.where(size > 0.0, size, 1.0)
    kept, anchor = [0], 0
    low, high = np.full(columns.shape[1], -np.inf), np.full(columns.shape[1], np.inf)
    for row in range(1, len(time)):
        span = time[row] - time[anchor]
        slope = (columns[row] - columns[anchor]) / span
        if np.any(slope < low) or np.any(slope > high):
            # No line from the anchor to here passes the rows between: the row before is a knot.
            anchor = row - 1
            kept.append(anchor)
            span = time[row] - time[anchor]
            slope = (columns[row] - columns[anchor]) / span
            low, high = slope - slack / span, slope + slack / span
        else:
            low, high = np.maximum(low, slope - slack / span), np.minimum(high, slope + slack / span)
    return np.array([*kept, len(time) - 1] if len(time) > 1 else kept)


def _linear(time: np.ndarray, columns: np.ndarray, least: int) -> Linear:
    """The columns as bends; the number of knots is padded to a power of two, so that records share compiled programs."""
    rows = _knots(time, columns)
    slopes = np.diff(columns[rows], axis=0) / np.diff(time[rows])[:, None]
    flat = np.zeros((1, columns.shape[1]))
    bends = np.diff(np.concatenate([flat, slopes, flat]), axis=0)
    knots = time[rows]
    if not np.any(bends):
        knots, bends = knots[:0], bends[:0]
    wanted = max(least, 0 if len(knots) == 0 else 1 << (len(knots) - 1).bit_length())
    spare = wanted - len(knots)
    if spare > 0:
        # Past the end, where the solver never comes.
        knots = np.concatenate([knots, time[-1] + 1.0 + np.arange(spare)])
        bends = np.concatenate([bends, np.zeros((spare, columns.shape[1]))])
    return Linear(jnp.asarray(columns[0]), jnp.asarray(knots), jnp.asarray(bends))


def step_inputs(
    time: Real[np.ndarray, " rows"],
    command: Real[np.ndarray, " rows"] | float,
    kind: Kind,
    *,
    supply_pressure: Real[np.ndarray, " rows"] | float,
    temperature: Real[np.ndarray, " rows"] | float,
    return_pressure: Real[np.ndarray, " rows"] | float = 0.0,
    external_force: Real[np.ndarray, " rows"] | float | None = None,
    knots: int = 0,
) -> StepInputs:
    """Inputs of one run of a step test from its columns, on the host (NumPy), SI units, gauge pressures.

    time [s]: (rows,), strictly rising, at least two rows; the others: numbers or (rows,), linear between rows.
    command by `kind`: "setpoint" z* [m] of the closed loop, "current" [A] or "spool_position" [m] in open loop.
    supply_pressure, return_pressure [Pa], temperature [K] of the oil supplied, external_force F_e [N] against +z
    (None: the actuator's own).
    knots: at least as many bends as this, so that inputs of several runs stack (`jax.vmap`).
    Raises ValueError with one sentence where the columns do not fit, ArgumentValueError (one of them) for a wrong unit,
    ArgumentTypeError for what is no number, RuntimeError in single precision. See docs/physics.md section 9.5.
    """
    require_float64("step_inputs")
    time = np.asarray(time, dtype=float)
    if kind not in KINDS:
        raise ValueError(f"the kind of command must be one of {', '.join(KINDS)}, not {kind!r}")
    if time.ndim != 1 or time.size < 2 or np.any(np.diff(time) <= 0.0):
        raise ValueError("a step test needs at least two rows whose times strictly rise")
    given = {"command": command, "supply_pressure": supply_pressure, "return_pressure": return_pressure,
             "temperature": temperature, "external_force": 0.0 if external_force is None else external_force}  # fmt: skip
    columns = {}
    for name, value in given.items():
        try:
            column = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise ArgumentTypeError(
                f"{name} must be a number or one per row, in SI units, not {described(value)}"
            ) from None
        if column.ndim and column.shape != time.shape:
            raise ValueError(
                f"{name} must be a number or have the {time.size} rows of time, but has shape {column.shape}"
            )
        columns[name] = np.broadcast_to(column, time.shape)
        if not np.all(np.isfinite(columns[name])):
            raise ValueError(f"{name} must be finite in every row")
    check_pressure("supply_pressure", columns["supply_pressure"], supply=True)
    check_pressure("return_pressure", columns["return_pressure"])
    check_temperature("temperature", columns["temperature"])
    if kind == "setpoint":
        check_length("command", columns["command"], limit=20.0, unit="mm")
    elif kind == "spool_position":
        check_length("command", columns["command"])
    else:
        check_size("command", columns["command"], -5.0, 5.0, "currents are in A: 25 mA is 25e-3")
    around = np.stack([columns[n] for n in ("supply_pressure", "return_pressure", "temperature", "external_force")], 1)
    return StepInputs(
        time=jnp.asarray(time),
        command=_linear(time, columns["command"][:, None], knots),
        surroundings=_linear(time, around, knots),
        kind=kind,
        forced=external_force is not None,
    )
