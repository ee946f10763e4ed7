"""Trade-offs in figures and words."""

import numpy as np
import pytest

from thermohyd.identify.fitting.uncertainty import identifiability


NAMES = ("edge_radius", "underlap", "clearance")


def test_a_trade_off_is_named_with_its_shares() -> None:
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(100, 3))
    jacobian[:, 1] = jacobian[:, 0] + 1e-3 * jacobian[:, 1]  # what one gives, the other takes
    found = identifiability(jacobian, np.ones(3), NAMES, np.eye(3), {})
    assert len(found.weak_directions) == 1
    assert found.weak_directions[0].startswith("edge_radius and underlap trade off: +0.71 -0.71 (collinearity")
    assert found.condition_number == pytest.approx(
        np.linalg.cond(jacobian / np.linalg.norm(jacobian, axis=0)), rel=1e-6
    )


def test_units_change_nothing() -> None:
    rng = np.random.default_rng(1)
    jacobian, scales = rng.normal(size=(50, 3)), np.array([1e-6, 1e-6, 1e9])
    plain = identifiability(jacobian, np.ones(3), NAMES, np.eye(3), {})
    scaled = identifiability(jacobian / scales, scales, NAMES, np.eye(3), {})
    assert scaled.condition_number == pytest.approx(plain.condition_number, rel=1e-12)
    assert scaled.weak_directions == plain.weak_directions == ()


def test_a_dead_parameter_is_named_and_the_rest_judged_without_it() -> None:
    jacobian = np.eye(5)[:, :3].copy()
    jacobian[:, 2] = 0.0
    found = identifiability(jacobian, np.ones(3), NAMES, np.eye(3), {2: "no reading depends on clearance"})
    assert found.condition_number == pytest.approx(1.0)
    assert found.sentences == ("clearance has no error bar: no reading depends on clearance",)


def test_nothing_seen_at_all() -> None:
    assert identifiability(np.zeros((5, 3)), np.ones(3), NAMES, np.eye(3), {}).condition_number == np.inf


@pytest.mark.parametrize(("value", "words"), [(0.97, "rise together"), (-0.97, "trade off")])
def test_high_correlations_are_told(value: float, words: str) -> None:
    correlation = np.array([[1.0, value, 0.0], [value, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = identifiability(np.eye(3), np.ones(3), NAMES, correlation, {})
    assert len(found.sentences) == 1
    assert words in found.sentences[0]
    assert f"{value:+.2f}" in found.sentences[0]
