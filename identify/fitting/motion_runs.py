"""Turn the runs of a dynamic test into inputs of the simulator, stacked and padded to one length."""

from collections.abc import Mapping
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.dynamics.inputs import Linear, StepInputs, step_inputs
from thermohyd.identify.bench.test_record import DynamicTest

from .row_sizes import padded_size
from .sensed import gain_name, zero_name


BEHIND = 1e-9  # of a run's span, between pads behind its end


class CommandSignal(eqx.Module):
    """A command kept as reference * (signal - reference_zero), by the names of its gain and zero among the vector's entries
    ("": exact); zero: where it has no name."""

    gain: str = eqx.field(static=True)
    zero_name: str = eqx.field(static=True)
    reference: float = eqx.field(static=True)
    zero: float = eqx.field(static=True)

    def acting(self, inputs: StepInputs, given: Mapping[str, Float[Array, ""]]) -> StepInputs:
        """The inputs with the command that the gain and the zero make of it."""
        factor = given[self.gain] / self.reference if self.gain else jnp.ones(())
        zero = given[self.zero_name] if self.zero_name else jnp.asarray(self.zero)
        line = inputs.command
        shift = factor * self.reference * (self.zero - zero)
        return eqx.tree_at(
            lambda i: (i.command.start, i.command.bends), inputs, (factor * line.start + shift, factor * line.bends)
        )


@dataclass(frozen=True)
class StepRuns:
    """All runs of step tests that share a program. inputs: arrays lead with (runs,). rows {test: (run, place)}: where each
    row of the record lies, both (rows,). signal: of commands in volts or counts that a fit scales."""

    inputs: StepInputs
    rows: dict[str, tuple[np.ndarray, np.ndarray]]
    signal: CommandSignal | None = None


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
    for number, of_run in enumerate(rows):
        run[of_run], place[of_run] = number, np.arange(len(of_run))
    return rows, run, place


def step_runs(tests: Mapping[str, DynamicTest]) -> list[StepRuns]:
    """The runs of step tests, each with its own clock kept; tests with the same kind of command are stacked together.

    Whatever their sampling rates, such tests are one program then, which takes half a minute to compile.
    """
    alike: dict[tuple[str, bool, tuple | None], list[str]] = {}
    for name, test in tests.items():
        signal = signal_of(test)
        key = None if signal is None else (signal.gain, signal.zero_name, signal.reference, signal.zero)
        alike.setdefault((test.command_kind, test.external_force is not None, key), []).append(name)
    return [_together({name: tests[name] for name in names}) for names in alike.values()]


def signal_of(test: DynamicTest) -> CommandSignal | None:
    """The command's sensor where a fit estimates it; None where the command is one in SI."""
    sensor = test.command_sensor
    if sensor is None:
        return None
    return CommandSignal(gain_name(sensor), zero_name(sensor), test.command_reference, sensor.zero)


def _together(tests: Mapping[str, DynamicTest]) -> StepRuns:
    inputs: list[StepInputs] = []
    clocks: list[np.ndarray] = []
    rows = {}
    for name, test in tests.items():
        assert test.time is not None
        of_runs, run, place = _places(test)
        rows[name] = len(inputs) + run, place
        clocks += [test.time[of_run] for of_run in of_runs]
        inputs += [_inputs(test, of_run, test.time[of_run]) for of_run in of_runs]
    longest = padded_size(max(len(clock) for clock in clocks))
    signal = signal_of(next(iter(tests.values())))
    return StepRuns(_stacked(inputs, [_padded(clock, longest) for clock in clocks]), rows, signal)


def frequency_runs(test: DynamicTest) -> FrequencyRuns:
    """The operating points of a frequency test: the first row of each run."""
    assert test.frequency is not None
    rows, run, place = _places(test)
    longest = padded_size(max(len(of_run) for of_run in rows))
    # Two equal rows: the operating point stands still.
    inputs = [_inputs(test, of_run[[0, 0]], np.array([0.0, 1.0])) for of_run in rows]
    frequency = np.stack([np.pad(test.frequency[of_run], (0, longest - len(of_run)), mode="edge") for of_run in rows])
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


def _padded(time: np.ndarray, longest: int) -> np.ndarray:
    """With rows behind the last one that cost the solver nothing."""
    missing = longest - len(time)
    return np.append(time, time[-1] + BEHIND * (time[-1] - time[0]) * np.arange(1, missing + 1))


def _stacked(inputs: list[StepInputs], times: list[np.ndarray]) -> StepInputs:
    most = {part: max(len(getattr(one, part).knots) for one in inputs) for part in ("command", "surroundings")}
    ready = [
        StepInputs(
            jnp.asarray(time),
            _with_knots(one.command, most["command"], time[-1]),
            _with_knots(one.surroundings, most["surroundings"], time[-1]),
            one.kind,
            one.forced,
        )
        for one, time in zip(inputs, times, strict=True)
    ]
    return jax.tree.map(lambda *arrays: jnp.stack(arrays), *ready)


def _with_knots(line: Linear, count: int, end: float) -> Linear:
    """With bends of 0 behind the end, where the solver never comes."""
    spare = count - len(line.knots)
    if spare == 0:
        return line
    knots = jnp.concatenate([line.knots, end + 1.0 + jnp.arange(spare, dtype=line.knots.dtype)])
    return eqx.tree_at(lambda one: (one.knots, one.bends), line, (knots, jnp.pad(line.bends, ((0, spare), (0, 0)))))
