"""What sensors of unknown gain or zero make of the model's readings: their parameters, where these start, and residuals behind them.

A signal is (quantity/gain + zero); readings are kept as reference * (signal - reference zero), see `bench.sensors`. So a reading
is a * quantity + b, linear in the quantity, and acts on residuals and columns of any model of the quantity alike. NumPy only.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermohyd.identify.bench.columns import KIND_OF
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import EACH_RUN, Sensor
from thermohyd.identify.bench.shown_units import KINDS
from thermohyd.identify.bench.test_record import Channel, DynamicTest, TestRecord

from .parameters import ParameterInfo, ParameterPlan, Prior


Key = tuple[str, str]  # test, channel

# Of a free gain about its start, which a regression on the nominal model gives: beyond it that model says nothing.
WITHIN = 50.0
FAR = 10.0  # tolerances on either side of a stated value
MOST = 20.0  # times the largest signal that a free zero may lie away


@dataclass(frozen=True)
class Sensed:
    """A channel's sensor by the names of its parameters. gain: "" where it is exact; zeros and masks (zeros, rows): which zero
    is that of which rows; none where the zero is exact."""

    sensor: Sensor
    gain: str
    zeros: tuple[str, ...]
    masks: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return (self.gain, *self.zeros) if self.gain else self.zeros

    def factor(self, values: Mapping[str, Any]) -> Any:
        """a of the readings: a number, traced where the values are."""
        return self.sensor.reference / values[self.gain] if self.gain else 1.0

    def shifts(self, values: Mapping[str, Any]) -> list[Any]:
        """b of the rows of each mask; one for all rows where there is no free zero. Numbers, traced where the values are."""
        own = [values[name] for name in self.zeros] or [self.sensor.zero]
        return [self.sensor.reference * (zero - self.sensor.reference_zero) for zero in own]

    @property
    def rows(self) -> np.ndarray:
        """(masks or 1, rows): where each shift acts."""
        return self.masks if self.zeros else np.ones((1, self.masks.shape[1]))

    def readings(
        self, values: Mapping[str, float], quantity: np.ndarray
    ) -> tuple[np.ndarray, float, dict[str, np.ndarray]]:
        """(readings (rows,) of a quantity (rows,), what its derivatives are multiplied by, derivatives to the own parameters)."""
        factor, slopes = self.factor(values), {}
        if self.gain:
            slopes[self.gain] = -factor / values[self.gain] * quantity
        slopes |= {name: self.sensor.reference * mask for name, mask in zip(self.zeros, self.masks, strict=False)}
        return factor * quantity + np.array(self.shifts(values)) @ self.rows, factor, slopes


def gain_name(sensor: Sensor) -> str:
    """The parameter that is the gain; empty where it is exact."""
    return f"{sensor.column}_gain" if sensor.gain is None or sensor.tolerance else ""


def zero_name(sensor: Sensor) -> str:
    """The parameter that is the zero of all runs; empty where it is exact, or each run's own."""
    free = sensor.zero_tolerance or (sensor.free_zero and sensor.free_zero != EACH_RUN)
    return f"{sensor.column}_zero" if free else ""


def sensed(test: TestRecord, channel: Channel) -> Sensed | None:
    """The channel's sensor; None where its readings are what the model computes."""
    sensor = channel.sensor
    if sensor is None:
        return None
    if sensor.free_zero == EACH_RUN:
        codes = np.unique(test.run)
        names = tuple("_".join(filter(None, (sensor.column, "zero", test.name, test.run_names[c]))) for c in codes)
        return Sensed(sensor, gain_name(sensor), names, (test.run == codes[:, None]).astype(float))
    name = zero_name(sensor)
    return Sensed(sensor, gain_name(sensor), (name,) if name else (), np.ones((1, test.rows)))


def sensed_channels(tests: Mapping[str, TestRecord]) -> dict[Key, Sensed]:
    """{(test, channel): sensor} of all channels behind one."""
    found = {(t.name, c.name): sensed(t, c) for t in tests.values() for c in t.channels}
    return {key: behind for key, behind in found.items() if behind is not None}


