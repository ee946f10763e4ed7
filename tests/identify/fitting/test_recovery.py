"""Random valves from noisy records: do the 95 % intervals hold the truth as often as they say, and never a wrong minimum?"""

import numpy as np
import pytest
from helpers.records import random_valve, synthetic_record

from thermohyd.identify.fitting.fit import fit


pytestmark = pytest.mark.nightly  # statistics of many fits


NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
VALVES = 50
# The AR(1) coefficient of the noise, and whether bench.toml states its standard deviation.
KINDS = {"white, declared": (0.0, True), "white, unknown": (0.0, False), "correlated, unknown": (0.7, False)}


def test_intervals_cover_the_truth():
    everything = []
    for kind, (phi, declared) in KINDS.items():
        rng = np.random.default_rng(20261121)
        covered, wrong = [], []
        for i in range(VALVES):
            valve = random_valve(rng)
            result = fit(synthetic_record(valve, rng, phi=phi, declared=declared), starts=1)
            assert result.converged, result.message
            for name in NAMES:
                estimate, true = result.parameters[name], getattr(valve, name)
                assert estimate.std is not None, (i, name, estimate.why_no_error_bar)
                low, high = estimate.ci95 or (np.nan, np.nan)
                covered.append(low <= true <= high)
                if abs(estimate.value - true) > 6 * estimate.std:
                    wrong.append((i, name, estimate.value, true, estimate.std))
        print(
            f"{kind}: {100 * np.mean(covered):.1f} % of {len(covered)} parameter-cases covered; wrong minima: {wrong}"
        )
        assert not wrong
        # One kind alone: 50 valves whose six parameters err together leave a standard error of about 2 %.
        assert 0.88 <= np.mean(covered) <= 0.995
        everything += covered
    share = 100 * np.mean(everything)
    print(f"all kinds: {share:.1f} % of {len(everything)} covered, 90 to 98 % claimed")
    assert 90.0 <= share <= 98.0
