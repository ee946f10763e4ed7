"""Scores over a library: chance names nothing, what is planted comes first, and signs that are known count."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_fit

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.diagnosis.screening import Screen, screen


ROWS, PARAMETERS = 600, 6
NAMES = ("pilot_leakage", "unequal_underlap", "flowmeter_offset", "hysteresis", "temperature_offset", "land_leakage")
ONE_SIDED = "pilot_leakage"  # a leakage is not negative
LEVEL = 0.005


@pytest.fixture(scope="module")
def signatures() -> np.ndarray:
    """Smooth and jumping curves over a sweep, neighbours correlated with each other and with the parameters' columns."""
    s = np.linspace(-1.0, 1.0, ROWS)
    return np.stack(
        [np.cos(k * s + 0.3 * k) + 0.5 * s**2 + (0.4 * np.sign(s) if k % 2 else 0.0) for k in range(5, 11)], 1
    )


def screened(signatures: np.ndarray, residual: np.ndarray) -> Screen:
    s = np.linspace(-1.0, 1.0, ROWS)
    nuisance = np.stack([s**k for k in range(PARAMETERS)], axis=1)
    plain = linear_fit(residual, nuisance)
    columns = np.concatenate([plain.columns, np.pad(signatures, ((0, len(plain.columns) - ROWS), (0, 0)))], axis=1)
    at = replace(plain, order=(*plain.order, *NAMES), columns=columns)
    return screen(at, NAMES, {}, level=LEVEL)


def test_chance_names_at_most_its_level(signatures):
    rng, wanted = np.random.default_rng(0), 0.05
    p = [
        min(found.p_value(s) for s in found.ranked)
        for found in (screened(signatures, rng.normal(size=ROWS)) for _ in range(400))
    ]
    assert 0.02 < np.mean(np.array(p) < wanted) < 0.08  # of 400: three standard deviations about 5 %


def test_permuted_residuals_of_a_gross_misfit_name_nothing(signatures):
    rng = np.random.default_rng(1)
    residual = rng.normal(size=ROWS) + 3.0 * signatures[:, 1]
    assert screened(signatures, residual).ranked[0].strength > 10.0
    for _ in range(100):
        mixed = rng.permutation(residual)
        found = screened(signatures, mixed / np.std(mixed))
        assert found.p_value(found.ranked[0]) > LEVEL / 50


@pytest.mark.parametrize(
    ("place", "sign"),
    [(k, sign) for k, name in enumerate(NAMES) for sign in (1.0, -1.0) if sign > 0.0 or EFFECTS[name].lower < 0.0],
)
def test_what_is_planted_comes_first_with_its_amount(signatures, place, sign):
    name, rng = NAMES[place], np.random.default_rng(place)
    # residuals are model - bench: an effect that the bench has and the model lacks leaves minus its signature
    found = screened(signatures, rng.normal(size=ROWS) - sign * 8.0 * signatures[:, place])
    best = found.ranked[0]
    assert best.name == name
    assert best.estimate == pytest.approx(sign * 8.0, abs=4.0 / best.size)


def test_an_amount_of_the_wrong_sign_is_no_evidence(signatures):
    place, rng = NAMES.index(ONE_SIDED), np.random.default_rng(7)
    noise = rng.normal(size=ROWS)
    right = screened(signatures, noise - 5.0 * signatures[:, place]).best(ONE_SIDED)
    wrong = screened(signatures, noise + 5.0 * signatures[:, place]).best(ONE_SIDED)
    assert right is not None
    assert wrong is not None
    assert right.strength > 5.0
    assert wrong.strength < 0.0
    assert wrong.estimate == 0.0


def test_what_the_parameters_can_do_is_no_evidence(signatures):
    s = np.linspace(-1.0, 1.0, ROWS)
    found = screened(
        np.stack([*signatures.T[:5], 3.0 * s + 2.0 * s**3], axis=1), np.random.default_rng(3).normal(size=ROWS)
    )
    assert found.best(NAMES[5]) is None
