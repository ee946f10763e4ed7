"""The fast NumPy path of the benchmark against the general reference: same numbers, or it is no fair peer."""

from dataclasses import replace

import numpy as np
import pytest
from reference import isothermal, static_tests
from reference.oil import Oil, seed_oil, walther
from reference.valve import Rows, Valve


def random_case(seed: int) -> tuple[Valve, Oil, Rows]:
    random = np.random.default_rng(seed)
    n = 500
    um = lambda low, high: random.uniform(low, high) * 1e-6
    valve = Valve(
        edge_radius=um(1, 25),
        clearance=um(0.5, 6),
        underlap=um(-30, 30),
        discharge_coefficient=random.uniform(0.4, 0.9),
        transition_number=random.uniform(20, 300),
        null_bias=um(-5, 5),
    )
    rows = Rows(
        random.uniform(-1.0, 1.0, n) ** 3 * 213e-6,
        random.uniform(20e5, 300e5, n),
        random.uniform(0.0, 5e5, n),
        random.uniform(233.15, 373.15, n),
    )
    return valve, random.choice(np.array([seed_oil(), Oil(*walther([(40.0, 32.0), (100.0, 5.4)]))])), rows


def vector(valve: Valve) -> np.ndarray:
    return np.array([getattr(valve, name) for name in isothermal.PARAMETERS])


@pytest.mark.parametrize("test", ["leakage", "pressure_gain", "flow_gain"])
@pytest.mark.parametrize("seed", range(10))
def test_fast_path_equals_the_general_one(seed, test):
    valve, oil, rows = random_case(seed)
    expected = static_tests.TESTS[test](valve, oil, rows)[static_tests.READING[test]]
    prepared, width = isothermal.IsothermalRows.of(rows, oil), float(valve.slot_width)
    fast, roots = isothermal.simulate(test, prepared, width, vector(valve))
    assert np.abs(fast - expected).max() < 1e-13 * np.abs(expected).max()
    again, _ = isothermal.simulate(test, prepared, width, vector(valve), start=roots, tolerance=1e-4)
    assert np.abs(again - expected).max() < 1e-13 * np.abs(expected).max()


def test_an_oil_with_pressure_viscosity_is_refused():
    _, oil, rows = random_case(0)
    with pytest.raises(ValueError, match="pressure-viscosity"):
        isothermal.IsothermalRows.of(rows, replace(oil, pressure_viscosity=1e-8))
