"""A record as instruments with a signal in volts would have logged it."""

from dataclasses import replace

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import Sensor


# A flow meter wired the other way round, 2.5 l/min per volt; a gauge of 40 bar per volt.
GAIN, ZERO = -2.5 / 6e4, 0.3
PER_VOLT = {"leakage_flow": GAIN, "flow": 5.0 / 6e4, "load_pressure": 40e5}


def in_volts(record: BenchRecord, *sensors: Sensor) -> BenchRecord:
    """The record as instruments of PER_VOLT would have logged it, all with their zero at ZERO."""
    by_name = {sensor.column: sensor for sensor in sensors}
    tests = {}
    for name, test in record.tests.items():
        channels = []
        for c in test.channels:
            sensor = by_name.get(c.name)
            if sensor is not None:
                volts = c.value / PER_VOLT[c.name] + ZERO
                kept = sensor.reference * (volts - sensor.reference_zero)
                std = None if c.std is None else c.std * abs(sensor.reference / PER_VOLT[c.name])
                c = replace(c, value=kept, std=std, sensor=sensor)
            channels.append(c)
        tests[name] = replace(test, channels=tuple(channels))
    return replace(record, tests=tests, sensors=by_name)
