"""Synthetic raw logs of a static test with a known curve: dithered and rounded position, correlated noise, rounded readings."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from thermohyd.identify.bench.test_record import Channel, TestRecord


Curve = Callable[[np.ndarray], np.ndarray]
POSITION = 1e-4  # m, half the sweep
READING = 1e-5  # m3/s


def peak(x: np.ndarray) -> np.ndarray:
    """Columns of a leakage-like curve over x in -1..1: a sharp peak and an offset."""
    return np.stack([1.0 / (1.0 + ((x - 0.02) / 0.06) ** 2), np.ones_like(x)], axis=1)


def steep(x: np.ndarray) -> np.ndarray:
    """Columns of a pressure-gain-like curve: a steep rise and a slope."""
    return np.stack([np.tanh((x - 0.02) / 0.03), x], axis=1)


TRUTH = np.array([1.0, 0.3])


def correlated_noise(rng: np.random.Generator, rows: int, memory: float) -> np.ndarray:
    """AR(1) noise of unit variance that forgets over `memory` rows (0: white)."""
    if memory == 0.0:
        return rng.normal(size=rows)
    a = np.exp(-1.0 / memory)
    return np.asarray(lfilter([np.sqrt(1 - a * a)], [1.0, -a], rng.normal(size=rows + 2000)))[2000:]


def raw_log(
    seed: int,
    *,
    curve: Curve = peak,
    rows: int = 16000,
    runs: int = 1,
    noise: float = 0.02,
    memory: float = 0.0,
    reading_step: float = 0.0,
    position_step: float = 0.0,
    dither: float = 0.0,
) -> TestRecord:
    """A log of up-and-down sweeps at 100 rows per second; noise and steps in units of the curve and of the half sweep."""
    rng = np.random.default_rng(seed)
    half = rows // (2 * runs)
    x = np.concatenate([np.linspace(1, -1, half), np.linspace(-1, 1, half)] * runs)
    n = len(x)
    y = curve(x) @ TRUTH + noise * correlated_noise(rng, n, memory)
    logged = x + dither * rng.normal(size=n)
    y = np.round(y / reading_step) * reading_step if reading_step else y
    logged = np.round(logged / position_step) * position_step if position_step else logged
    one = np.ones(n)
    change = np.sign(np.diff(logged, prepend=2.0))
    last = np.maximum.accumulate(np.where(change != 0, np.arange(n), 0))  # a repeated position keeps its direction
    return TestRecord(
        name="leakage",
        path=Path("leakage.csv"),
        spool_position=POSITION * logged,
        supply_pressure=70e5 * one,
        return_pressure=0.0 * one,
        temperature=313.15 * one,
        channels=(Channel("leakage_flow", READING * y),),
        run=np.repeat(np.arange(runs), 2 * half),
        run_names=tuple(f"run {i + 1}" for i in range(runs)),
        direction=change[last],
        time=np.arange(n) * 0.01,
        lines=np.arange(n) + 2,
    )
