"""The reference simulator's second edge law: its film against closed forms, its tests against the rows of a third model."""

import numpy as np
import pytest
from reference import conformance_lubrication as conformance, static_tests
from reference.film import film_integral


TOLERANCE = 1e-8  # of each test's largest reading


@pytest.mark.parametrize("test", conformance.TESTS)
@pytest.mark.parametrize("name", conformance.NAMES)
def test_reference_reproduces_the_conformance_rows(name, test):
    valve, oil, effects = conformance.valve_of(name)
    rows, expected = conformance.rows_and_readings(name, test)
    readings = static_tests.TESTS[test](valve, oil, rows, effects)
    found = {"reading": readings[static_tests.READING[test]], **readings}
    for channel, values in expected.items():
        worst = np.abs(found[channel] - values).max() / np.abs(values).max()
        print(f"{test}, {channel}, {name}: {worst:.1e} of the largest reading, {TOLERANCE} allowed")
        assert worst < TOLERANCE


def test_film_where_it_is_known():
    c = 2e-6
    # r = 0 is the land alone, and nothing where the edge is open
    np.testing.assert_allclose(film_integral(np.array([-5e-6, 0.0, 3e-6]), 0.0, c), [5e-6 / c**3, 0.0, 0.0], rtol=1e-14)
    # from u = 2 r on there is no film
    assert film_integral(2e-5, 1e-5, c) == 0.0 == film_integral(3e-5, 1e-5, c)
    # Two parabolas in a narrow gap: the journal bearing's (3 pi/8) sqrt(2 r c)/c^3, next term of the order c/r
    thin = 1e-8
    np.testing.assert_allclose(
        film_integral(0.0, 1e-4, thin), 3.0 * np.pi / 8.0 * np.sqrt(2e-4 * thin) / thin**3, rtol=1e-4
    )
    # A wide gap does not see the arcs: length over c^3
    np.testing.assert_allclose(film_integral(0.0, 1e-9, 1e-3), 2e-9 / 1e-9, rtol=1e-5)
