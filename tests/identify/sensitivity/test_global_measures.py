"""Sobol indices and derivative-based measures against the Ishigami function, whose indices are known."""

import numpy as np
import pytest

from thermohyd.identify.sensitivity.global_measures import (
    base_of,
    derivative_measures,
    sobol_indices,
    sobol_samples,
    total_along,
    uniform_constant,
)


A, B = 7.0, 0.1
INPUTS = ("x1", "x2", "x3")
# Ishigami and Homma, 1990: with D = a^2/8 + b pi^4/5 + b^2 pi^8/18 + 1/2.
VARIANCE = A**2 / 8 + B * np.pi**4 / 5 + B**2 * np.pi**8 / 18 + 0.5
ALONE = np.array([0.5 * (1 + B * np.pi**4 / 5) ** 2, A**2 / 8, 0.0]) / VARIANCE
PAIR = 8 * B**2 * np.pi**8 / 225 / VARIANCE  # x1 with x3, the only interaction
TOTAL = ALONE + np.array([PAIR, 0.0, PAIR])


def ishigami(unit: np.ndarray) -> np.ndarray:
    x = np.pi * (2.0 * unit - 1.0)
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


@pytest.fixture(scope="module")
def study():
    unit = sobol_samples(3, 4096)
    values = np.stack([ishigami(unit), np.ones(len(unit)), 1e-9 * ishigami(unit)], axis=1)
    return unit, values, sobol_indices(values, INPUTS, ("ishigami", "constant", "tiny"))


def test_indices_of_ishigami(study):
    found = study[2]
    np.testing.assert_allclose(found.first[0], ALONE, atol=0.02)
    np.testing.assert_allclose(found.total[0], TOTAL, atol=0.02)
    assert np.all(np.abs(found.total[0] - TOTAL) < 2.0 * found.total_ci[0])
    assert found.variance[0] == pytest.approx(VARIANCE, rel=0.01)
    assert found.mean[0] == pytest.approx(A / 2, rel=0.01)
    assert found.evaluations == 4096 * 5


def test_units_do_not_matter_and_constants_have_no_index(study):
    found = study[2]
    np.testing.assert_allclose(found.total[2], found.total[0], rtol=1e-9)
    assert not found.total[1].any()


def test_totals_of_many_outputs_are_those_of_one(study):
    _, values, found = study
    np.testing.assert_allclose(total_along(values, 3).T, found.total, rtol=1e-9, atol=1e-12)


def test_derivatives_bound_the_totals(study):
    unit, _, found = study
    x = np.pi * (2.0 * unit[::5] - 1.0)  # the plain samples of the study
    slopes = np.stack(
        [
            np.cos(x[:, 0]) * (1.0 + B * x[:, 2] ** 4),
            2.0 * A * np.sin(x[:, 1]) * np.cos(x[:, 1]),
            4.0 * B * x[:, 2] ** 3 * np.sin(x[:, 0]),
        ],
        axis=1,
    )[:, :, None]
    width = np.full(3, 2.0 * np.pi)
    measures = derivative_measures(slopes, np.array([VARIANCE]), uniform_constant(width), INPUTS, ("ishigami",))
    # E of the squares: (1 + 2 b pi^4/5 + b^2 pi^8/9)/2, a^2/2, 16 b^2 pi^6/14
    exact = [(1 + 2 * B * np.pi**4 / 5 + B**2 * np.pi**8 / 9) / 2, A**2 / 2, 8 * B**2 * np.pi**6 / 7]
    np.testing.assert_allclose(measures.nu[0], exact, rtol=0.02)
    assert np.all(measures.bound[0] >= found.total[0] - found.total_ci[0])


@pytest.mark.parametrize(("evaluations", "inputs", "base"), [(65_536, 14, 4096), (65_535, 14, 2048), (10, 14, 8)])
def test_base_is_a_power_of_two_within_the_budget(evaluations, inputs, base):
    assert base_of(evaluations, inputs) == base
