"""Tables whose positions were measured, with noise: rates of the smooth sweep, and what that noise adds to the readings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.small_bench import POINTS_UP, small_record

from thermohyd.identify.bench.sweeps import sweep_direction, sweep_rate
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.noise.level import ChannelNoise, initial_noise, noise_beside, reweighted
from thermohyd.identify.reduction.reduce import reduce_test, smooth_sweep
from thermohyd.identify.reduction.rounding import local_slopes
from thermohyd.identify.reduction.sweep_position import curve_slopes, local_cubic


NOISE = 0.1e-6  # m, of a position


def measured(test: str = "leakage", noise: float = NOISE, *, followed: bool = False, time_step: float = 0.0):
    """A test of a small bench whose positions scatter by `noise`: a transducer's, or (followed) the spool's own."""
    record = small_record(seed=7)
    exact = record.tests[test]
    assert exact.time is not None
    scatter = noise * np.random.default_rng(11).standard_normal(exact.rows)
    position = exact.spool_position + scatter
    time = np.round(exact.time / time_step) * time_step if time_step else exact.time
    channel = exact.channels[0]
    if followed:
        slope = np.gradient(channel.value, exact.time) / np.gradient(exact.spool_position, exact.time)
        channel = replace(channel, value=channel.value + np.nan_to_num(slope, posinf=0.0, neginf=0.0) * scatter)
    noisy = replace(
        exact,
        spool_position=position,
        direction=sweep_direction(position, exact.run),
        time=time,
        rate=sweep_rate(position, time, exact.run),
        channels=(channel,),
    )
    return exact, noisy


def test_rates_and_directions_are_those_of_the_smooth_sweep():
    exact, noisy = measured()
    assert noisy.rate is not None
    assert exact.rate is not None
    found = reduce_test(noisy)
    assert found.rate is not None
    # A run's first row has no motion before it.
    inner = np.arange(exact.rows) % (2 * POINTS_UP) != 0
    error = [float(np.std((rate - exact.rate)[inner] / exact.rate[inner])) for rate in (noisy.rate, found.rate)]
    assert error[1] < 0.6 * error[0]
    assert error[1] < 0.008
    assert np.array_equal(found.direction[inner], exact.direction[inner])
    assert np.std(found.spool_position - exact.spool_position) < 0.7 * np.std(
        noisy.spool_position - exact.spool_position
    )
    assert "positions scatter by 0." in found.notes[-1]


def test_a_prediction_sees_the_same_sweep_as_the_fit():
    _, noisy = measured()
    fitted, predicted = reduce_test(noisy), smooth_sweep(noisy)
    for column in ("rate", "direction"):
        np.testing.assert_array_equal(getattr(fitted, column), getattr(predicted, column))
    assert predicted.spool_position is noisy.spool_position


def test_a_reading_goes_along_its_curve_with_its_position():
    """As read and as fitted the misfit of the true curve is the same, to first order; but positions no longer scatter with it."""
    exact, noisy = measured("flow_gain", 5e-6)
    fitted = reduce_test(noisy)
    [channel], [read] = fitted.channels, noisy.channels
    assert channel.moved is not None
    np.testing.assert_allclose(channel.as_read, read.value, rtol=1e-12)
    # Where the curve is straight over a row's distance, and known on both sides of the row.
    inner = (np.abs(exact.spool_position) > 2e-5) & (np.abs(exact.spool_position) < 210e-6)
    ways = np.arange(exact.rows) // POINTS_UP
    curve = lambda position: np.concatenate(
        [np.interp(position[ways == w], *_sorted(exact, ways == w)) for w in np.unique(ways)]
    )
    before, after = read.value - curve(noisy.spool_position), channel.value - curve(fitted.spool_position)
    alike = np.abs(after - before)[inner] < 0.2 * np.std(before[inner])
    assert np.mean(alike) > 0.97


def _sorted(test, rows):
    order = np.argsort(test.spool_position[rows])
    return test.spool_position[rows][order], test.channels[0].value[rows][order]


def test_noise_of_the_position_adds_to_a_reading_by_the_slope_of_its_curve():
    exact, noisy = measured("pressure_gain")
    [channel] = reduce_test(noisy).channels
    assert channel.position_part is not None
    ways = np.arange(exact.rows) // POINTS_UP
    slope = np.concatenate([
        np.abs(np.gradient(exact.channels[0].value[ways == way], exact.spool_position[ways == way]))
        for way in np.unique(ways)
    ])  # fmt: skip
    steep = slope > 0.3 * slope.max()
    assert np.median(channel.position_part[steep] / (NOISE * slope[steep])) == pytest.approx(1.0, abs=0.4)
    assert channel.std is not None
    np.testing.assert_allclose(initial_noise(noisy, channel).std, np.hypot(channel.std, channel.position_part))


def test_a_spool_that_the_readings_follow_did_move():
    _, noisy = measured("flow_gain", 5e-6, followed=True)
    [channel] = reduce_test(noisy).channels
    assert channel.position_part is None
    _, same = measured("flow_gain", 5e-6)
    [channel] = reduce_test(same).channels
    assert channel.position_part is not None


def test_rounded_times_are_no_noise_of_the_position():
    _, exact = measured(noise=0.0, time_step=0.01)
    assert reduce_test(exact) is exact


def test_of_a_clock_more_coarsely_rounded_than_the_positions_these_have_their_own_rounding_alone():
    """The seed valve: 5 um/s, a clock of 10 ms, positions to 0.01 um."""
    sweep, step = np.linspace(-6e-5, 6e-5, 2400), 0.01e-6
    read = np.round(sweep / step) * step + step * np.where(np.arange(2400) % 7 == 0, 1.0, 0.0)
    test = swept(sweep, read, read, noise=5e4)
    test = replace(test, time=np.round((sweep - sweep[0]) / 5e-6 * 100.0) / 100.0)
    found = smooth_sweep(test)
    np.testing.assert_allclose(found.spool_position, read, atol=2.0 * step)
    part = found.channels[0].position_part
    assert part is None or np.max(part) < 2.0 * step / np.sqrt(12.0) * 2e12


def test_rounded_positions_are_known_to_their_rounding():
    """A smooth sweep logged to 0.2 um: each reading lies up to 0.1 um of its curve aside, and that is no noise of its own."""
    exact, _ = measured("pressure_gain")
    step = 0.2e-6
    rounded = replace(exact, spool_position=np.round(exact.spool_position / step) * step)
    found = reduce_test(rounded)
    [channel] = found.channels
    assert channel.position_part is not None
    rise, distance = np.diff(exact.channels[0].value), np.diff(exact.spool_position)
    slope = np.max(np.abs(rise[distance != 0.0] / distance[distance != 0.0]))
    assert np.max(channel.position_part) == pytest.approx(step / np.sqrt(12.0) * slope, rel=0.3)
    assert found.notes == rounded.notes


def swept(smooth: np.ndarray, at: np.ndarray, read: np.ndarray, noise: float) -> TestRecord:
    """A pressure gain swept along `smooth` in even steps of time; the spool was `at`, and `read` positions say where it was [m]."""
    rows = len(smooth)
    ones = np.ones(rows)
    value = 200e5 * np.tanh(at / 1e-5) + np.random.default_rng(3).normal(scale=noise, size=rows)
    return TestRecord(
        name="pressure_gain",
        path=Path("pressure_gain.csv"),
        spool_position=read,
        supply_pressure=210e5 * ones,
        return_pressure=0.0 * ones,
        temperature=313.15 * ones,
        channels=(Channel("load_pressure", value),),
        run=np.zeros(rows, int),
        run_names=("up",),
        direction=np.sign(np.gradient(smooth)),
        time=0.1 * np.arange(rows),
    )


STEP = 0.1e-6  # m, to which positions are rounded
LINE, SINE = np.linspace(-6e-5, 6e-5, 600), -6e-5 * np.cos(2.0 * np.pi * np.arange(600) / 600.0)


@pytest.mark.parametrize("own", [0.02e-6, 0.03e-6, 0.04e-6, 0.08e-6])
@pytest.mark.parametrize("sweep", [LINE, SINE], ids=["line", "sine"])
def test_noise_as_large_as_the_rounding_counts_beside_it(sweep, own):
    """Between a half and one and a half of a rounding error it was taken for that error, which left no line, and then for nothing: what
    steep rows had of it was named as a lag or a shifted null."""
    random = np.random.default_rng(23)
    read = np.round((sweep + random.normal(scale=own, size=len(sweep))) / STEP) * STEP
    found = smooth_sweep(swept(sweep, sweep, read, noise=5e4))
    [channel] = found.channels
    steep = np.abs(sweep) < 5e-6
    assert channel.position_part is not None
    whole, slope = np.hypot(own, STEP / np.sqrt(12.0)), 2e12
    left = np.median(channel.position_part[steep]) / slope
    if np.array_equal(found.spool_position, read):
        assert left == pytest.approx(whole, rel=0.35)
    else:  # where the readings say that they do not follow, the line is where the spool was, and is known better
        assert left < 0.5 * whole
        assert np.std((found.spool_position - sweep)[steep]) < 0.5 * whole
    assert found.rate is not None
    speed = np.gradient(sweep, 0.1)
    assert np.max(np.abs(found.rate - speed)[10:-10]) < 0.15 * np.max(np.abs(speed))


@pytest.mark.parametrize("sweep", [LINE, SINE], ids=["line", "sine"])
def test_of_a_spool_that_trembles_behind_a_coarse_gauge_the_share_that_readings_follow_is_its_own(sweep):
    """Half of the scatter is the spool's: the best guess lies between the line and what was read, and the rest is noise."""
    random, own, shaken = np.random.default_rng(29), 0.04e-6, 0.07e-6
    at = sweep + random.normal(scale=shaken, size=len(sweep))
    step = 0.2e-6
    read = np.round((at + random.normal(scale=own, size=len(sweep))) / step) * step
    found = reduce_test(swept(sweep, at, read, noise=2e4))
    [channel] = found.channels
    steep = np.abs(sweep) < 5e-6
    assert channel.position_part is not None
    rest = np.hypot(own, step / np.sqrt(12.0))
    best = shaken * rest / np.hypot(shaken, rest)  # of what is known of where it was
    assert np.std((found.spool_position - at)[steep]) < 1.25 * best
    assert np.median(channel.position_part[steep]) / 2e12 == pytest.approx(best, rel=0.4)


