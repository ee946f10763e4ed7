"""The reference simulator against the rows of a third model: each effect alone, and all together."""

from dataclasses import replace

import numpy as np
import pytest
from reference import conformance, static_tests
from reference.valve import Effects


TOLERANCE = 1e-8  # of each test's largest reading


@pytest.mark.parametrize("test", conformance.TESTS)
@pytest.mark.parametrize("effect", list(conformance.truth()["effects"]))
def test_reference_reproduces_the_conformance_rows(effect, test):
    valve, oil = conformance.valve_and_oil()
    readings = static_tests.TESTS[test](valve, oil, conformance.rows_of(test), conformance.effects_of(effect))
    expected = conformance.readings_of(test, effect)
    worst = np.abs(readings[static_tests.READING[test]] - expected).max() / np.abs(expected).max()
    print(f"{test} with {effect}: {worst:.1e} of the largest reading, {TOLERANCE} allowed")
    assert worst < TOLERANCE


def test_every_effect_moves_its_test():
    """An effect that changed nothing would pass every comparison with itself switched off."""
    for effect in conformance.truth()["effects"]:
        moved = [
            np.abs(conformance.readings_of(t, effect) / conformance.readings_of(t, "none") - 1.0).max()
            for t in conformance.TESTS
        ]
        assert effect == "none" or max(moved) > 1e-4, effect


@pytest.mark.parametrize(
    "name", [name for name, file in conformance.more_truth()["files"].items() if file["kind"] == "static"]
)
def test_reference_reproduces_the_fourth_model(name):
    more = conformance.more_rows(name)
    valve, oil = conformance.valve_and_oil_of(more.truth)
    # The null bias is stated at the supply pressure of the record's first row.
    valve = replace(valve, null_pressure=more.rows["leakage"].supply_pressure[0])
    for test, rows in more.rows.items():
        found = static_tests.TESTS[test](valve, oil, rows, Effects(**more.truth["effects"]))
        for channel, expected in more.readings[test].items():
            if np.all(np.isnan(expected)):
                continue
            own = found[static_tests.READING[test] if channel == "reading" else channel]
            worst = np.abs(own - expected).max() / np.abs(expected).max()
            print(f"{name}, {test}, {channel}: {worst:.1e} of the largest reading, {TOLERANCE} allowed")
            assert worst < TOLERANCE
