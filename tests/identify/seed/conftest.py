"""One study of the seed paper for all tests of this folder."""

import pytest

from thermohyd.identify.seed.study import SeedStudy, seed_study


@pytest.fixture(scope="session")
def study() -> SeedStudy:
    return seed_study()
