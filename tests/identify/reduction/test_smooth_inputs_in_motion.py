"""In motion a gauge's noise about a smooth course is no input of the machine; edges, ripple, and what readings follow are."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.moving_machine import BAR, MM, PACE, ROWS, RUNS, moving, steps
from numpy.testing import assert_array_equal

from thermohyd.identify.reduction.smooth_conditions import with_smooth_conditions


EVERY = ROWS * RUNS
FIRST = np.arange(RUNS) * ROWS
TIME = np.tile(PACE * np.arange(ROWS), RUNS)
SAG = 210.0 * BAR - 1.5 * BAR * np.exp(-(((TIME - 0.1) / 0.04) ** 2))


def read(values: np.ndarray, noise: float, step: float, seed: int = 7) -> np.ndarray:
    """As a gauge has it that scatters and rounds."""
    seen = values + noise * np.random.default_rng(seed).standard_normal(EVERY)
    return np.round(seen / step) * step if step else seen


def off(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.sqrt(np.mean((found - true) ** 2)))


def test_a_gauge_s_noise_goes_and_a_sag_stays():
    test = replace(moving(supply=SAG), supply_pressure=read(SAG, 0.05 * BAR, 0.1 * BAR))
    found = with_smooth_conditions(test)
    assert off(test.supply_pressure, SAG) == pytest.approx(0.058 * BAR, rel=0.05)
    assert off(found.supply_pressure, SAG) < 0.03 * BAR
    assert found.supply_pressure.min() == pytest.approx(208.5 * BAR, abs=0.05 * BAR)
    said = np.sqrt(np.mean(found.input_error["supply_pressure"] ** 2))
    assert said == pytest.approx(off(found.supply_pressure, SAG), rel=0.5)
    assert any("supply pressure scatters by 0.05" in note and "do not follow" in note for note in found.notes)


@pytest.mark.parametrize("seed", range(4))
def test_a_thermometer_s_noise_and_steps_go(seed):
    warm = 313.15 + 0.3 * np.sin(3.0 * TIME + 1.0)
    found = with_smooth_conditions(replace(moving(), temperature=read(warm, 0.03, 0.1, seed)))
    assert off(found.temperature, warm) < 0.02


@pytest.mark.parametrize("rows", [4.5, 7.0, 12.0])
def test_a_ripple_stays(rows):
    """That of a pump, logged with noise and behind which pressures lag."""
    supply = 210.0 * BAR + 0.3 * BAR * np.sin(2.0 * np.pi / rows * np.arange(EVERY))
    test = replace(moving(supply=supply), supply_pressure=read(supply, 0.03 * BAR, 0.0))
    assert off(with_smooth_conditions(test).supply_pressure, supply) <= off(test.supply_pressure, supply) + 0.005 * BAR


def test_a_jump_of_the_supply_stays_a_jump():
    supply = np.where(TIME < 0.2, 210.0, 160.0) * BAR
    found = with_smooth_conditions(replace(moving(supply=supply), supply_pressure=read(supply, 0.05 * BAR, 0.1 * BAR)))
    assert off(found.supply_pressure, supply) < 0.02 * BAR
    assert np.max(np.abs(found.supply_pressure - supply)) < 0.2 * BAR


def test_noise_of_a_command_goes_and_its_edges_stay():
    taken, first = 0, []
    for seed in range(10):
        test = replace(moving(seed), command=read(steps(), 0.01 * MM, 0.01 * MM, 100 + seed))
        found = with_smooth_conditions(test)
        edges = np.abs(np.diff(steps())) > 0.0
        assert np.abs(np.diff(found.command) - np.diff(steps()))[edges].max() < 0.05 * MM
        first.append(off(found.command[FIRST], steps()[FIRST]))
        taken += off(found.command, steps()) < 0.003 * MM
    assert taken >= 8
    # A run that starts in equilibrium does so where the command stood, not where its noise was.
    assert np.sqrt(np.mean(np.square(first))) < 0.005 * MM


def test_a_command_s_noise_that_the_machine_follows_stays():
    kept = 0
    for seed in range(10):
        test = moving(seed, command=read(steps(), 0.01 * MM, 0.0, 100 + seed))
        found = with_smooth_conditions(test)
        kept += bool(np.array_equal(np.delete(found.command, FIRST), np.delete(test.command, FIRST)))
    assert kept == 10


def test_in_doubt_a_command_stays_as_logged():
    test = replace(moving(fine=20.0), command=read(steps(), 0.01 * MM, 0.0))
    found = with_smooth_conditions(test)
    assert_array_equal(np.delete(found.command, FIRST), np.delete(test.command, FIRST))
    assert "command" not in found.input_error


MEANT = {
    "steps": steps(),
    "sine": 3.0 * MM * np.sin(2.0 * np.pi * 8.0 * TIME),
    "fast sine": 3.0 * MM * np.sin(2.0 * np.pi * 90.0 * TIME),
    "triangle": 3.0 * MM * np.abs((5.0 * TIME) % 2.0 - 1.0),
    "staircase": 0.05 * MM * np.round(TIME / 0.02),
    "random": 0.5 * MM * np.random.default_rng(3).choice([-1.0, 1.0], EVERY),
    "random in holds": 0.5 * MM * np.repeat(np.random.default_rng(3).choice([-1.0, 1.0], -(-EVERY // 5)), 5)[:EVERY],
    "noise": 0.5 * MM * np.random.default_rng(3).standard_normal(EVERY),
    "dither": steps() + 0.1 * MM * np.sin(2.0 * np.pi * 170.0 * TIME),
}  # fmt: skip


@pytest.mark.parametrize("name", MEANT)
def test_what_a_command_is_meant_to_be_is_not_rounded_off(name):
    """Not even of a machine whose gauges see nothing of it."""
    for test in (moving(command=MEANT[name]), replace(moving(), command=MEANT[name])):
        assert with_smooth_conditions(test) is test


def test_a_frequency_test_is_left_alone():
    test = replace(moving(), supply_pressure=read(SAG, 0.05 * BAR, 0.1 * BAR), frequency=np.linspace(1.0, 100.0, EVERY))
    assert with_smooth_conditions(test) is test
