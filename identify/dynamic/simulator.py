"""A record's dynamic tests as one function of named parameters and amounts: readings and derivatives at its rows."""

from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
import numpy as np

from thermohyd.actuator import Actuator
from thermohyd.valve import Valve

from ..record import DynamicTest
from . import responses, trajectories
from .runs import FrequencyRuns, StepRuns, frequency_runs, step_runs
from .trajectories import Given, Plan


Key = tuple[str, str]  # test, channel


@dataclass(frozen=True)
class Readings:
    """values {key: (rows,)}, slopes {key: (entries, rows)}, SI; a run that fails reads NaN. failure: 0, or why."""

    values: dict[Key, np.ndarray]
    slopes: dict[Key, np.ndarray]
    failure: int


@dataclass
class DynamicSimulator:
    """Tests, and the valve and actuator with everything that the vector does not hold. tolerance: of the steps, scaled."""

    tests: dict[str, DynamicTest]
    valve: Valve
    actuator: Actuator
    heat: str
    polarity: int
    tolerance: float = trajectories.TOLERANCE
    _runs: dict[str, Any] = field(default_factory=dict)

    def read(self, names: tuple[str, ...], effects: tuple[str, ...], vector: np.ndarray) -> Readings:
        """Readings and derivatives of all channels that the tests could have, at `vector`: parameters, then amounts."""
        plan = Plan(names, effects, self.heat, self.tolerance)  # pyright: ignore[reportArgumentType]  # one of two words
        given = Given(self.valve, self.actuator, jnp.asarray(float(self.polarity)))
        p = jnp.asarray(vector, dtype=float)
        found = Readings({}, {}, 0)
        failure = 0
        for name, test in self.tests.items():
            runs = self._runs_of(name, test)
            if isinstance(runs, StepRuns):
                failure = max(failure, self._step(name, plan, p, given, runs, found))
            else:
                failure = max(failure, self._frequency(name, test, plan, p, given, runs, found))
        return Readings(found.values, found.slopes, failure)

    def _runs_of(self, name: str, test: DynamicTest) -> StepRuns | FrequencyRuns:
        if name not in self._runs:
            self._runs[name] = frequency_runs(test) if test.name == "frequency" else step_runs(test)
        return self._runs[name]

    def _step(self, name: str, plan: Plan, p: Any, given: Given, runs: StepRuns, into: Readings) -> int:
        values, slopes, failures = (
            np.array(part) for part in trajectories.readings_and_slopes(plan, p, given, runs.inputs)
        )
        values[failures != 0] = slopes[failures != 0] = np.nan
        for i, channel in enumerate(trajectories.READINGS):
            into.values[name, channel] = values[runs.run, runs.place, i]
            into.slopes[name, channel] = slopes[runs.run, runs.place, i].T
        return int(np.max(failures))

    def _frequency(
        self, name: str, test: DynamicTest, plan: Plan, p: Any, given: Given, runs: FrequencyRuns, into: Readings
    ) -> int:
        values, slopes, found = (
            np.array(part)
            for part in responses.responses_all(
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
        for i, channel in enumerate(responses.READINGS):
            into.values[name, channel] = values[runs.run, runs.place, i]
            into.slopes[name, channel] = slopes[runs.run, runs.place, i].T
        return 0 if np.all(found) else 1
