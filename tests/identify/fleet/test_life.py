"""Wear, overhauls and time to a limit on made-up lives whose truth is known: no simulator, no fit."""

import math
from datetime import datetime, timedelta

import numpy as np
import pytest
from helpers.fleet_records import stored_row
from scipy.stats import norm

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.fleet.life import fleet_life
from thermohyd.identify.fleet.overhauls import find_overhauls
from thermohyd.identify.fleet.pooling import Pooled, Series, fit_pooled, robust_tau
from thermohyd.identify.fleet.remaining import crossing, read_limits
from thermohyd.identify.fleet.store import Store


def lives(of_benchmarks, seed: int, valves: int):
    return of_benchmarks("_fleet_tables").fleet(seed, valves)


def test_injected_wear_overhauls_and_times(of_benchmarks):
    """As `benchmarks/fleet_life.py` measures it over many fleets; here one, with room for its chance."""
    made = lives(of_benchmarks, 3, 80)
    _, lines, points = find_overhauls(made.series)
    for name, line in lines.items():
        inside = np.abs(line.mean[:, 1] - made.slopes[name]) <= 1.96 * np.sqrt(line.covariance[:, 1, 1])
        assert 0.87 <= inside.mean() <= 1.0, name
    told = {(point.valve, point.before) for point in points}
    real = {(i, before) for i, before in enumerate(made.overhaul) if before is not None}
    assert len(told & real) >= 0.85 * len(real)
    assert len({i for i, _ in told - real if made.overhaul[i] is None}) <= 0.03 * 80
    assert all(point.confirmed and point.quantities for point in points if (point.valve, point.before) in real)


def test_one_valve_alone_is_its_own_line():
    time = np.array([0.0, 1.0, 2.0, 4.0])
    std = np.array([0.1, 0.2, 0.1, 0.1])
    value = np.array([1.0, 1.3, 1.4, 2.1])
    line = fit_pooled([Series(time, value, std)])
    slope, level = np.polyfit(time, value, 1, w=1.0 / std)
    assert line.mean[0, 1] == pytest.approx(slope, rel=1e-3)
    assert line.at(0, 0.0)[0][0] == pytest.approx(level, abs=1e-3)


def test_many_exact_valves_keep_their_own_rates_and_few_vague_ones_take_the_types():
    rng = np.random.default_rng(2)
    time = np.linspace(0.0, 4.0, 6)
    rates = rng.normal(1.0, 0.3, 30)
    exact = fit_pooled([Series(time, 2.0 + b * time, np.full(6, 1e-4)) for b in rates])
    assert exact.mean[:, 1] == pytest.approx(rates, abs=1e-3)
    vague = fit_pooled([Series(time, 2.0 + time + rng.normal(0.0, 2.0, 6), np.full(6, 2.0)) for _ in rates])
    own = np.array([np.polyfit(time, 2.0 + time, 1)[0]])
    assert np.std(vague.mean[:, 1]) < 0.5 * 2.0 / np.sqrt(((time - 2.0) ** 2).sum())
    assert abs(vague.mean[:, 1].mean() - own[0]) < 0.3


def test_scatter_between_tests_in_spite_of_steps():
    rng = np.random.default_rng(5)
    series = []
    for i in range(60):
        time = np.sort(rng.uniform(0.0, 10.0, 9))
        value = (
            0.2 * time
            + np.where(time > rng.uniform(2.0, 8.0), -3.0 * (i % 2), 0.0)
            + rng.normal(0.0, np.hypot(0.1, 0.15), 9)
        )
        series.append(Series(time, value, np.full(9, 0.1)))
    assert robust_tau(series) == pytest.approx(0.15, abs=0.05)
    assert robust_tau([Series(np.array([0.0]), np.array([1.0]), np.array([1.0]))]) == math.inf


def test_records_without_a_value_say_nothing():
    time, std = np.arange(5.0), np.full(5, 0.1)
    whole = [Series(time, np.array([1.0, 1.1, 1.2, 1.35, 1.4]) + 0.1 * i, std) for i in range(4)]
    holes = [Series(np.append(one.time, 9.0), np.append(one.value, 0.0), np.append(one.std, math.inf)) for one in whole]
    assert fit_pooled(holes).mean == pytest.approx(fit_pooled(whole).mean, rel=1e-9)


def line(level: float, slope: float, std: float, slope_std: float) -> Pooled:
    covariance = np.diag([std**2, slope_std**2])[None]
    mean = np.array([[level, slope]])
    return Pooled(0.0, mean, covariance, mean[0], covariance[0], covariance[0], 0.0)


