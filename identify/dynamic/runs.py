"""The runs of a dynamic test as inputs of the simulator: stacked, padded, and on a grid fine enough for sensitivities."""

import math
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from thermohyd.dynamics.inputs import Linear, StepInputs, step_inputs

from ..record import DynamicTest
from ..static_model import padded_size


# Sensitivities are carried over pieces of this length, a third of a radian of a 100 Hz spool; rows may be further apart.
PIECE = 0.5e-3  # s
MOST_PIECES = 8
BEHIND = 1e-9  # of a run's span, between pads behind its end


@dataclass(frozen=True)
class StepRuns:
    """All runs of a step test. inputs: arrays lead with (runs,), `time` on the grid of 2 pieces + 1 points per row.

    run, place (rows,): where each row of the record lies; every: grid points per row.
    """

    inputs: StepInputs
    run: np.ndarray
    place: np.ndarray
    every: int


@dataclass(frozen=True)
class FrequencyRuns:
    """All operating points of a frequency test; frequency (runs, padded) [Hz], run and place (rows,)."""

    inputs: StepInputs
    frequency: jax.Array
    run: np.ndarray
    place: np.ndarray


def _places(test: DynamicTest) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """(rows of each run, number of each row's run, its place in that run)"""
    rows = [np.flatnonzero(test.run == code) for code in np.unique(test.run)]
    run, place = np.zeros(test.rows, dtype=int), np.zeros(test.rows, dtype=int)
    for number, own in enumerate(rows):
        run[own], place[own] = number, np.arange(len(own))
    return rows, run, place


def step_runs(test: DynamicTest) -> StepRuns:
    """The runs of a step test, each with its own clock kept."""
    assert test.time is not None
    rows, run, place = _places(test)
    longest = padded_size(max(len(own) for own in rows))
    spacing = float(np.median(np.concatenate([np.diff(test.time[own]) for own in rows])))
    every = 2 * int(np.clip(math.ceil(spacing / PIECE), 1, MOST_PIECES))
    inputs = [_inputs(test, own, test.time[own]) for own in rows]
    grids = [_grid(test.time[own], longest, every) for own in rows]
    return StepRuns(_stacked(inputs, grids), run, place, every)


def frequency_runs(test: DynamicTest) -> FrequencyRuns:
    """The operating points of a frequency test: the first row of each run."""
    assert test.frequency is not None
    rows, run, place = _places(test)
    longest = padded_size(max(len(own) for own in rows))
    # Two equal rows: the operating point stands still.
    inputs = [_inputs(test, own[[0, 0]], np.array([0.0, 1.0])) for own in rows]
    frequency = np.stack([np.pad(test.frequency[own], (0, longest - len(own)), mode="edge") for own in rows])
    return FrequencyRuns(_stacked(inputs, [np.array([0.0, 1.0])] * len(rows)), jnp.asarray(frequency), run, place)


def _inputs(test: DynamicTest, rows: np.ndarray, time: np.ndarray) -> StepInputs:
    return step_inputs(
        time,
        test.command[rows],
        test.command_kind,  # pyright: ignore[reportArgumentType]  # one of KINDS: the reader sees to it
        supply_pressure=test.supply_pressure[rows],
        return_pressure=test.return_pressure[rows],
        temperature=test.temperature[rows],
        external_force=None if test.external_force is None else test.external_force[rows],
    )


def _grid(time: np.ndarray, longest: int, every: int) -> np.ndarray:
    """`every` points per row up to the last, then pads that cost the solver nothing."""
    missing = longest - len(time)
    time = np.append(time, time[-1] + BEHIND * (time[-1] - time[0]) * np.arange(1, missing + 1))
    share = np.arange(every) / every
    return np.append((time[:-1, None] + np.diff(time)[:, None] * share).ravel(), time[-1])


def _stacked(inputs: list[StepInputs], grids: list[np.ndarray]) -> StepInputs:
    most = {part: max(len(getattr(one, part).knots) for one in inputs) for part in ("command", "surroundings")}
    ready = [
        StepInputs(
            jnp.asarray(grid),
            _with_knots(one.command, most["command"], grid[-1]),
            _with_knots(one.surroundings, most["surroundings"], grid[-1]),
            one.kind,
            one.forced,
        )
        for one, grid in zip(inputs, grids, strict=True)
    ]
    return jax.tree.map(lambda *arrays: jnp.stack(arrays), *ready)


def _with_knots(line: Linear, count: int, end: float) -> Linear:
    """With bends of 0 behind the end, where the solver never comes."""
    spare = count - len(line.knots)
    if spare == 0:
        return line
    knots = jnp.concatenate([line.knots, end + 1.0 + jnp.arange(spare, dtype=line.knots.dtype)])
    return eqx.tree_at(lambda one: (one.knots, one.bends), line, (knots, jnp.pad(line.bends, ((0, spare), (0, 0)))))