@pytest.mark.parametrize("sweep", [LINE, SINE], ids=["line", "sine"])
def test_where_readings_follow_nearly_all_of_the_scatter_the_rounding_is_left(sweep):
    random, shaken = np.random.default_rng(31), 0.12e-6
    at = sweep + random.normal(scale=shaken, size=len(sweep))
    read = np.round(at / STEP) * STEP
    found = reduce_test(swept(sweep, at, read, noise=2e4))
    [channel] = found.channels
    np.testing.assert_array_equal(found.spool_position, read)
    assert channel.position_part is not None
    steep = np.abs(sweep) < 5e-6
    assert np.median(channel.position_part[steep]) / 2e12 == pytest.approx(STEP / np.sqrt(12.0), rel=0.2)


@pytest.mark.parametrize("sweep", [LINE, SINE], ids=["line", "sine"])
def test_a_transducer_noise_beside_a_larger_tremble_is_not_forgotten(sweep):
    """0.85 of the scatter is the spool's: where readings are sharp enough to tell that from all of it, the rest stays noise."""
    random, own, shaken = np.random.default_rng(37), 0.054e-6, 0.13e-6
    at = sweep + random.normal(scale=shaken, size=len(sweep))
    found = reduce_test(swept(sweep, at, at + random.normal(scale=own, size=len(sweep)), noise=2e4))
    [channel] = found.channels
    steep = np.abs(sweep) < 5e-6
    assert channel.position_part is not None
    best = shaken * own / np.hypot(shaken, own)
    assert np.std((found.spool_position - at)[steep]) < 1.25 * best
    assert np.median(channel.position_part[steep]) / 2e12 == pytest.approx(best, rel=0.4)


