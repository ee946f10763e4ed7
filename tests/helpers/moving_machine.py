"""A step test of a made-up linear machine: nothing is simulated, its readings are lags of a command and half of a supply."""

from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from thermohyd.identify.bench.test_record import Channel, DynamicTest


BAR, MM = 1e5, 1e-3
ROWS, RUNS, PACE = 201, 3, 2e-3


def steps() -> np.ndarray:
    """Set points [m] of each run: 3 mm up after 10 rows, half the way back in the middle."""
    return np.tile(np.concatenate([np.zeros(11), np.full(100, 3.0), np.full(ROWS - 111, 1.5)]), RUNS) * MM


def lagged(values: np.ndarray, rows: float) -> np.ndarray:
    """Behind a first-order lag, run by run."""
    keep = np.exp(-1.0 / rows)
    runs = values.reshape(RUNS, ROWS)
    return np.concatenate([lfilter([1.0 - keep], [1.0, -keep], run - run[0]) + run[0] for run in runs])


def moving(
    seed: int = 0,
    *,
    command: np.ndarray | None = None,
    supply: np.ndarray | None = None,
    fine: float = 1.0,
    kind: str = "setpoint",
) -> DynamicTest:
    """What the machine reads under a command [m] and a supply [Pa] (rows,); fine: factor on the noise of its gauges."""
    rows, random = ROWS * RUNS, np.random.default_rng(seed)
    command = steps() if command is None else command
    supply = np.full(rows, 210.0 * BAR) if supply is None else supply
    noise = lambda size: fine * size * random.standard_normal(rows)
    piston = lagged(command, 15.0)
    spool = 0.03 * lagged(command - piston, 1.5)
    channels = (
        Channel("spool_position", spool + noise(0.3e-6)),
        Channel("pressure_a", 0.5 * lagged(supply, 2.0) + 1e12 * spool / 30.0 + noise(0.05 * BAR)),
        Channel("piston_position", piston + noise(3e-6)),
    )
    still = np.zeros(rows)
    return DynamicTest(
        "step", Path("step.csv"), still, supply, still, np.full(rows, 313.15), channels, np.repeat(np.arange(RUNS), ROWS),
        ("1", "2", "3"), np.ones(rows), time=np.tile(PACE * np.arange(ROWS), RUNS), command=command, command_kind=kind,
    )  # fmt: skip
