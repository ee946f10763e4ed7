"""What gauges and meters do at their limits, and positions without time, name nothing and hide nothing."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.small_bench import small_record
from helpers.small_diagnosis import CASES, LIBRARY, opened, small_diagnosis

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.diagnosis.diagnose import diagnose_case


CLIPPED, DEAD = 6e6, 0.05 / 6e4  # Pa, m3/s


def at_its_limits(record: BenchRecord) -> BenchRecord:
    """A gauge of 60 bar for the pressure gain, and a meter that stands at 0 below 0.05 l/min for the flow gain."""
    tests = dict(record.tests)
    for name, read in (
        ("pressure_gain", lambda value: np.clip(value, -CLIPPED, CLIPPED)),
        ("flow_gain", lambda value: np.where(np.abs(value) < DEAD, 0.0, value)),
    ):
        [channel] = tests[name].channels
        tests[name] = replace(tests[name], channels=(replace(channel, value=read(channel.value)),))
    return replace(record, tests=tests)


@pytest.mark.nightly  # a whole diagnosis
def test_a_clipped_gauge_is_said_and_an_effect_beside_it_found():
    result = diagnose_case(opened(at_its_limits(small_record(**CASES["pilot"]))))
    assert result.verdict == "named"
    [effect] = result.effects
    assert effect.name == "pilot_leakage"
    assert effect.std is not None
    assert abs(effect.value - CASES["pilot"]["effects"]["pilot_leakage"]) < 4.0 * effect.std
    [whole] = small_diagnosis("pilot").effects
    assert whole.std is not None
    assert effect.std < 1.3 * whole.std
    faults = {(fault.test, fault.name): len(fault.rows) for fault in result.after.faults}
    assert (
        {("pressure_gain", "clipped")}
        <= set(faults)
        <= {("pressure_gain", "clipped"), ("flow_gain", "meter_dead_band")}
    )
    assert faults["pressure_gain", "clipped"] > 20


def test_noisy_positions_of_a_table_without_time_name_nothing():
    record = small_record(**CASES["noisy positions"])
    tests = {name: replace(test, time=None, rate=None) for name, test in record.tests.items()}
    timeless = tuple(name for name in LIBRARY if name not in ("position_lag", "flowmeter_lag"))
    result = diagnose_case(opened(replace(record, tests=tests), timeless))
    assert result.verdict == "consistent"
    assert result.effects == ()
