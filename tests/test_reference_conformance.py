"""The reference simulator against the rows of a third model: each effect alone, and all together."""

import numpy as np
import pytest
from reference import conformance, static_tests


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
