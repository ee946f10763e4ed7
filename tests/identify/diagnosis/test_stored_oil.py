"""Oil stored at the ports and what resembles it, loops and lags: each is named where it is missing, and not the others."""

import pytest
from helpers.small_bench import blocked_record
from helpers.small_diagnosis import opened

from thermohyd.identify.diagnosis.diagnose import diagnose_case


pytestmark = pytest.mark.nightly  # whole diagnoses


NAMES = (
    "viscosity_shift", "port_compliance_a", "port_compliance_b", "flowmeter_lag", "hysteresis", "position_lag",
)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "amount", "record"),
    [
        ("port_compliance_a", 6e-13, lambda: blocked_record((6e-13, 0.0), seed=1)),
        ("hysteresis", 1e-6, lambda: blocked_record(seed=2, hysteresis=1e-6)),
    ],
)
def test_what_is_missing_is_named(name, amount, record):
    result = diagnose_case(opened(record(), NAMES))
    assert result.verdict == "named"
    [effect] = result.effects
    assert effect.name == name
    assert effect.std is not None
    assert abs(effect.value - amount) < 4.0 * effect.std
    assert not effect.alternatives
    assert result.gap_after < 1.3 < result.gap_before
