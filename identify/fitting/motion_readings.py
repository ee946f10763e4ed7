"""A record's dynamic tests as one function of named parameters and amounts: readings and derivatives at its rows.

The valve and the actuator are built from a vector of parameters and effects. The runs of step tests are integrated with their
derivatives in one program; frequency tests are the small-signal response at each operating point, by forward mode. Readings
then become residuals and columns: weighted, masked, whitened where the noise correlates.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from thermohyd.actuator import Actuator
from thermohyd.arguments import Heat
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.inputs import StepInputs
from thermohyd.dynamics.integrate import NO_EQUILIBRIUM, integrate
from thermohyd.dynamics.linear import Output, frequency_response
from thermohyd.dynamics.machine import Plant, State, Walls, plant_of, transducer_gain
from thermohyd.effects.library import classes_of, effect_info, with_effects
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ActuatorData, BenchRecord
from thermohyd.identify.bench.test_record import DynamicTest
from thermohyd.numerics import quickly
from thermohyd.valve import Valve

from .motion_runs import CommandSignal, FrequencyRuns, StepRuns, frequency_runs, step_runs
from .parameters import IN_MOTION, PARAMETERS, ParameterPlan
from .static_readings import base_valve
from .uncertainty import Key


def actuator_of(data: ActuatorData, rated_current: float | None, values: Mapping[str, float] | None = None) -> Actuator:
    """The simulator's actuator of an `[actuator]` table, with the identified `values` in the place of its own."""
    fields = {
        name: getattr(data, name)
        for name in ActuatorData.__dataclass_fields__
        if name != "heat" and getattr(data, name) is not None
    }
    if rated_current is not None:
        fields["rated_current"] = rated_current
    fields |= {name: value for name, value in (values or {}).items() if name in IN_MOTION}
    return Actuator(**fields)


def valve_of(record: BenchRecord, values: Mapping[str, float], effects: Mapping[str, float] | None = None) -> Valve:
    """The record's valve with parameters and held effects."""
    static = {name: value for name, value in values.items() if name not in IN_MOTION}
    return with_effects(base_valve(record, static), dict(effects or {}))


def machine(
    valve: Valve, actuator: Actuator, names: tuple[str, ...], effects: tuple[str, ...], p: Float[Array, " all"]
) -> tuple[Valve, Actuator]:
    """The valve and the actuator with the parameters `names` and the amounts of `effects`, in this order, taken from `p` (all,)."""
    given = {name: p[i] for i, name in enumerate(names)}
    moving = {name: value for name, value in given.items() if name in IN_MOTION}
    still = {name: value for name, value in given.items() if name in PARAMETERS}
    if LOOP_GAIN in given:
        # The loop compares volts with volts: its sensor's gain is in metres per volt.
        moving["sensor_gain"] = 1.0 / given[LOOP_GAIN]
    amounts = {name: jnp.asarray(p[len(names) + i]) for i, name in enumerate(effects)}
    return with_effects(replace(valve, **still), amounts), replace(actuator, **moving)


# The parameter that is the gain of the loop's own sensor.
LOOP_GAIN = "piston_position_gain"
STEP_READINGS = ("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity")
# A hundred times looser than the simulator's own: a thousandth of what a transducer's noise allows, in a third of the steps.
TOLERANCE = 1e-6
MOST_STEPS = 20_000


class Given(eqx.Module):
    """What a run is made of beside the vector of parameters and amounts."""

    valve: Valve
    actuator: Actuator
    polarity: Float[Array, ""]


class Plan(eqx.Module):
    """Names of the vector's entries, what stands behind them, and how the chambers keep heat: all that a compiled program
    depends on."""

    names: tuple[str, ...] = eqx.field(static=True)
    effects: tuple[str, ...] = eqx.field(static=True)
    heat: Heat = eqx.field(static=True)
    tolerance: float = eqx.field(static=True, default=TOLERANCE)
    command: CommandSignal | None = None
    classes: tuple[type, ...] = eqx.field(static=True, init=False)

    def __post_init__(self) -> None:
        self.classes = classes_of(self.effects)

    def plant(self, p: Float[Array, " all"], given: Given, inputs: StepInputs) -> Plant:
        valve, actuator = machine(given.valve, given.actuator, self.names, self.effects, p)
        if self.command is not None:
            inputs = self.command.acting(inputs, {name: p[i] for i, name in enumerate(self.names)})
        return plant_of(valve, actuator, inputs, heat=self.heat, walls=Walls(), polarity=given.polarity)


def read_of(state: State, valve: Valve) -> Float[Array, " readings"]:
    """What a step test could read of a state, in the order of STEP_READINGS."""
    return jnp.stack(
        [state.spool / transducer_gain(valve), state.pressure[0], state.pressure[1], state.position, state.velocity]
    )


