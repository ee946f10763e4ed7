"""Bench records made by the reference simulator, as the reader would return them: no files, known truth."""

from pathlib import Path

import numpy as np
from reference import static_tests as reference
from reference.oil import Oil, walther
from reference.static_tests import IDEAL
from reference.valve import Effects, Rows, Valve
from scipy.signal import lfilter

from thermohyd.identify.bench.record import BenchRecord, ValveData
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.oil_definition import OilDefinition


STROKE = 213e-6
POINTS = [[-40.0, 368.28], [100.0, 5.2244]]  # degC, cSt
NOISE = {"leakage": 0.004 / 6e4, "pressure_gain": 0.4e5, "flow_gain": 0.03 / 6e4}
TEMPERATURES = (253.15, 288.15, 333.15)
SUPPLIES = (70e5, 210e5)


def one_sweep(points: int) -> np.ndarray:
    """Positions [m] from one end of the stroke to the other, denser near null."""
    s = np.linspace(-1.0, 1.0, points)
    return STROKE * (0.12 * s + 0.88 * s**5)


def operating_points(
    points: int, temperatures: tuple[float, ...] = TEMPERATURES, supplies: tuple[float, ...] = SUPPLIES
) -> Rows:
    """Sweeps up and down at every temperature and supply pressure."""
    up = one_sweep(points)
    sweeps = [(x, t, p) for t in temperatures for p in supplies for x in (up, up[::-1])]
    x = np.concatenate([s[0] for s in sweeps])
    spread = lambda values: np.repeat(np.asarray(values, dtype=float), points)
    direction = spread([1.0 if s[0][0] < 0 else -1.0 for s in sweeps])
    run = np.repeat(np.arange(len(sweeps)), points)
    return Rows(x, spread([s[2] for s in sweeps]), np.zeros(len(x)), spread([s[1] for s in sweeps]), direction, run=run)


def noise_of(rng: np.random.Generator, rows: Rows, std: float, phi: float) -> np.ndarray:
    """Stationary AR(1) noise, independent from run to run; phi = 0 is white."""
    out = np.empty(len(rows.spool_position))
    assert rows.run is not None
    for run in np.unique(rows.run):
        where = np.flatnonzero(rows.run == run)
        white = rng.standard_normal(len(where) + 200) * std * np.sqrt(1.0 - phi**2)
        out[where] = lfilter([1.0], [1.0, -phi], white)[200:]
    return out


def synthetic_record(
    valve: Valve,
    rng: np.random.Generator,
    *,
    points: int = 31,
    phi: float = 0.0,
    noise: float = 1.0,
    declared: bool = True,
    tests: tuple[str, ...] = ("leakage", "pressure_gain", "flow_gain"),
    temperatures: tuple[float, ...] = TEMPERATURES,
    supplies: tuple[float, ...] = SUPPLIES,
    effects: Effects = IDEAL,
    **start,
) -> BenchRecord:
    """A record of `valve` with `noise` times the usual noise; `declared`: bench.toml would state its standard deviation."""
    oil = Oil(*walther(POINTS))
    rows = operating_points(points, temperatures, supplies)
    made = {}
    for test in tests:
        channel = reference.READING[test]
        size = noise * NOISE[test]
        value = reference.TESTS[test](valve, oil, rows, effects)[channel] + noise_of(rng, rows, size, phi)
        std = np.full(len(value), size) if declared else None
        assert rows.direction is not None
        assert rows.run is not None
        made[test] = TestRecord(
            name=test,
            path=Path(f"{test}.csv"),
            spool_position=rows.spool_position,
            supply_pressure=rows.supply_pressure,
            return_pressure=rows.return_pressure,
            temperature=rows.temperature,
            channels=(Channel(channel, value, std, "declared in bench.toml" if declared else ""),),
            run=rows.run,
            run_names=tuple(str(r) for r in np.unique(rows.run)),
            direction=rows.direction,
        )
    a, b = walther(POINTS)
    body = ValveData("synthetic", STROKE, 12e-3, rated_current=25e-3)
    return BenchRecord(Path("synthetic"), "synthetic", body, OilDefinition(a, b), made, dict(start))


def random_valve(rng: np.random.Generator) -> Valve:
    """Edge radius 3 to 20 um, clearance 1.5 to 4 um, underlap 0 to 18 um, and coefficients around the usual ones."""
    return Valve(
        slot_width=12e-3,
        edge_radius=rng.uniform(3e-6, 20e-6),
        clearance=rng.uniform(1.5e-6, 4e-6),
        underlap=rng.uniform(0.0, 18e-6),
        discharge_coefficient=rng.uniform(0.6, 0.78),
        transition_number=rng.uniform(60.0, 150.0),
        null_bias=rng.uniform(-3e-6, 3e-6),
    )
