"""Noise of which a projection was taken: its memory and size come out as they were put in."""

import numpy as np
import pytest
from numpy.polynomial import legendre

from thermohyd.identify.diagnosis.screening import Projection
from thermohyd.identify.noise import correlation
from thermohyd.identify.noise.correlation import ProjectedNoise, Sums, noise_correlation


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


@pytest.mark.parametrize("size", [None, 1.0])
def test_the_memory_of_a_log_is_found_to_a_hundredth(size):
    """3,000 rows tell a memory of 0.86 to 0.01; taken for 0.90 it makes noise look a third too large."""
    lengths, phi = (500,) * 6, 0.86
    projection, seen = projected(lengths, 5)
    rows, random = slice(0, 3000), np.random.default_rng(6)
    found = [seen.remembered(projection(noise(random, lengths, 1.0, phi)), rows, size).correlation for _ in range(20)]
    one = np.array([f.share * f.phi for f in found])
    assert abs(np.mean(one) - phi) < 0.01
    assert np.std(one) < 0.02


def test_a_memory_of_two_rows_is_not_told_as_half_a_memory_of_ten():
    lengths, phi = (80, 80, 80), 0.5
    projection, seen = projected(lengths, 5)
    rows, random = slice(0, 240), np.random.default_rng(7)
    found = [seen.remembered(projection(noise(random, lengths, 1.0, phi)), rows).correlation for _ in range(RUNS)]
    assert np.mean([f.share == 1.0 for f in found]) > 0.6
    assert np.mean([f.inflation > 2.0 * (1.0 + phi) / (1.0 - phi) for f in found]) < 0.2


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.8])
def test_repeats_beside_all_rows_tell_the_memory_better_than_alone(phi):
    lengths = (70, 70, 70, 70)
    projection, seen = projected(lengths, 5)
    rows, random = slice(0, 280), np.random.default_rng(8)
    alone, beside = [], []
    for _ in range(RUNS):
        repeated = noise(random, (70,), 1.0, phi)
        rest = projection(noise(random, lengths, 1.0, phi))
        alone.append(noise_correlation(repeated, np.zeros(70, int), 0.0))
        beside.append(seen.remembered(rest, rows, 1.0, Sums.of([repeated])).correlation)
    off = [np.std([np.log(f.inflation * (1.0 - phi) / (1.0 + phi)) for f in each]) for each in (alone, beside)]
    assert off[1] < 0.7 * off[0]


def test_a_misfit_that_no_noise_makes_is_not_told_as_a_longer_memory(monkeypatch):
    """A wave through all rows, as a missing effect leaves one: its sums fall along a line and go on below zero."""
    lengths = (400, 250)
    projection, seen = projected(lengths, 3)
    rows, random = slice(0, 650), np.random.default_rng(9)
    rest = projection(np.sin(np.arange(650.0) / 9.0) + 0.2 * random.standard_normal(650))
    size = float(np.sum(rest**2)) / seen.degrees_of_freedom(rows)
    found = seen.remembered(rest, rows, size).correlation
    monkeypatch.setattr(correlation, "NO_NOISE", 0.0)
    believed = seen.remembered(rest, rows, size).correlation
    assert found.inflation < 0.7 * believed.inflation