@quickly
def readings_and_slopes(
    plan: Plan, p: Float[Array, " all"], given: Given, inputs: StepInputs
) -> tuple[Float[Array, "runs rows readings"], Float[Array, "runs rows readings all"], Int[Array, " runs"]]:
    """A step run: (readings in the order of STEP_READINGS, SI; their derivatives to the vector; an index into `integrate.FAILURES`)."""

    def read(q: Array, inputs: StepInputs) -> tuple[Array, tuple[Array, Array]]:
        plant = plan.plant(q, given, inputs)
        scaling = scaling_of(plant, plant.surroundings(inputs.time[0]))
        start, found = equilibrium(plant, scaling, inputs.time[0])
        rtol = atol = plan.tolerance
        run = integrate(plant, scaling, start, gradient="forward", rtol=rtol, atol=atol, max_steps=MOST_STEPS)
        readings = jax.vmap(lambda state: read_of(state, plant.valve))(run.states)
        return readings, (readings, jnp.where(found, run.failure, NO_EQUILIBRIUM))

    def one(inputs: StepInputs) -> tuple[Array, Array, Array]:
        slopes, (readings, failure) = jax.jacfwd(lambda q: read(q, inputs), has_aux=True)(p)
        return readings, slopes, failure

    # One after the other: under `jax.vmap` every loop is traced and compiled twice, and all runs wait for the longest.
    return jax.lax.map(one, inputs)


FREQUENCY_READINGS = ("amplitude_ratio", "phase")


@quickly
def responses_all(
    plan: Plan,
    p: Float[Array, " all"],
    given: Given,
    inputs: StepInputs,
    frequency: Float[Array, "runs frequencies"],
    output: Output,
    absolute: bool,
    polarity: int,
) -> tuple[Float[Array, "runs frequencies 2"], Float[Array, "runs frequencies 2 all"], Bool[Array, " runs"]]:
    """A frequency test: (amplitude ratio and phase [rad], their derivatives to the vector, whether there is an equilibrium)."""

    def all_of(p: Array) -> tuple[Array, tuple[Array, Array]]:
        values, found = responses_of(plan, p, given, inputs, frequency, (output, absolute, polarity))
        return values, (values, found)

    slopes, (values, found) = jax.jacfwd(all_of, has_aux=True)(p)
    return values, slopes, found


def responses_of(
    plan: Plan,
    p: Float[Array, " all"],
    given: Given,
    inputs: StepInputs,
    frequency: Float[Array, "runs frequencies"],
    respond: tuple[Output, bool, int],
) -> tuple[Float[Array, "runs frequencies 2"], Bool[Array, " runs"]]:
    """(amplitude ratio and phase [rad], whether there is an equilibrium); respond: output, whether absolute, polarity."""
    output, absolute, polarity = respond
    seen = tuple(name for name in plan.effects if effect_info(name).small_signal)
    entries = [i for i, name in enumerate((*plan.names, *plan.effects)) if name in (*plan.names, *seen)]

    valve, actuator = machine(given.valve, given.actuator, plan.names, seen, jnp.stack([p[i] for i in entries]))

    def one(inputs: StepInputs, frequency: Array) -> tuple[Array, Array]:
        found = frequency_response(
            valve, actuator, inputs, frequency, output=output, absolute=absolute, heat=plan.heat, polarity=polarity,
            throw=False,
        )  # fmt: skip
        return jnp.stack([found.amplitude_ratio, jnp.deg2rad(found.phase)], axis=-1), found.found

    return jax.vmap(one)(inputs, frequency)


@dataclass(frozen=True)
class Readings:
    """values {key: (rows,)}, slopes {key: (entries, rows)}, SI; a run that fails reads NaN. failure: 0, or why."""

    values: dict[Key, np.ndarray]
    slopes: dict[Key, np.ndarray]
    failure: int