def test_slopes_of_a_dense_log_are_those_of_its_curve_and_not_of_its_noise():
    position = np.linspace(-6e-5, 6e-5, 6000)
    curve, steepest = 200e5 * np.tanh(position / 1e-5), 2e12
    noisy = curve + np.random.default_rng(31).normal(scale=5e4, size=6000)
    pieces = np.zeros(6000, int)
    errors = [
        np.std(slopes(position, noisy, pieces) - np.gradient(curve, position))
        for slopes in (curve_slopes, local_slopes)
    ]
    assert errors[0] < 0.03 * steepest < errors[1]


def test_a_cubic_is_found_again_along_uneven_times():
    time = np.sort(np.random.default_rng(37).uniform(0.0, 3.0, 40))
    value, slope, kept = local_cubic(time**3 - 2.0 * time, 6, time)
    np.testing.assert_allclose(value, time**3 - 2.0 * time, atol=1e-9)
    np.testing.assert_allclose(slope, 3.0 * time**2 - 2.0, atol=1e-7)
    assert np.all((kept > 0.0) & (kept < 1.0))


@pytest.mark.parametrize("moved", [False, True])
def test_sweeps_that_repeat_their_rounding_are_those_of_their_line_unless_the_spool_had_it(moved):
    """Rows every 0.4 um logged to 0.2 um: most follow evenly, and the third differences of one in ten show the rounding."""
    rows, step = 300, 0.2e-6
    line = np.linspace(-6.2e-5, 6.2e-5, rows)
    rounded = np.round(line / step) * step
    test = swept(line, rounded if moved else line, rounded, noise=2e4)
    found = reduce_test(test)
    assert np.median(np.abs(np.diff(rounded, 3))) < 1e-3 * step
    assert np.array_equal(found.spool_position, rounded) == moved
    assert moved or np.max(np.abs(found.spool_position - line)) < 0.15 * step
    [part] = [channel.position_part for channel in found.channels]
    assert (part is None) == moved
    assert part is None or 0.0 < np.max(part) < 0.5 * step / np.sqrt(12.0) * 2e12


def test_stated_noise_counts_without_a_time():
    _, noisy = measured()
    timeless = replace(noisy, time=None, rate=None)
    assert reduce_test(timeless) is timeless
    [channel] = reduce_test(replace(timeless, position_std=NOISE)).channels
    assert channel.position_part is not None
    assert np.max(channel.position_part) > 0.0


def test_unknown_noise_is_found_beside_the_positions_part():
    random = np.random.default_rng(5)
    part = np.where(np.arange(4000) % 10 == 0, 20.0, 0.1)
    misfit = np.hypot(1.0, part) * random.standard_normal(part.size)
    own = noise_beside(part, lambda std: float(np.mean((misfit / std) ** 2)))
    assert own == pytest.approx(1.0, abs=0.06)
    unknown = ChannelNoise(np.hypot(2.0, part), "", False, False, part, position_part=part)
    np.testing.assert_allclose(reweighted(unknown, misfit, np.ones(part.size)).std, np.hypot(own, part), rtol=0.02)
