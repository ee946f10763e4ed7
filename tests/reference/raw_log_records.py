"""Raw logs of an ideal valve, by this simulator: 2,000 to 200,000 rows, sine or triangle, white noise stated or not.

Nothing is missing from the model: a fit's intervals should hold the truth, and a diagnosis should find nothing.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from reference import static_tests
from reference.oil import Oil, walther
from reference.valve import Rows, Valve


STROKE = 213e-6
NARROW = 60e-6  # sweep of a pressure-gain test
SUPPLY, TEMPERATURE = 70e5, 313.15
SECONDS, SWEEPS = 100.0, 2
NOISE = {"leakage": 2e-3 / 6e4, "flow_gain": 0.03 / 6e4, "pressure_gain": 0.3e5}
UNIT = {"leakage": ("l/min", 6e4), "flow_gain": ("l/min", 6e4), "pressure_gain": ("bar", 1e-5)}
VALVE = Valve()
OILS = {22: 4.3, 32: 5.4, 46: 6.8, 68: 8.7}  # cSt at 40 and at 100 degC


@dataclass(frozen=True)
class Setting:
    """What is on the bench, and under which conditions (SI). noise: times `NOISE`."""

    valve: Valve = VALVE
    grade: int = 32  # of the oil, cSt at 40 degC
    supply: float = SUPPLY
    temperature: float = TEMPERATURE
    noise: float = 1.0


def any_setting(seed: int, coefficient: float | None = None) -> Setting:
    """Any valve, oil and bench, drawn by seed: edges as in `hidden_bench`, a discharge coefficient of 0.60 to 0.75 unless it is given."""
    random = np.random.default_rng([51, seed])
    valve = Valve(
        edge_radius=random.uniform(3e-6, 20e-6),
        clearance=random.uniform(1.5e-6, 4e-6),
        underlap=random.uniform(0.0, 18e-6),
        discharge_coefficient=random.uniform(0.60, 0.75),
        transition_number=random.uniform(60.0, 150.0),
        null_bias=random.uniform(-3e-6, 3e-6),
    )
    valve = valve if coefficient is None else replace(valve, discharge_coefficient=coefficient)
    grade, supply = random.choice(list(OILS)), random.choice([70e5, 140e5, 210e5])
    celsius = round(random.uniform(20.0, 55.0), 2)
    return Setting(valve, int(grade), float(supply), celsius + 273.15, float(10.0 ** random.uniform(0.0, 1.0)))


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


def write(folder: Path, log: Log, every: int = 1, setting: Setting | None = None) -> None:
    """A record of the log, or of its every k-th row. setting: default the seed valve's."""
    here = Setting() if setting is None else setting
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(log.seed)
    hot = OILS[here.grade]
    oil = Oil(*walther([[40.0, float(here.grade)], [100.0, hot]]))
    lines = ['[valve]\nname = "raw log, made by the reference simulator"\nstroke = "213 um"\nslot_width = "12 mm"\n\n[oil]\n'
             f'viscosity = [["40 degC", "{here.grade} cSt"], ["100 degC", "{hot} cSt"]]\n']  # fmt: skip
    bar, celsius = here.supply * 1e-5, here.temperature - 273.15
    for test in log.tests:
        time, position, run = sweep(log, test)
        one = np.ones(len(position))
        channel = static_tests.READING[test]
        rows = Rows(position, here.supply * one, 0.0 * one, here.temperature * one)
        unit, factor = UNIT[test]
        noise = here.noise * NOISE[test]
        exact = static_tests.TESTS[test](here.valve, oil, rows)[channel]
        value = (exact + rng.normal(0.0, noise, len(one))) * factor
        with (folder / f"{test}.csv").open("w", encoding="utf-8") as file:
            file.write(
                f"time [s],run,spool_position [um],supply_pressure [bar],temperature [degC],{channel} [{unit}]\n"
            )
            file.writelines(
                f"{t:.4f},{r + 1},{x * 1e6:.4f},{bar:.2f},{celsius:.2f},{y:.6f}\n"
                for t, r, x, y in list(zip(time, run, position, value, strict=True))[::every]
            )
        stated = f'noise = "{noise * factor:g} {unit}"\n' if log.stated else ""
        lines.append(f'\n[tests.{test}]\nfile = "{test}.csv"\n{stated}')
    (folder / "bench.toml").write_text("".join(lines), encoding="utf-8")
