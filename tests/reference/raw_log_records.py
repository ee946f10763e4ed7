"""Raw logs of an ideal valve, by this simulator: 2,000 to 200,000 rows, sine or triangle, white noise stated or not.

Nothing is missing from the model: a fit's intervals should hold the truth, and a diagnosis should find nothing.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from reference import static_tests
from reference.oil import Oil, walther
from reference.valve import Rows, Valve


STROKE = 213e-6
NARROW = 60e-6  # sweep of a pressure-gain test
SUPPLY, TEMPERATURE = 70e5, 313.15
POINTS = [[40.0, 32.0], [100.0, 5.4]]  # degC, cSt
SECONDS, SWEEPS = 100.0, 2
NOISE = {"leakage": 2e-3 / 6e4, "flow_gain": 0.03 / 6e4, "pressure_gain": 0.3e5}
UNIT = {"leakage": ("l/min", 6e4), "flow_gain": ("l/min", 6e4), "pressure_gain": ("bar", 1e-5)}
VALVE = Valve()


@dataclass(frozen=True)
class Log:
    """How one record is logged. rows: of each test. stated: its noise stands in bench.toml. repeats: runs of each test."""

    rows: int
    tests: tuple[str, ...]
    seed: int
    sine: bool = False
    stated: bool = False
    repeats: int = 1


def plan(count: int, first_seed: int) -> list[Log]:
    """A mixture of logs: every size, number of tests, shape and knowledge of the noise comes by turns."""
    sizes = (2_000, 6_000, 20_000, 60_000, 200_000)
    tests = (("leakage",), ("leakage", "flow_gain"), ("leakage", "flow_gain", "pressure_gain"))
    return [
        Log(sizes[i % 5], tests[i % 3], first_seed + i, sine=bool(i % 2), stated=bool(i // 2 % 2)) for i in range(count)
    ]


def sweep(log: Log, test: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(time, position, run) of a test's rows: each run sweeps to and fro, starting at null."""
    rows = log.rows // log.repeats
    phase = 2.0 * np.pi * SWEEPS * np.arange(rows) / rows
    shape = np.sin(phase) if log.sine else 2.0 / np.pi * np.arcsin(np.sin(phase))
    position = (NARROW if test == "pressure_gain" else STROKE) * np.tile(shape, log.repeats)
    time = np.arange(len(position)) * SECONDS / rows
    return time, position, np.repeat(np.arange(log.repeats), rows)


def write(folder: Path, log: Log, every: int = 1, valve: Valve = VALVE) -> None:
    """A record of the log, or of its every k-th row."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(log.seed)
    oil = Oil(*walther(POINTS))
    lines = ['[valve]\nname = "raw log, made by the reference simulator"\nstroke = "213 um"\nslot_width = "12 mm"\n\n[oil]\n'
             'viscosity = [["40 degC", "32 cSt"], ["100 degC", "5.4 cSt"]]\n']  # fmt: skip
    for test in log.tests:
        time, position, run = sweep(log, test)
        one = np.ones(len(position))
        channel = static_tests.READING[test]
        rows = Rows(position, SUPPLY * one, 0.0 * one, TEMPERATURE * one)
        unit, factor = UNIT[test]
        value = (static_tests.TESTS[test](valve, oil, rows)[channel] + rng.normal(0.0, NOISE[test], len(one))) * factor
        with (folder / f"{test}.csv").open("w", encoding="utf-8") as file:
            file.write(
                f"time [s],run,spool_position [um],supply_pressure [bar],temperature [degC],{channel} [{unit}]\n"
            )
            file.writelines(
                f"{t:.4f},{r + 1},{x * 1e6:.4f},70.00,40.00,{y:.6f}\n"
                for t, r, x, y in list(zip(time, run, position, value, strict=True))[::every]
            )
        noise = f'noise = "{NOISE[test] * factor:g} {unit}"\n' if log.stated else ""
        lines.append(f'\n[tests.{test}]\nfile = "{test}.csv"\n{noise}')
    (folder / "bench.toml").write_text("".join(lines), encoding="utf-8")
