"""Least trimmed squares: a line through most rows, where the others are bent beyond what a fit to all rows survives."""

import numpy as np
import pytest

from thermohyd.identify.fitting.trimmed import SHARE, trimmed_points


ROWS = {("leakage", "leakage_flow"): slice(0, 40), ("pressure_gain", "load_pressure"): slice(40, 70)}
X = np.linspace(-1.0, 1.0, 70)


def points(read: np.ndarray, asked: np.ndarray) -> list[np.ndarray]:
    fit_to = lambda kept, at: np.polyfit(X[kept], read[kept], 1)
    return trimmed_points(np.zeros(2), ROWS, asked, fit_to, lambda at: np.polyval(at, X) - read)


@pytest.mark.parametrize("bent", [slice(40, 66), slice(0, 26)])
def test_the_line_of_most_rows_is_found(bent):
    read = 2.0 * X + 0.5 + 1e-3 * np.sin(40.0 * X)
    read[bent] += 30.0 * (X[bent] - X[bent].mean()) + 8.0
    assert np.abs(np.polyfit(X, read, 1) - [2.0, 0.5]).max() > 1.0
    best = points(read, np.ones(70, dtype=bool))[0]
    np.testing.assert_allclose(best, [2.0, 0.5], atol=2e-3)


def test_rows_that_do_not_count_are_never_asked():
    read = 2.0 * X + 0.5
    asked = np.ones(70, dtype=bool)
    asked[::7] = False
    read[~asked] = np.nan
    np.testing.assert_allclose(points(read, asked)[0], [2.0, 0.5])


def test_a_point_without_readings_is_left_out():
    assert points(np.full(70, np.nan), np.ones(70, dtype=bool)) == []
    assert 0.5 < SHARE < 1.0
