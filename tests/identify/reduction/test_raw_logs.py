"""Raw logs of an ideal valve, made by the reference simulator: reduced, they tell as much as all their rows, and no more."""

import numpy as np
import pytest
from reference.raw_log_records import VALVE, Log, write

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.row_sizes import padded_size
from thermohyd.identify.fitting.static_readings import conditions_of, mean_over_nodes, predict, row_weights
from thermohyd.identify.noise.level import initial_noise
from thermohyd.identify.reduction.nodes import nodes_of
from thermohyd.identify.reduction.noise_of_logs import row_noise
from thermohyd.identify.reduction.reduce import reduce_test


NAMES = ("edge_radius", "clearance", "underlap", "null_bias")
TESTS = ("leakage", "flow_gain", "pressure_gain")


def test_nodes_give_the_mean_of_any_cubic():
    rng = np.random.default_rng(3)
    axis = np.sort(rng.normal(size=400)) * 1e-6
    starts = np.array([0, 1, 3, 40, 41, 200, 390])
    nodes = nodes_of(axis, np.arange(400.0), starts, "spool_position")
    rows = np.diff(np.append(starts, 400))
    middle = np.add.reduceat(axis, starts) / rows
    at = middle[:, None] + nodes.offset
    for power in range(4):
        exact = np.add.reduceat((axis / 1e-6) ** power, starts) / rows
        assert np.sum((at / 1e-6) ** power * nodes.weight, axis=1) == pytest.approx(exact, rel=1e-9, abs=1e-9)
    assert np.all(np.diff(nodes.time, axis=1) >= 0.0)
    still = nodes_of(np.full(10, 2e-6), None, np.array([0, 5]), "spool_position")
    assert np.all(still.offset == 0.0)
    assert np.all(still.weight == 0.5)


@pytest.mark.parametrize("test", TESTS)
def test_a_point_is_the_models_mean_over_its_rows(test, tmp_path):
    """Noise-free readings of the model itself, reduced, against the model at the nodes: below a tenth of a point's noise."""
    write(tmp_path, Log(6000, (test,), 1))
    record = read_record(tmp_path)
    log = record.tests[test]
    valve = _valve(record)
    rows = np.asarray(predict(valve, {test: conditions_of(log)})[test][log.channels[0].name])[: log.rows]
    points = reduce_test(log)
    assert points.nodes is not None
    assert points.rows_of_log is not None
    starts = np.append(0, np.cumsum(points.rows_of_log)[:-1])
    exact = np.add.reduceat(rows, starts) / points.rows_of_log
    weight = row_weights(points)
    assert weight is not None
    means = mean_over_nodes(predict(valve, {test: conditions_of(points)})[test][log.channels[0].name], weight)
    std = initial_noise(points, points.channels[0]).std
    off = (np.asarray(means)[: points.rows] - exact) / std
    assert len(means) == padded_size(points.rows)
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert np.abs(off).max() < 1.0  # in the bins in which an edge closes


def _valve(record):
    from thermohyd.identify.fitting.parameters import identified_by_default
    from thermohyd.identify.fitting.static_readings import base_valve

    return base_valve(record, {n: float(np.asarray(getattr(VALVE, n))) for n in identified_by_default(record.valve)})


@pytest.mark.nightly
def test_more_rows_never_give_a_worse_answer(tmp_path):
    """All rows beside every 20th of them: error bars shrink as the root of the rows, and so do the errors."""
    whole, some = [], []
    for seed in range(5):
        log = Log(6000, TESTS, seed, sine=bool(seed % 2), stated=bool(seed // 2 % 2))
        for every, found in ((1, whole), (20, some)):
            folder = tmp_path / f"{seed}_{every}"
            write(folder, log, every)
            result = fit(read_record(folder), starts=1)
            assert result.converged
            found.append([(result.parameters[n].value, result.parameters[n].std) for n in NAMES])
            if every == 1:
                assert 0.85 < result.reduced_chi2 < 1.15
    truth = np.array([float(np.asarray(getattr(VALVE, n))) for n in NAMES])
    (value, std), (value_some, std_some) = (np.moveaxis(np.array(f, dtype=float), 2, 0) for f in (whole, some))
    assert np.all(std < 0.5 * std_some)
    rms = lambda v: np.sqrt(np.mean((v - truth) ** 2, axis=0))
    assert np.all(rms(value) < rms(value_some))
    assert np.sqrt(np.mean(((value - truth) / std) ** 2)) < 1.5
    assert np.sqrt(np.mean(((value_some - truth) / std_some) ** 2)) < 1.5


def test_stated_noise_is_the_noise_of_a_row(tmp_path):
    write(tmp_path, Log(6000, ("leakage",), 4, stated=True))
    points = reduce_test(read_record(tmp_path).tests["leakage"])
    assert points.rows_of_log is not None
    std = points.channels[0].std
    assert std == pytest.approx(2e-3 / 6e4 / np.sqrt(points.rows_of_log), rel=1e-3)  # and the file's rounding
    assert np.isinf(points.channels[0].freedom)


def test_repeated_sweeps_agree_with_the_rows(tmp_path):
    """Reduced chi-square 1, not the 0.13 that rows of unequal weight and bends between them once gave."""
    for stated in (False, True):
        write(tmp_path, Log(8000, ("leakage", "flow_gain"), 6, stated=stated, repeats=2))
        assert fit(read_record(tmp_path), starts=1).reduced_chi2 == pytest.approx(1.0, abs=0.15)


def test_independent_rows_are_told_from_rows_that_remember():
    taken, kept = 0, 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        pieces = np.repeat([0, 1, 2, 3], 1500)
        curve = 20.0 * np.exp(-((np.linspace(-1.0, 1.0, 6000) / 0.05) ** 2))
        white = rng.normal(size=6000)
        slow = np.convolve(rng.normal(size=6010), np.ones(11) / np.sqrt(11), "valid")
        taken += row_noise(curve + white, pieces).correlation.white
        remembering = curve + 0.8 * white + 0.6 * slow
        kept += row_noise(remembering, pieces).correlation.white
    assert taken >= 59
    assert kept <= 3


def test_one_scatter_unless_it_clearly_varies():
    pieces = np.repeat([0, 1], 3000)
    rng = np.random.default_rng(8)
    even = rng.normal(size=6000)
    assert np.ptp(row_noise(even, pieces).own) == 0.0
    assert row_noise(even, pieces).own[0] == pytest.approx(1.0, abs=0.12)
    louder = even * np.where(np.arange(6000) % 3000 < 1500, 1.0, 4.0)
    found = np.sqrt(row_noise(louder, pieces).own)
    assert found[700] == pytest.approx(1.0, abs=0.2)
    assert found[2300] == pytest.approx(4.0, abs=0.8)


def test_nodes_reach_as_far_as_rows_were_shaken():
    """Rows that stand about their smooth sweep: nodes give the mean of a curve to second order over where they really were."""
    axis, starts, shaken = np.linspace(0.0, 3e-6, 400), np.array([0, 1, 200]), 0.2e-6
    nodes = nodes_of(axis, None, starts, "spool_position", np.full(400, shaken**2))
    rows = np.diff(np.append(starts, 400))
    mean = np.add.reduceat(axis, starts) / rows
    at = mean[:, None] + nodes.offset
    np.testing.assert_allclose(np.sum(nodes.weight * at, axis=1), mean)
    expected = np.add.reduceat(axis**2, starts) / rows + shaken**2
    np.testing.assert_allclose(np.sum(nodes.weight * at**2, axis=1), expected)
