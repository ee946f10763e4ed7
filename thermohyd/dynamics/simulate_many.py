"""Simulate many step tests at once: thousands of scenarios for Monte Carlo studies, tolerances and sweeps."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from thermohyd.actuator import Actuator
from thermohyd.arguments import Heat
from thermohyd.numerics import jitted, known_options
from thermohyd.side_by_side import cores
from thermohyd.valve import Valve

from .batch import BatchedRodas5P
from .inputs import StepInputs
from .integrate import FAILURES
from .machine import Walls
from .simulate import ATOL, MAX_STEPS, RTOL, StepReadings, checked_heat, simulated


# Scenarios per program: enough to fill vectors and to hide what starting a loop costs, few enough for a core's cache.
CHUNK = 128
CHUNK_ELSEWHERE = 10_000  # on a GPU
# XLA's own choice is half as wide where a core has vectors of 512 bits; others ignore it.
WIDE = {"xla_cpu_prefer_vector_width": 512}

Along = tuple[int | None, int | None, int | None]


def _run(
    given: tuple[Valve, Actuator, StepInputs],
    walls: Walls,
    tolerances: tuple[Array, Array],
    polarity: Array,
    along: Along,
    heat: Heat,
    max_steps: int,
    batched: bool,
) -> StepReadings:
    solver = BatchedRodas5P() if batched else None
    alone: Callable[..., StepReadings] = lambda valve, actuator, inputs: simulated(
        valve, actuator, inputs, walls, *tolerances, polarity, heat, "forward", max_steps, solver
    )
    axes: Any = tuple(None if axis is None else eqx.if_array(0) for axis in along)
    return eqx.filter_vmap(alone, in_axes=axes)(*given)


@cache
def _compiled(options: tuple[tuple[str, Any], ...]) -> Callable[..., StepReadings]:
    return jitted(_run, dict(options))


# Programs that were run, so compiled: two threads that both find none would both compile it.
_ran: set[Any] = set()


def _key(given: Any, *rest: Any) -> Any:
    arrays, other = eqx.partition(given, eqx.is_array)
    shapes = tuple((leaf.shape, str(leaf.dtype)) for leaf in jax.tree.leaves(arrays))
    return (jax.tree.structure(given), shapes, tuple(jax.tree.leaves(other)), *rest)


def _count(given: tuple[Any, ...], along: Along) -> int:
    lengths = {
        leaf.shape[0] if leaf.ndim else None
        for part, axis in zip(given, along, strict=True)
        if axis == 0
        for leaf in jax.tree.leaves(eqx.filter(part, eqx.is_array))
    }
    if len(lengths) != 1 or None in lengths or 0 in lengths:
        raise ValueError(
            "every array of what in_axes says is stacked must lead with the same axis of scenarios; stack them with"
            f" jax.vmap (lengths found: {sorted(map(str, lengths))})"
        )
    return lengths.pop() or 0


def simulate_many(
    valve: Valve,
    actuator: Actuator,
    inputs: StepInputs,
    *,
    in_axes: Along = (0, 0, None),
    heat: Heat | float = "adiabatic",
    walls: Walls | None = None,
    polarity: int = 1,
    rtol: float | Array = RTOL,
    atol: float | Array = ATOL,
    max_steps: int = MAX_STEPS,
    chunk: int | None = None,
    throw: bool = True,
    compiler_options: dict[str, Any] | None = None,
) -> StepReadings:
    """Run many step tests; readings as those of `simulate_step`, every field with a leading axis (scenarios,).

    in_axes: 0 where every array of the valve, the actuator, the inputs leads with the axis of scenarios, None where one
    serves all scenarios. Stack them with `jax.vmap`: `jax.vmap(lambda theta: (my_valve(theta), my_actuator(theta)))(thetas)`;
    stacked inputs need equal `knots` in `step_inputs`. The other arguments, shared by all, are those of `simulate_step`.

    On CPUs, scenarios are worked on in chunks (of `chunk`, by default 128 or what the cores share evenly), one per core at a
    time; the last is filled up with its own last scenario, so that one program serves all. Elsewhere up to 10,000 go together.
    A chunk is as slow as its slowest scenario. Readings are those of `simulate_step` to the tolerance's accuracy, not to
    rounding: where all is at rest the estimated error is rounding, and the steps that follow may differ. Compiling takes about
    twice as long as for a single run. Not for use inside `jax.jit` or a derivative: there, `jax.vmap` of `simulate_step`.

    compiler_options: of XLA; None takes those that make the fastest program.
    Raises RuntimeError in single precision and, with `throw`, where a scenario fails, which it names; without `throw`, its
    readings are NaN and `failure` says why. Raises ValueError for stacks of different lengths or a choice that does not exist.
    """
    heat = checked_heat("simulate_many", heat=heat, walls=walls, polarity=polarity)
    given = (valve, actuator, inputs)
    if len(in_axes) != 3 or any(axis not in (0, None) for axis in in_axes):
        raise ValueError(f"in_axes must be three entries, each 0 or None, not {in_axes!r}")
    count = _count(given, in_axes)
    on_cpu = jax.default_backend() == "cpu"
    at_once = cores() if on_cpu else 1
    most = chunk if chunk is not None else CHUNK if on_cpu else CHUNK_ELSEWHERE
    if most < 1:
        raise ValueError(f"chunk must be at least 1, not {most}")
    # Equal chunks, and as many as keep all cores busy.
    rounds = -(-count // (most * at_once))
    size = min(most, -(-count // (rounds * at_once)))
    if compiler_options is None:
        compiler_options = known_options(WIDE) if on_cpu else {}
    run = _compiled(tuple(sorted(compiler_options.items())))
    as_array = lambda value: jnp.asarray(value, dtype=jnp.result_type(float))
    shared = (Walls() if walls is None else walls, (as_array(rtol), as_array(atol)), as_array(polarity))

    def part(first: int) -> tuple[Any, ...]:
        rows = np.minimum(np.arange(first, first + size), count - 1)
        pick = lambda leaf: leaf[rows] if eqx.is_array(leaf) else leaf
        return tuple(
            whole if axis is None else jax.tree.map(pick, whole) for whole, axis in zip(given, in_axes, strict=True)
        )

    def work(first: int) -> StepReadings:
        readings = run(part(first), *shared, in_axes, heat, max_steps, on_cpu)
        return jax.tree.map(np.asarray, readings)

    starts = range(0, count, size)
    key = _key((part(0), shared), in_axes, heat, max_steps, on_cpu, run)
    parts = [] if key in _ran else [work(starts[0])]
    _ran.add(key)
    # JAX holds no lock while a program runs, so threads keep all cores busy.
    pool = ThreadPoolExecutor(at_once)
    try:
        parts += pool.map(work, starts[len(parts) :])
    finally:
        # After Ctrl-C or an error: chunks that run end, the others never start.
        pool.shutdown(wait=True, cancel_futures=True)
    readings: StepReadings = jax.tree.map(lambda *chunks: jnp.asarray(np.concatenate(chunks)[:count]), *parts)
    failed = np.flatnonzero(np.asarray(readings.failure))
    if throw and failed.size:
        reason = FAILURES[int(readings.failure[failed[0]])]
        more = f" ({failed.size - 1} more of {count} failed)" if failed.size > 1 else ""
        raise RuntimeError(f"scenario {failed[0]}: {reason}{more}")
    return readings
