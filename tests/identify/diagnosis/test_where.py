"""Boxes of conditions that hold the misfit: the one that was planted, as narrow as it is and no narrower."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.small_bench import CONDITIONS, conditions_only

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.diagnosis.result import Region
from thermohyd.identify.diagnosis.where import MOST_REGIONS, regions
from thermohyd.identify.fitting.result import ChannelFit


STD = 2.0
COLD = CONDITIONS[0][0]


def fit_of(test: TestRecord, misfit: np.ndarray, seed: int = 0) -> ChannelFit:
    """A channel whose readings are noise and a misfit, given in noise units, beside a model of 0."""
    noise = np.random.default_rng(seed).normal(size=test.rows)
    figures: dict[str, Any] = dict.fromkeys(
        ("residual_rms", "noise", "reduced_chi2", "autocorrelation", "effective_size"), 0.0
    )
    return ChannelFit(
        test=test.name,
        channel=test.channels[0].name,
        position=test.spool_position,
        measured=STD * (noise + misfit),
        predicted=np.zeros(test.rows),
        std=np.full(test.rows, STD),
        predicted_std=np.zeros(test.rows),
        direction=test.direction,
        run=test.run,
        supply_pressure=test.supply_pressure,
        temperature=test.temperature,
        noise_source="",
        **figures,
    )


def found_in(misfit: Callable[[TestRecord], np.ndarray], **columns: Any) -> tuple[Region, ...]:
    test = conditions_only("leakage", **columns)
    return regions((fit_of(test, misfit(test)),), {"leakage": test})


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_is_nowhere(seed):
    test = conditions_only("leakage")
    assert regions((fit_of(test, np.zeros(test.rows), seed),), {"leakage": test}) == ()


def test_a_box_of_position_and_temperature():
    inside = lambda t: (np.abs(t.spool_position) < 20e-6) & (t.temperature == COLD)
    worst = found_in(lambda t: 8.0 * inside(t))[0]
    assert set(worst.limits) == {"spool_position", "temperature"}
    assert worst.limits["temperature"] == (COLD, COLD)
    low, high = worst.limits["spool_position"]
    assert -35e-6 < low < -5e-6
    assert 5e-6 < high < 35e-6
    assert worst.share > 0.8
    assert worst.mean == pytest.approx(8.0 * STD, rel=0.25)  # a box ends between stretches of the sweep


def test_one_direction():
    worst = found_in(lambda t: 4.0 * (t.direction > 0.0))[0]
    assert worst.limits == {"direction": (1.0, 1.0)}
    assert worst.rows == 128
    assert worst.mean == pytest.approx(4.0 * STD, rel=0.1)


def test_high_supply():
    high = max(pressure for _, pressure in CONDITIONS)
    worst = found_in(lambda t: 3.0 * (t.supply_pressure == high))[0]
    assert worst.limits == {"supply_pressure": (high, high)}


def test_fast_sweeps():
    worst = found_in(lambda t: 4.0 * (np.abs(np.asarray(t.rate)) > 1e-5))[0]
    assert set(worst.limits) == {"rate"}
    assert worst.limits["rate"][0] == pytest.approx(20e-6)


def test_everywhere_alike_is_said_to_be_everywhere():
    [region] = found_in(lambda t: 3.0 * (-1.0) ** np.arange(t.rows))
    assert region.limits == {}
    assert region.rows == 256
    assert abs(region.mean) < 0.2 * STD
    assert region.rms == pytest.approx(3.0 * STD, rel=0.1)  # of both signs: the mean says nothing


def test_a_second_box_once_the_first_is_set_aside():
    worst, second = found_in(lambda t: 9.0 * (t.temperature == COLD) + 4.0 * (t.temperature == CONDITIONS[-1][0]))[:2]
    assert worst.limits["temperature"] == (COLD, COLD)
    assert second.limits["temperature"] == (CONDITIONS[-1][0],) * 2
    assert worst.share > second.share


def test_channels_in_the_order_of_their_shares_and_not_too_many():
    tests = {name: conditions_only(name) for name in ("leakage", "pressure_gain", "flow_gain")}
    misfits = {"leakage": 4.0, "pressure_gain": 12.0, "flow_gain": 7.0}
    boxes = lambda t, size: size * ((t.temperature == COLD) + 0.5 * (t.spool_position > 0.5 * t.spool_position.max()))
    fits = tuple(fit_of(test, boxes(test, misfits[name])) for name, test in tests.items())
    found = regions(fits, tests)
    assert found[0].test == "pressure_gain"
    assert len(found) <= MOST_REGIONS
    assert [r.share for r in found] == sorted((r.share for r in found), reverse=True)
    assert sum(r.share for r in found) < 1.1
    assert {r.channel for r in found} >= {"load_pressure", "flow"}


def test_a_record_without_rates_or_with_one_condition():
    test = conditions_only("leakage", (0, 0), rate=None, time=None)
    misfit = 8.0 * (test.spool_position > 30e-6)
    [worst, *_] = regions((fit_of(test, misfit),), {"leakage": test})
    assert set(worst.limits) == {"spool_position"}
