"""Synthetic records on disk, by the independent simulator of tests/reference: valves that wear, some overhauled; some records with a
fault of the bench, some that cannot be read.
"""

import sys
from pathlib import Path

import numpy as np


ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from dataclasses import dataclass, replace
from datetime import date, timedelta

from helpers.records import NOISE, POINTS, STROKE
from helpers.small_bench import REACH, VALVE, rows_of
from reference import static_tests as reference
from reference.oil import Oil, walther
from reference.static_tests import IDEAL


BENCH = """# synthetic: made by the reference simulator, not measured
[valve]
name = "{serial}"
serial = "{serial}"
type = "{type}"
operating_hours = {hours:.0f}
stroke = "{stroke:.6g} um"
slot_width = "12 mm"

[oil]
viscosity = {points}

[test]
date = {date}
"""
TEST = """
[tests.{name}]
file = "{name}.csv"
noise = "{noise}"
"""
UNIT = {"leakage": ("l/min", 6e4), "pressure_gain": ("bar", 1e-5), "flow_gain": ("l/min", 6e4)}


@dataclass(frozen=True)
class Truth:
    """Of each valve: how fast its clearance grows [m/h], and whether it was overhauled. broken, faulty: names of folders."""

    rate: np.ndarray
    overhauled: np.ndarray
    broken: list[str]
    faulty: list[str]


def write_fleet(
    folder: Path, records: int, valves: int, seed: int = 1, broken: float = 0.0, faulty: float = 0.0
) -> Truth:
    """Records of so many valves in turn, 900 h and 292 days apart; the clearance of each grows, a fifth of them are overhauled half
    way. broken: share of records whose bench.toml cannot be read; faulty: whose leakage was read with its position's zero moved.
    """
    rng = np.random.default_rng(seed)
    oil = Oil(*walther(POINTS))
    points = [[f"{t:g} degC", f"{nu:g} cSt"] for t, nu in POINTS]
    level = 2.2e-6 + 0.2e-6 * rng.standard_normal(valves)
    rate = 0.12e-9 * (1.0 + 0.3 * rng.standard_normal(valves))  # m/h
    overhauled = rng.random(valves) < 0.2
    truth = Truth(rate, overhauled, [], [])
    for number in range(records):
        i, visit = number % valves, number // valves
        hours = 900.0 * visit + 100.0 * rng.random()
        since = hours - (0.5 * 900.0 * records / valves if overhauled[i] and hours > 450.0 * records / valves else 0.0)
        valve = replace(
            VALVE, clearance=float(level[i] + rate[i] * since), null_bias=float(1e-6 * rng.standard_normal())
        )
        name = f"S{i:04d}_{visit:02d}"
        here = folder / name
        here.mkdir(parents=True)
        said = {"serial": f"S{i:04d}", "type": f"T{i % 3}", "hours": hours, "stroke": STROKE * 1e6, "points": points}
        text = BENCH.format(**said, date=date(2018, 1, 15) + timedelta(days=292 * visit + 20 * (i % 12)))
        moved = faulty > 0.0 and rng.random() < faulty
        if moved:
            truth.faulty.append(name)
        for test in REACH:
            rows = rows_of(test)
            size = NOISE[test]
            value = reference.TESTS[test](valve, oil, rows, IDEAL)[reference.READING[test]]
            value = value + size * rng.standard_normal(len(value))
            unit, scale = UNIT[test]
            text += TEST.format(name=test, noise=f"{size * scale:.6g} {unit}")
            zero = 3e-6 if moved and test == "leakage" else 0.0
            _write_csv(here / f"{test}.csv", rows, zero, reference.READING[test], unit, value * scale)
        if rng.random() < broken:
            text = text.replace('stroke = "', "stroke = ")
            truth.broken.append(name)
        (here / "bench.toml").write_text(text)
    return truth


def _write_csv(path: Path, rows, zero: float, reading: str, unit: str, value: np.ndarray) -> None:
    header = f"run,spool_position [um],supply_pressure [bar],temperature [degC],{reading} [{unit}]"
    columns = (
        rows.run,
        (rows.spool_position + zero) * 1e6,
        rows.supply_pressure / 1e5,
        rows.temperature - 273.15,
        value,
    )
    lines = [f"{r:d},{x:.4f},{p:.4f},{t:.3f},{v:.6g}" for r, x, p, t, v in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *lines]) + "\n")
