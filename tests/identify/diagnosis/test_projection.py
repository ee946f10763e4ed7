"""Projection beside nuisance columns: orthonormal, of the right rank, and exact to rounding for any scale."""

import numpy as np
import pytest

from thermohyd.identify.diagnosis.screening import Projection


@pytest.fixture
def columns():
    rng = np.random.default_rng(1)
    return rng.standard_normal((60, 5)) * np.array([1e-9, 1.0, 1e9, 1e-3, 1e5])


def test_orthonormal_and_blind_to_its_columns(columns):
    p = Projection.beside(columns)
    assert p.rank == 5
    np.testing.assert_allclose(p.q.T @ p.q, np.eye(5), atol=1e-14)
    assert np.all(np.linalg.norm(p(columns), axis=0) < 1e-14 * np.linalg.norm(columns, axis=0))


def test_agrees_with_least_squares(columns):
    y = np.random.default_rng(2).standard_normal(60)
    scaled = columns / np.linalg.norm(columns, axis=0)
    expected = y - scaled @ np.linalg.lstsq(scaled, y, rcond=None)[0]
    np.testing.assert_allclose(Projection.beside(columns)(y), expected, atol=1e-13)


def test_dependent_and_empty_columns_are_dropped(columns):
    extra = np.stack([columns[:, 0] * 1e15 + columns[:, 1], np.zeros(60), columns[:, 2]], axis=1)
    p = Projection.beside(np.concatenate([columns, extra], axis=1))
    assert p.rank == 5
    np.testing.assert_allclose(p.q, Projection.beside(columns).q, atol=1e-14)


def test_nearly_dependent_columns_stay_orthogonal():
    rng = np.random.default_rng(3)
    base = rng.standard_normal((60, 4))
    near = base @ rng.standard_normal((4, 3)) + 1e-6 * rng.standard_normal((60, 3))
    p = Projection.beside(np.concatenate([base, near], axis=1))
    assert p.rank == 7
    np.testing.assert_allclose(p.q.T @ p.q, np.eye(7), atol=1e-13)


def test_no_columns_leave_everything():
    y = np.arange(6.0)
    p = Projection.beside(np.zeros((6, 0)))
    assert p.rank == 0
    np.testing.assert_array_equal(p(y), y)


def test_with_more_columns(columns):
    more = np.random.default_rng(4).standard_normal((60, 3))
    together = Projection.beside(np.concatenate([columns, more], axis=1))
    stepwise = Projection.beside(columns).with_columns(more)
    y = np.random.default_rng(5).standard_normal(60)
    assert stepwise.rank == together.rank == 8
    np.testing.assert_allclose(stepwise(y), together(y), atol=1e-13)
