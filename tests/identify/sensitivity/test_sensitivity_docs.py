"""The examples in the docstrings run as they stand."""

import doctest
from importlib import import_module

import pytest


@pytest.mark.parametrize("name", ["curves", "drift", "global_measures", "next_test", "study"])
def test_examples(name):
    found = doctest.testmod(import_module(f"thermohyd.identify.sensitivity.{name}"))
    assert found.attempted > 0
    assert found.failed == 0