def traced(tests: Mapping[str, TestRecord], record: BenchRecord) -> tuple[str, ...]:
    """Parameters of sensors that the simulation itself depends on: of a command in volts, of the loop's own sensor."""
    found = []
    for test in tests.values():
        if not isinstance(test, DynamicTest):
            continue
        loop = record.sensors.get("piston_position")
        sensors = [test.command_sensor]
        if loop is not None and loop.in_loop and test.command_kind == "setpoint":
            found.append(gain_name(loop))
        found += [name for s in sensors if s is not None for name in (gain_name(s), zero_name(s))]
    return tuple(dict.fromkeys(filter(None, found)))


def signal_unit(sensor: Sensor, per: str = "") -> str:
    """The SI unit of the zero; with `per` = "gain" that of the gain."""
    kind = KINDS["length" if sensor.column == "command" else KIND_OF[sensor.column]]
    quantity = (kind.si or kind.label).replace("^", "**")
    signal = sensor.signal or ""
    if per and not signal:
        return "dimensionless"
    return f"{quantity}/{signal}" if per else signal or quantity


def sensor_plans(tests: Mapping[str, TestRecord], record: BenchRecord) -> dict[str, ParameterPlan]:
    """{parameter: plan} of all that sensors leave open, free ones at stand-ins until `with_starts`."""
    plans: dict[str, ParameterPlan] = {}
    for test in tests.values():
        for channel in test.channels:
            behind = sensed(test, channel)
            if behind is not None:
                size = float(np.max(np.abs(channel.value / behind.sensor.reference), initial=0.0)) or 1.0
                plans |= {n: _plan(n, behind.sensor, size) for n in behind.names if n not in plans}
        if isinstance(test, DynamicTest) and test.command_sensor is not None:
            s = test.command_sensor
            size = float(np.max(np.abs(test.command / test.command_reference), initial=0.0)) or 1.0
            for name in filter(None, (gain_name(s), zero_name(s))):
                start = test.command_reference if name == gain_name(s) and s.gain is None else None
                plans[name] = _plan(name, s, size, start)
    loop = record.sensors.get("piston_position")
    if loop is not None and (name := gain_name(loop)) in traced(tests, record):
        assert record.actuator is not None
        assert record.actuator.sensor_gain is not None
        # Beside a start of its own, nothing is to be read off a run that follows its setpoint whatever the gain.
        if loop.gain is None or name not in plans:
            plans[name] = _plan(name, loop, 1.0, 1.0 / record.actuator.sensor_gain if loop.gain is None else None)
    return plans


def _plan(name: str, sensor: Sensor, size: float, start: float | None = None) -> ParameterPlan:
    """size: of the signals. start: of a free gain, where something says it."""
    if name == gain_name(sensor):
        of = f"gain of the sensor of {sensor.column}"
        if sensor.gain is None:
            return _about(ParameterInfo(name, signal_unit(sensor, "gain"), 1.0, 0.0, 1.0, 1.0, of), start or 1.0)
        assert sensor.tolerance is not None
        std = sensor.tolerance * abs(sensor.gain)
        reach = min(FAR * std, 0.9 * abs(sensor.gain))
        low, high = sensor.gain - reach, sensor.gain + reach
        info = ParameterInfo(name, signal_unit(sensor, "gain"), sensor.gain, low, high, std, of)
        return ParameterPlan(info, sensor.gain, False, low, high, Prior(sensor.gain, std), given=True)
    std = sensor.zero_tolerance
    reach = MOST * size if std is None else FAR * std
    low, high = sensor.zero - reach, sensor.zero + reach
    words = f"signal of the sensor of {sensor.column} at zero"
    info = ParameterInfo(name, signal_unit(sensor), sensor.zero, low, high, std or 0.01 * size, words)
    prior = None if std is None else Prior(sensor.zero, std)
    return ParameterPlan(info, sensor.zero, False, low, high, prior, given=prior is not None)


