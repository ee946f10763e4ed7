"""The sample records of an actuator, fitted once for all tests of this folder."""

import pytest

from thermohyd.data import sample_record
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit


@pytest.fixture(scope="package")
def seed_record():
    return read_record(sample_record("seed_actuator"))


@pytest.fixture(scope="package")
def seed_fit(seed_record):
    return fit(seed_record)
