"""Conditions as an engineer says them."""

import pytest

from thermohyd.identify.diagnosis.where import region_words


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({}, "everywhere"),
        ({"spool_position": (-12e-6, 35.4e-6)}, "-12 to 35 um"),
        ({"temperature": (293.15, 293.15), "spool_position": (0.0, 2.5e-6)}, "0.00 to 2.50 um, 20 degC"),
        ({"direction": (-1.0, -1.0)}, "falling sweeps"),
        ({"direction": (1.0, 1.0), "supply_pressure": (69e5, 71e5)}, "rising sweeps, 69 to 71 bar supply"),
        ({"direction": (-1.0, 1.0)}, "everywhere"),
        ({"rate": (10e-6, 52e-6)}, "10 to 52 um/s"),
        ({"elapsed": (0.0, 49.6)}, "0 to 50 s"),
        ({"run": (1.0, 1.0)}, "run fast"),
        ({"run": (0.0, 1.0)}, "runs slow to fast"),
        ({"run": (4.0, 5.0)}, "runs 4 to 5"),
        ({"load_pressure": (-20e5, 35e5)}, "-20 to 35 bar load"),
        ({"reynolds": (120.0, 3400.0)}, "reynolds 120 to 3400"),
    ],
)
def test_regions(limits, expected):
    assert region_words(limits, ("slow", "fast")) == expected
