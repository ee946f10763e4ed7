"""Noise of which a projection was taken: its memory and size come out as they were put in."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from thermohyd.identify.diagnosis.screening import Projection
from thermohyd.identify.noise.correlation import ProjectedNoise


RUNS = 40


def noise(random: np.random.Generator, lengths: tuple[int, ...], share: float, phi: float) -> np.ndarray:
    """(rows,): share of AR(1) and the rest white, variance 1, every stretch on its own."""
    pieces = []
    for length in lengths:
        slow, push = np.empty(length), random.standard_normal(length)
        slow[0] = push[0]
        for i in range(1, length):
            slow[i] = phi * slow[i - 1] + np.sqrt(1.0 - phi**2) * push[i]
        pieces.append(np.sqrt(share) * slow + np.sqrt(1.0 - share) * random.standard_normal(length))
    return np.concatenate(pieces)


def projected(lengths: tuple[int, ...], degree: int) -> tuple[Projection, ProjectedNoise]:
    """Smooth curves over every stretch taken out."""
    ids = np.repeat(np.arange(len(lengths)), lengths)
    columns = np.zeros((sum(lengths), len(lengths) * (degree + 1)))
    for i, length in enumerate(lengths):
        own = legendre.legvander(np.linspace(-1.0, 1.0, length), degree)
        columns[ids == i, i * (degree + 1) : (i + 1) * (degree + 1)] = own
    projection = Projection.beside(columns)
    return projection, ProjectedNoise(projection.q, ids)


@pytest.mark.parametrize(("share", "phi"), [(0.0, 0.0), (1.0, 0.6), (0.6, 0.8)])
@pytest.mark.parametrize(("lengths", "degree"), [((80, 80, 80), 9), ((300, 200), 5)])
def test_expected_sums_are_those_of_many_draws(lengths, degree, share, phi):
    projection, seen = projected(lengths, degree)
    rows, random = slice(0, sum(lengths)), np.random.default_rng(3)
    expected = (1.0 - share) * seen.sums(0.0, rows, 6) + share * seen.sums(phi, rows, 6)
    found = np.zeros(7)
    for _ in range(RUNS):
        rest = projection(noise(random, lengths, share, phi))
        start = 0
        for length in lengths:
            own = rest[start : start + length]
            found += [float(own[lag:] @ own[: length - lag]) for lag in range(7)]
            start += length
    scatter = np.sqrt((1.0 + phi) / (1.0 - phi) / RUNS / sum(lengths)) * expected[0]
    np.testing.assert_allclose(found / RUNS, expected, atol=4.0 * scatter)


@pytest.mark.parametrize(("lengths", "degree"), [((81, 81), 9), ((300, 300), 5)])
def test_white_noise_stays_white_beside_smooth_curves(lengths, degree):
    projection, seen = projected(lengths, degree)
    rows, random = slice(0, sum(lengths)), np.random.default_rng(4)
    found = [seen.remembered(projection(noise(random, lengths, 0.0, 0.0)), rows) for _ in range(RUNS)]
    assert sum(f.correlation.share > 0.0 for f in found) <= 2
    assert abs(np.mean([f.variance for f in found]) - 1.0) < 0.1


@pytest.mark.parametrize("phi", [0.6, 0.8])
def test_memory_and_size_are_found(phi):
    lengths = (200, 200, 200)
    projection, seen = projected(lengths, 5)
    rows, random = slice(0, 600), np.random.default_rng(5)
    found = [seen.remembered(projection(noise(random, lengths, 1.0, phi)), rows) for _ in range(RUNS)]
    inflation = np.median([f.correlation.inflation for f in found])
    assert abs(inflation / ((1.0 + phi) / (1.0 - phi)) - 1.0) < 0.25
    assert abs(np.median([f.variance for f in found]) - 1.0) < 0.15


def test_too_few_rows_say_nothing():
    projection, seen = projected((12,), 2)
    rest = projection(np.arange(12.0) ** 3)
    assert seen.remembered(rest, slice(0, 12)).correlation.share == 0.0
