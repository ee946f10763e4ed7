"""The reference simulator against the rows of a third model: each effect alone, and all together."""

from dataclasses import fields, replace

import numpy as np
import pytest
from reference import conformance, static_tests
from reference.port_storage import swept
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
            own = found[static_tests.READING[test] if channel == "reading" else channel]
            worst = np.abs(own - expected).max() / np.abs(expected).max()
            print(f"{name}, {test}, {channel}: {worst:.1e} of the largest reading, {TOLERANCE} allowed")
            assert worst < TOLERANCE


def test_reference_reproduces_a_sweep_with_storage():
    """Hysteresis, a bushing that leaks and both ports' compliance; one fast sweep, which shows them most."""
    rows, expected, truth = conformance.rows_in_time("port_compliance_hysteresis_bushing")
    valve, oil = conformance.valve_and_oil_of(truth)
    effects = dict(truth["effects"])
    compliance = (effects.pop("port_compliance_a"), effects.pop("port_compliance_b"))
    part = np.flatnonzero(rows.run == 2)[:75]  # up, the turn, and down beyond null
    own = replace(rows, **{f.name: c[part] for f in fields(rows) if (c := getattr(rows, f.name)) is not None})
    found = swept(valve, oil, own, Effects(**effects), compliance)
    for channel, values in expected.items():
        worst = np.abs(found[channel] - values[part]).max() / np.abs(values).max()
        print(f"{channel}: {worst:.1e} of the largest reading, 1e-8 allowed")
        assert worst < 1e-8