def _about(info: ParameterInfo, start: float) -> ParameterPlan:
    """The plan of a free gain, of either sign, about its start."""
    low, high = sorted((start / WITHIN, start * WITHIN))
    info = replace(info, nominal=start, lower=low, upper=high, scale=0.3 * abs(start))
    return ParameterPlan(info, start, False, low, high)


def with_starts(
    plans: Mapping[str, ParameterPlan],
    tests: Mapping[str, TestRecord],
    quantities: Mapping[Key, np.ndarray],
    settled: tuple[str, ...] = (),
) -> dict[str, ParameterPlan]:
    """The plans with free gains and zeros started where a regression of the signals on the nominal model's readings says.

    quantities {(test, channel): (rows,)}, SI. settled: gains that already have a start of their own.
    """
    found, done = dict(plans), set(settled)
    for key, behind in sensed_channels(tests).items():
        test = tests[key[0]]
        measured = test.channel(key[1]).value
        sensor, q = behind.sensor, quantities[key]
        good = np.isfinite(q) & np.isfinite(measured)
        free_gain = sensor.gain is None and behind.gain not in done
        free_zeros = bool(behind.zeros) and sensor.zero_tolerance is None
        shift = (
            0.0
            if free_zeros
            else behind.shifts({})[0]
            if not behind.zeros
            else behind.shifts({behind.zeros[0]: sensor.zero})[0]
        )
        columns = [q] if free_gain else []
        columns += [*behind.masks] if free_zeros else []
        if not columns or good.sum() <= len(columns):
            continue
        factor = 1.0 if free_gain or not behind.gain else sensor.reference / found[behind.gain].start
        rest = measured - np.sum(shift) - (0.0 if free_gain else factor * q)
        matrix = np.stack(columns, axis=1)[good]
        size = np.sqrt(np.sum(matrix**2, axis=0))
        size[size == 0.0] = 1.0
        answer = np.linalg.lstsq(matrix / size, rest[good], rcond=1e-10)[0] / size
        if free_gain:
            slope = float(answer[0])
            spread = float(np.std(q[good])) or float(np.mean(np.abs(q[good]))) or 1.0
            least = 1e-3 * float(np.std(measured[good])) / spread
            sign = -1.0 if slope < 0.0 else 1.0
            gain = sign / max(abs(slope), least) if max(abs(slope), least) > 0.0 else 1.0
            old = found[behind.gain]
            found[behind.gain] = replace(_about(old.info, gain), relative=old.relative)
            done.add(behind.gain)
        if free_zeros:
            for name, shifted in zip(behind.zeros, answer[int(free_gain) :], strict=True):
                plan = found[name]
                start = float(shifted) / sensor.reference + sensor.reference_zero
                found[name] = replace(plan, start=float(np.clip(start, plan.lower, plan.upper)))
    return found


@dataclass(frozen=True)
class SignalRows:
    """A channel behind a sensor among whitened residuals: its place, its whitened readings (rows,) and masks (masks, rows)."""

    place: slice
    behind: Sensed
    readings: np.ndarray
    masks: np.ndarray

    def act(
        self, residual: np.ndarray, columns: np.ndarray, values: Mapping[str, float], order: tuple[str, ...]
    ) -> None:
        """Put the sensor behind model - reading: residual (rows,) and columns (entries, rows) of all channels, in place."""
        sensor, factor = self.behind.sensor, self.behind.factor(values)
        quantity = residual[self.place] + self.readings
        residual[self.place] = factor * quantity + np.array(self.behind.shifts(values)) @ self.masks - self.readings
        columns[:, self.place] *= factor
        if self.behind.gain:
            columns[order.index(self.behind.gain), self.place] -= factor / values[self.behind.gain] * quantity
        for name, mask in zip(self.behind.zeros, self.masks, strict=False):
            columns[order.index(name), self.place] += sensor.reference * mask
