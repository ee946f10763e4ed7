"""Tests without readings as a problem: readings that the model itself gives, with the noise and the instruments that are stated.

Nothing is fitted. Where bench.toml states no noise, a share of the largest reading stands in, and the plan says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.bench.columns import READINGS
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import Sensor
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.fitting.library import library_for
from thermohyd.identify.fitting.parameters import plan_parameters
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.readings import Noise
from thermohyd.identify.fitting.relative import with_relatives
from thermohyd.identify.fitting.sensed import sensor_plans
from thermohyd.identify.model.model import Model
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.reduction.reduce import reduce_test


SHARE = 1e-3  # of the largest reading: the scatter of a row where bench.toml states none
PORTS = ("pressure_a", "pressure_b")


@dataclass(frozen=True)
class Prospect:
    """A planned record as a problem, and the valve that it is expected to hold. sources {(test, channel): where its noise is from}."""

    record: BenchRecord
    problem: Problem
    fit: Fit
    sources: Mapping[tuple[str, str], str]
    notes: tuple[str, ...]

    @property
    def nuisance(self) -> np.ndarray:
        """Columns (rows, free parameters) of what a fit would adjust."""
        return self.fit.nuisance

    def seen(self, fit: Fit) -> Fit:
        """A fit at these values, as one that adjusts the free parameters."""
        return replace(fit, free=self.problem.free_parameters)


def prospect_of(record: BenchRecord, model: Model | None = None) -> Prospect:
    """The static tests of a record as they would be read. model: the valve to expect; else [start], or the nominal one.

    Raises BenchInputError where there is no static test, or every parameter is held.
    """
    if not record.static_tests:
        raise BenchInputError("has no static test to plan: only these are looked at", file=record.folder)
    notes = []
    if record.dynamic_tests:
        notes.append(f"not looked at: {', '.join(record.dynamic_tests)}; a plan is of static tests")
    expected = {} if model is None else dict(model.parameters)
    tests = {name: _with_readings(test) for name, test in record.static_tests.items()}
    problem = _problem(record, tests, {})
    read = problem.evaluate(_values(problem, expected))
    std, sources = {}, {}
    for key, place in problem.rows().items():
        test, values = tests[key[0]], read.residual[place]  # the readings are 0, and their noise 1
        if not np.isfinite(values).all():
            raise BenchInputError(f"the model gives no finite {key[1]} in the {key[0]} test", file=record.folder)
        size, sources[key] = _size(test, key[1], values)
        if sources[key].startswith("taken"):
            notes.append(
                f"{key[0].replace('_', ' ')}: no noise is stated, {100.0 * SHARE:g} % of the largest {key[1]} is taken"
            )
        slope = read.column("null_bias")[place]
        std[key] = np.hypot(np.full(test.rows, size), slope * (test.position_std or 0.0))
        channels = tuple(
            replace(c, value=values, std=std[key], sensor=_instrument(test, record, c.name, values))
            if c.name == key[1]
            else c
            for c in test.channels
        )
        tests[key[0]] = replace(test, channels=channels)
    problem = _problem(record, tests, std)
    if not problem.free_parameters:
        raise BenchInputError("[start] holds every parameter fixed; free at least one", file=record.folder)
    fit = problem.evaluate(_values(problem, expected))
    found = Prospect(record, problem, fit, sources, tuple(notes))
    return replace(found, fit=problem.with_all_columns(found.seen(fit)))


def _values(problem: Problem, expected: Mapping[str, float]) -> dict[str, float]:
    return {name: expected.get(name, plan.start) for name, plan in problem.plans.items()}


def _problem(
    record: BenchRecord, tests: Mapping[str, TestRecord], std: Mapping[tuple[str, str], np.ndarray]
) -> Problem:
    keys = [(test.name, c.name) for test in tests.values() for c in test.channels]
    plans = plan_parameters(record.valve, record.start) | sensor_plans(tests, record)
    noise = Noise(
        {key: std.get(key, np.ones(tests[key[0]].rows)) for key in keys}, dict.fromkeys(keys, NoiseCorrelation())
    )
    return Problem(record, dict(tests), with_relatives(plans, tests, record), library_for(tests.values()), noise)


def _with_readings(test: TestRecord) -> TestRecord:
    """The test with the channels that it will read, all 0 so far; a log of an earlier test is reduced."""
    if test.channels and test.rows > 2000:
        test = reduce_test(test)
    names = [c.name for c in test.channels] or _planned_channels(test)
    zero = np.zeros(test.rows)
    return replace(test, channels=tuple(Channel(name, zero) for name in names), faults=())


def _planned_channels(test: TestRecord) -> list[str]:
    """Both ports where their noise alone is stated; else the first reading of the test."""
    first = next(iter(READINGS[test.name]))
    both = set(PORTS) <= set(test.stated_noise) and first not in test.stated_noise
    return list(PORTS) if both else [first]


def _size(test: TestRecord, channel: str, values: np.ndarray) -> tuple[float, str]:
    if channel in test.stated_noise:
        return test.stated_noise[channel], "stated in bench.toml"
    largest = float(np.max(np.abs(values), initial=0.0))
    return SHARE * largest or 1.0, f"taken as {100.0 * SHARE:g} % of the largest reading"


def _instrument(test: TestRecord, record: BenchRecord, channel: str, values: np.ndarray) -> Sensor | None:
    """What bench.toml says of the instrument's gain and zero."""
    if channel in record.sensors:
        return record.sensors[channel] if record.sensors[channel].signal == "" else None
    gain, zero = test.stated_instrument
    if gain is None and zero is None:
        return None
    size = float(np.max(np.abs(values), initial=0.0))
    return Sensor(channel, tolerance=gain, zero_tolerance=None if zero is None or size == 0.0 else zero * size)