@dataclass(frozen=True)
class DynamicSimulator:
    """Tests, and the valve and actuator with everything that the vector does not hold. tolerance: of the steps, scaled."""

    tests: dict[str, DynamicTest]
    valve: Valve
    actuator: Actuator
    heat: str
    polarity: int
    tolerance: float = TOLERANCE

    @cached_property
    def steps(self) -> list[StepRuns]:
        """The runs of step tests, those that share a program together."""
        return step_runs({name: test for name, test in self.tests.items() if test.kind != "frequency"})

    @cached_property
    def frequencies(self) -> dict[str, FrequencyRuns]:
        """The operating points of each frequency test."""
        return {name: frequency_runs(test) for name, test in self.tests.items() if test.kind == "frequency"}

    def read(self, names: tuple[str, ...], effects: tuple[str, ...], vector: np.ndarray) -> Readings:
        """Readings and derivatives of all channels that the tests could have, at `vector`: parameters, then amounts."""
        plan, given = self.plan(names, effects), self.given
        p = jnp.asarray(vector, dtype=float)
        into = Readings({}, {}, 0)
        failures = [self._step(self.plan_of(plan, runs), p, given, runs, into) for runs in self.steps]
        failures += [self._frequency(name, plan, p, given, runs, into) for name, runs in self.frequencies.items()]
        return Readings(into.values, into.slopes, max(failures, default=0))

    def plan(self, names: tuple[str, ...], effects: tuple[str, ...]) -> Plan:
        """What a program with these entries depends on."""
        return Plan(names, effects, self.heat, self.tolerance)  # pyright: ignore[reportArgumentType]  # one of two words

    def plan_of(self, plan: Plan, runs: StepRuns) -> Plan:
        """The plan of runs whose command a sensor may scale."""
        return plan if runs.signal is None else replace(plan, command=runs.signal)

    @property
    def given(self) -> Given:
        """What stands beside the vector."""
        return Given(self.valve, self.actuator, jnp.asarray(float(self.polarity)))

    def _step(self, plan: Plan, p: Any, given: Given, runs: StepRuns, into: Readings) -> int:
        values, slopes, failures = (np.array(part) for part in readings_and_slopes(plan, p, given, runs.inputs))
        values[failures != 0] = slopes[failures != 0] = np.nan
        for name, (run, place) in runs.rows.items():
            for i, channel in enumerate(STEP_READINGS):
                into.values[name, channel] = values[run, place, i]
                into.slopes[name, channel] = slopes[run, place, i].T
        return int(np.max(failures))

    def _frequency(self, name: str, plan: Plan, p: Any, given: Given, runs: FrequencyRuns, into: Readings) -> int:
        test = self.tests[name]
        values, slopes, found = (
            np.array(part)
            for part in responses_all(
                plan,
                p,
                given,
                runs.inputs,
                runs.frequency,
                test.output,  # pyright: ignore[reportArgumentType]  # one of three words, checked
                test.absolute,
                self.polarity,
            )
        )
        values[~found] = slopes[~found] = np.nan
        for i, channel in enumerate(FREQUENCY_READINGS):
            into.values[name, channel] = values[runs.run, runs.place, i]
            into.slopes[name, channel] = slopes[runs.run, runs.place, i].T
        return 0 if np.all(found) else 1


Whiten = Callable[[Key, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Weighing:
    """How each row of a dynamic test counts in a fit.

    weight {key: (rows,)}, 1/standard deviation and 0 where a row is masked out; pad: rows that a channel is padded to.
    whiten(key, (entries, rows)): makes correlated noise white along the last axis; None where it is taken for white.
    """

    weight: Mapping[Key, np.ndarray]
    pad: Callable[[int], int] = lambda rows: rows
    whiten: Whiten | None = None


def rows_of_readings(
    simulator: DynamicSimulator,
    names: tuple[str, ...],
    effects: tuple[str, ...],
    weighing: Weighing,
    vector: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (m,) and columns (entries, m) of all channels behind one another. names, effects: what `vector` holds."""
    found = simulator.read(names, effects, vector)
    parts, columns = [], []
    for key, test, reading in readings_of(simulator.tests):
        weight = weighing.weight[key]
        rows = np.concatenate([(found.values[key] - reading)[None], found.slopes[key]]) * weight
        rows = np.where(weight > 0.0, rows, 0.0)  # a masked row may hold NaN
        if weighing.whiten is not None:
            rows = weighing.whiten(key, rows)
        rows = np.pad(rows, ((0, 0), (0, weighing.pad(test.rows) - test.rows)))
        parts.append(rows[0])
        columns.append(rows[1:])
    return np.concatenate(parts), np.concatenate(columns, axis=1)


def readings_of(tests: Mapping[str, DynamicTest]) -> list[tuple[Key, DynamicTest, np.ndarray]]:
    """Every measured channel: key, test, readings (rows,), in the order of the residuals."""
    return [((name, c.name), test, c.value) for name, test in tests.items() for c in test.channels]


def simulator_of(record: BenchRecord, plans: Mapping[str, ParameterPlan], effects=None) -> DynamicSimulator:
    """The record's dynamic tests on its machine, held parameters at their starts."""
    machine = require_actuator(record)
    known = {name: plan for name, plan in plans.items() if name in PARAMETERS or name in IN_MOTION}
    values = {name: plan.start for name, plan in known.items() if name != "heat_retention" or plan.start > 0.0}
    valve = valve_of(record, values, effects)
    actuator = actuator_of(machine, record.valve.rated_current, values)
    return DynamicSimulator(record.dynamic_tests, valve, actuator, machine.heat, record.valve.polarity)


def require_actuator(record: BenchRecord) -> ActuatorData:
    """The machine of the record's dynamic tests. Raises BenchInputError where it has none."""
    if record.actuator is None:
        raise BenchInputError("holds no dynamic test; add [tests.step] or [tests.frequency]", file=record.folder)
    return record.actuator