def test_time_to_a_limit():
    sure = crossing(line(2.0, 0.5, 1e-9, 1e-9), 0, 0.0, 4.0, True, 10.0)
    assert (sure.low, sure.middle, sure.high) == pytest.approx((4.0, 4.0, 4.0), rel=1e-6)
    unsure = crossing(line(2.0, 0.5, 0.1, 0.1), 0, 0.0, 4.0, True, 10.0)
    for time, probability in ((unsure.low, 0.025), (unsure.middle, 0.5), (unsure.high, 0.975)):
        score = (2.0 + 0.5 * time - 4.0) / np.hypot(0.1, 0.1 * time)
        assert float(norm.cdf(score)) == pytest.approx(probability, abs=1e-6)
    assert crossing(line(2.0, 0.0, 0.1, 0.1), 0, 0.0, 4.0, True, 10.0).high == math.inf
    assert crossing(line(2.0, -0.5, 1e-9, 1e-9), 0, 0.0, 1.0, False, 10.0).middle == pytest.approx(2.0)
    past = crossing(line(5.0, 0.5, 0.1, 0.1), 0, 0.0, 4.0, True, 10.0)
    assert (past.low, past.high, past.now_beyond) == (0.0, 0.0, pytest.approx(1.0))


def worn_store(folder, with_hours: bool = True) -> Store:
    """Six valves; S5 wears three times as fast, S4 was overhauled before its fourth record."""
    store, rng = Store(folder), np.random.default_rng(7)
    for number in range(36):
        serial, record = number % 6, number // 6
        hours = 1000.0 * record + 10.0 * serial
        rate = 3e-10 if serial == 5 else 1e-10
        value = 2e-6 + rate * hours - (3e-7 if serial == 4 and record >= 3 else 0.0) + 5e-9 * rng.standard_normal()
        known = {"name": "clearance", "value": value, "std": 5e-9, "unit": "m", "at_bound": False, "fixed": False}
        gain = {"name": "flow_gain", "value": 1.0 + record, "std": 1e-3, "unit": "1", "at_bound": False, "fixed": False}
        when = {"date": datetime(2020, 1, 1) + timedelta(hours=hours), "operating_hours": hours if with_hours else None}
        verdict = "unexplained" if serial == 0 and record == 5 else "named"
        row = {"type": "T", "serial": f"S{serial}", "parameters": [known, gain], "verdict": verdict, "effects": []}
        store.write_result(stored_row(number, **row, **when))
    return store


@pytest.fixture(scope="module")
def worn(tmp_path_factory) -> Store:
    return worn_store(tmp_path_factory.mktemp("life") / "store")


def test_the_life_of_a_store(worn, tmp_path):
    (tmp_path / "limits.toml").write_text('["*"]\nclearance = { max = "4.0 um" }\n')
    life = fleet_life(worn, read_limits(tmp_path / "limits.toml"))
    by_serial = {valve.serial: valve for valve in life.valves}
    assert [valve.serial for valve in life.valves][:2] == ["S5", "S0"]
    worst = by_serial["S5"]
    assert [trend.quantity for trend in worst.trends] == ["clearance"]  # a gain is the bench's
    assert worst.trends[0].rate == pytest.approx(3e-10, abs=3 * worst.trends[0].rate_std)
    assert "clearance changes faster than in its type" in " ".join(worst.reasons)
    (left,) = worst.remaining
    assert left.low is not None
    assert left.high is not None
    assert left.low < (4e-6 - (2e-6 + 3e-10 * 5050.0)) / 3e-10 < left.high
    (overhaul,) = by_serial["S4"].overhauls
    assert (overhaul.after, overhaul.before, overhaul.confirmed) == (2040.0, 3040.0, True)
    assert not any(valve.overhauls for valve in life.valves if valve.serial != "S4")
    assert by_serial["S0"].reasons == ["last record: unexplained"]
    assert life.to_dict()["valves"][0]["axis"] == "hours"


def test_without_hours_the_date_counts(tmp_path):
    valve = fleet_life(worn_store(tmp_path / "store", with_hours=False)).valves[0]
    assert valve.axis == "date"
    assert valve.trends[0].type_rate == pytest.approx(1e-10 * 8766.0, rel=0.6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('["*"]\nclearance = { max = "4 bar" }', "limit of clearance"),
        ('["*"]\nclearance = "4 um"', 'must be a table, such as { max = "6 um" }'),
        ('["*"]\nclearance = { most = "4 um" }', 'unknown key "most"'),
        ('["*"]\nclearance = {}', "needs min, max or both"),
    ],
)
def test_limits_that_cannot_be_used(worn, tmp_path, text, words):
    (tmp_path / "limits.toml").write_text(text)
    with pytest.raises(BenchInputError) as raised:
        fleet_life(worn, read_limits(tmp_path / "limits.toml"))
    assert words in str(raised.value)
