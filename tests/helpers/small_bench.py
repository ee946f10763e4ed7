"""Small bench records with something missing from the model, made by the reference simulator: 256 rows a test, known truth.

Every record has the same shape, so that one compiled program serves them all.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from reference import static_tests as reference
from reference.oil import Oil, walther
from reference.port_storage import swept_together
from reference.valve import Effects, Rows, Valve

from helpers.records import NOISE, POINTS, STROKE, noise_of
from thermohyd.identify.bench.record import BenchRecord, ValveData
from thermohyd.identify.bench.sweeps import sweep_direction, sweep_rate
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.oil_definition import OilDefinition


CONDITIONS = tuple((t + 273.15, p) for t in (0.0, 30.0, 60.0) for p in (70e5, 210e5))  # K, Pa
RUNS = (0, 1, 2, 3, 4, 5, 1, 4)  # two conditions are run twice
POINTS_UP = 16
RATES = (5e-6, 20e-6)  # m/s
REACH = {"leakage": 1.0, "pressure_gain": 0.3, "flow_gain": 1.0}  # of the stroke
SLOT_WIDTH = 12e-3  # m
VALVE = Valve(
    slot_width=SLOT_WIDTH,
    edge_radius=11e-6,
    clearance=2.4e-6,
    underlap=9e-6,
    discharge_coefficient=0.69,
    transition_number=95.0,
    null_bias=1.5e-6,
)


def there_and_back() -> np.ndarray:
    """From -1 to 1 and back, evenly; the way down lies between the points of the way up."""
    up = np.linspace(-1.0, 1.0, POINTS_UP)
    between = np.concatenate([up[:1], 0.5 * (up[:-1] + up[1:])])[::-1]
    return np.concatenate([up, between])


def cycle(reach: float) -> np.ndarray:
    """Positions [m] up and down, denser near null; those of the way down lie between those of the way up."""
    s = there_and_back()
    return reach * STROKE * np.sinh(3.5 * s) / np.sinh(3.5)


def rows_of(test: str, runs: tuple[int, ...] = RUNS) -> Rows:
    """One cycle for every entry of `runs`, the number of its condition; slow and fast ones in turn."""
    x = cycle(REACH[test])
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    direction = np.where(np.arange(len(x)) < POINTS_UP, 1.0, -1.0)
    each = [CONDITIONS[number] for number in runs]
    spread = lambda values: np.repeat(np.asarray(values, dtype=float), len(x))
    rates = [RATES[(number // 2 + number) % 2] for number in runs]
    return Rows(
        np.tile(x, len(runs)),
        spread([p for _, p in each]),
        np.zeros(len(x) * len(runs)),
        spread([t for t, _ in each]),
        np.tile(direction, len(runs)),
        time=np.concatenate([way / rate for rate in rates]),
        run=np.repeat(np.arange(len(runs)), len(x)),
        rate=np.tile(direction, len(runs)) * spread(rates),
    )


def conditions_only(test: str, runs: tuple[int, ...] = RUNS, **columns: Any) -> TestRecord:
    """A test whose readings are all 0: for what looks at conditions only."""
    return _test(test, rows_of(test, runs), np.zeros(len(runs) * 2 * POINTS_UP), None, columns)


def small_record(
    effects: dict[str, Any] | None = None,
    *,
    seed: int = 0,
    phi: float = 0.0,
    noise: float = 1.0,
    declared: bool = True,
    valve: dict[str, Any] | None = None,
    position_noise: float = 0.0,
    **start: Any,
) -> BenchRecord:
    """A record of `VALVE` with effects at these amounts and noise `noise` times the usual (AR(1) with `phi`).

    position_noise: of the positions read [m], of which the rates are made as a reader makes them.
    valve: parameters that replace those of `VALVE`, each a number or a function of `Rows` that gives one per row.
    """
    oil, rng = Oil(*walther(POINTS)), np.random.default_rng(seed)
    made = {}
    for test in REACH:
        rows = rows_of(test)
        own: dict[str, Any] = {n: value(rows) if callable(value) else value for n, value in (valve or {}).items()}
        exact = reference.TESTS[test](replace(VALVE, **own), oil, rows, Effects(**(effects or {})))
        size = noise * NOISE[test]
        value = exact[reference.READING[test]] + noise_of(rng, rows, size, phi)
        read: dict[str, Any] = {}
        if position_noise:
            assert rows.run is not None
            assert rows.time is not None
            x = rows.spool_position + position_noise * rng.standard_normal(len(value))
            rate, direction = sweep_rate(x, rows.time, rows.run), sweep_direction(x, rows.run)
            read = {"spool_position": x, "rate": rate, "direction": direction}
        made[test] = _test(test, rows, value, np.full(len(value), size) if declared else None, read)
    return record_of(made, **start)


def blocked_record(
    compliance: tuple[float, float] = (0.0, 0.0), *, seed: int = 0, noise: float = 1.0, **effects: Any
) -> BenchRecord:
    """Leakage and pressure gain of `VALVE`, white noise; what the ports A and B store [m3/Pa], and other effects."""
    oil, rng, made = Oil(*walther(POINTS)), np.random.default_rng(seed), {}
    for test in ("leakage", "pressure_gain"):
        rows = rows_of(test)
        exact = swept_together(VALVE, oil, rows, Effects(**effects), compliance)
        exact["load_pressure"] = exact["pressure_a"] - exact["pressure_b"]
        size = noise * NOISE[test]
        value = exact[reference.READING[test]] + noise_of(rng, rows, size, 0.0)
        made[test] = _test(test, rows, value, np.full(len(value), size), {})
    return record_of(made)


def record_of(tests: dict[str, TestRecord], **start: Any) -> BenchRecord:
    """These tests of a valve of `VALVE`'s size and oil."""
    body = ValveData("small", STROKE, SLOT_WIDTH, rated_current=25e-3)
    return BenchRecord(Path("small"), "small", body, OilDefinition(*walther(POINTS)), tests, dict(start))


def _test(name: str, rows: Rows, value: np.ndarray, std: np.ndarray | None, columns: dict[str, Any]) -> TestRecord:
    assert rows.run is not None
    source = "declared in bench.toml" if std is not None else ""
    content: dict[str, Any] = {
        "spool_position": rows.spool_position,
        "supply_pressure": rows.supply_pressure,
        "return_pressure": rows.return_pressure,
        "temperature": rows.temperature,
        "channels": (Channel(reference.READING[name], value, std, source),),
        "run": rows.run,
        "run_names": tuple(str(run) for run in np.unique(rows.run)),
        "direction": rows.direction,
        "time": rows.time,
        "rate": rows.rate,
    }
    return TestRecord(name=name, path=Path(f"{name}.csv"), **{**content, **columns})
