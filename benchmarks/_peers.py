"""The record, the peers and the clock that the benchmarks share."""

import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np


sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # the reference simulator is the peers' model

from helpers.records import NOISE, POINTS, synthetic_record
from reference import static_tests
from reference.isothermal import IsothermalRows, simulate
from reference.oil import Oil, walther
from reference.valve import Rows, Valve


WIDTH = 12e-3
TRUTH = Valve(
    slot_width=WIDTH,
    edge_radius=8e-6,
    clearance=2.5e-6,
    underlap=6e-6,
    discharge_coefficient=0.68,
    transition_number=90.0,
    null_bias=1.2e-6,
)
NOMINAL = np.array([10e-6, 3e-6, 5e-6, 0.7, 100.0, 0.0])  # the program's own start
LOWER = np.array([0.0, 0.05e-6, -106.5e-6, 0.05, 1.0, -106.5e-6])
UPPER = np.array([200e-6, 50e-6, 106.5e-6, 2.0, 1e4, 106.5e-6])
SCALE = np.array([5e-6, 1e-6, 5e-6, 0.1, 30.0, 5e-6])


def record_of_3000_rows():
    """Leakage, pressure gain and flow gain, 1008 rows each (12 sweeps of 84), declared noise."""
    return synthetic_record(TRUTH, np.random.default_rng(1), points=84)


class NumpyResidual:
    """Whitened residuals of the record on the fast NumPy path; every call starts its balances from the middle (q = 0)."""

    def __init__(self, record):
        oil = Oil(*walther(POINTS))
        self.tests = []
        for name, test in record.tests.items():
            rows = Rows(test.spool_position, test.supply_pressure, test.return_pressure, test.temperature)
            self.tests.append((name, IsothermalRows.of(rows, oil), test.channels[0].value, NOISE[name]))

    def __call__(self, scaled):
        p = np.asarray(scaled) * SCALE
        parts = [(simulate(name, rows, WIDTH, p)[0] - value) / std for name, rows, value, std in self.tests]
        return np.concatenate(parts)


class PlainResidual:
    """Whitened residuals of the record on the reference simulator's general path, as a NumPy user would first write it."""

    def __init__(self, record):
        self.oil = Oil(*walther(POINTS))
        self.tests = []
        for name, test in record.tests.items():
            rows = Rows(
                test.spool_position, test.supply_pressure, test.return_pressure, test.temperature, test.direction
            )
            self.tests.append((name, rows, test.channels[0].value, NOISE[name]))

    def __call__(self, scaled):
        valve = Valve(WIDTH, *(np.asarray(scaled) * SCALE))
        parts = []
        for name, rows, value, std in self.tests:
            found = static_tests.TESTS[name](valve, self.oil, rows)[static_tests.READING[name]]
            parts.append((found - value) / std)
        return np.concatenate(parts)


PAUSE = 0.2  # s, in which the thread pool of the last contender falls asleep and stops taking a core from the next


def compare(contenders: dict[str, Callable[[], object]], rounds: int = 9) -> dict[str, float]:
    """Median seconds of each contender, run in turn so that a drifting machine hits all alike; one warm-up each."""
    for run in contenders.values():
        run()
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, run in contenders.items():
            time.sleep(PAUSE)
            run()  # once more warm: the pause has emptied the caches
            began = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - began)
    return {name: float(np.median(seconds)) for name, seconds in times.items()}


def machine() -> str:
    """One line on what the figures were measured on."""
    import os

    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}, {platform.system()}"
