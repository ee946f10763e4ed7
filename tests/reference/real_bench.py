"""A bench as benches are: noisy positions, rounded readings, two rates, records of a few sweeps; and what its noise leaves to see.

Everything of a record but what is hidden in it. `Scale` says how large a change of the readings is beside that noise.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from reference import port_storage, static_tests
from reference.hidden_bench import CHANNELS, OILS, REACH, STROKE, random_bench
from reference.hidden_size import STEPS
from reference.oil import Oil
from reference.valve import Effects, Rows, Valve


STORES = ("port_compliance_a", "port_compliance_b")
TEMPERATURES = ((40.0,), (25.0, 50.0), (20.0, 55.0), (10.0, 40.0), (15.0, 40.0, 60.0))  # degC
SUPPLIES = ((70.0, 210.0), (100.0, 200.0), (140.0,))  # bar
RATES = ((4.0, 20.0), (5.0, 15.0), (3.0, 25.0))  # um/s
DIGITS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # steps to which a logger rounds, in the file's unit
UNITS = {"leakage_flow": ("l/min", 1e-3 / 60.0), "flow": ("l/min", 1e-3 / 60.0)} | dict.fromkeys(
    ("load_pressure", "pressure_a", "pressure_b"), ("bar", 1e5)
)
BLOCKED = ("leakage", "pressure_gain")
STORAGE_TOLERANCE = 1e-4
MOST_BINS = 150  # of a run, for sizes in noise units

Readings = dict[tuple[str, str], np.ndarray]


@dataclass(frozen=True)
class Run:
    """One cycle, up and down. start [s] in the record's time; rate [m/s]; temperature [degC], supply [bar]: as they are."""

    name: str
    test: str
    temperature: float
    supply: float
    rate: float
    start: float


@dataclass(frozen=True)
class Bench:
    """Runs of equally many rows, and their noise (SI). raw: even in time, as a logger takes them; else a table of points.

    noise, step: {channel: standard deviation, rounding}; phi: lag-one correlation of the readings' noise along a run.
    position_noise: of the transducer; position_step: to which it is rounded; dither: of the spool itself, which readings follow.
    """

    valve: Valve
    oil_name: str
    runs: tuple[Run, ...]
    points: int
    raw: bool
    sine: bool
    noise: dict[str, float]
    step: dict[str, float]
    phi: float
    position_noise: float
    position_step: float
    dither: float
    seed: tuple[int, ...]
    made: dict[str, Rows] = field(default_factory=dict, compare=False, repr=False)
    swept: dict[tuple, dict[str, dict[str, np.ndarray]]] = field(default_factory=dict, compare=False, repr=False)

    @property
    def oil(self) -> Oil:
        return OILS[self.oil_name][1]

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(test for test in CHANNELS if any(run.test == test for run in self.runs))

    @property
    def channels(self) -> list[tuple[str, str]]:
        return [(test, channel) for test in self.tests for channel in CHANNELS[test] if channel in self.noise]

    def runs_of(self, test: str) -> list[Run]:
        return [run for run in self.runs if run.test == test]

    def rows(self, test: str) -> Rows:
        """Where the valve really is: position, direction and rate of the sweep, time from the start of each run."""
        if test not in self.made:
            runs = self.runs_of(test)
            cycles = [self._cycle(REACH[test] * STROKE, run.rate) for run in runs]
            x, time, rate = (np.concatenate(parts) for parts in zip(*cycles, strict=True))
            shaken = np.random.default_rng([*self.seed, 7, list(CHANNELS).index(test)]).standard_normal(len(x))
            spread = lambda values: np.repeat(np.asarray(values, dtype=float), self.points)
            self.made[test] = Rows(
                x + self.dither * shaken,
                spread([run.supply for run in runs]) * 1e5,
                np.zeros(len(x)),
                spread([run.temperature for run in runs]) + 273.15,
                direction=np.where(rate >= 0.0, 1.0, -1.0),
                time=time,
                run=np.repeat(np.arange(len(runs)), self.points),
                rate=rate,
            )
        return self.made[test]

    def clock(self, test: str) -> np.ndarray:
        """The record's time [s], which runs on from test to test."""
        time = self.rows(test).time
        assert time is not None
        return time + np.repeat([run.start for run in self.runs_of(test)], self.points)

    def _cycle(self, reach: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(position, time, rate) of one run: a triangle or a sine from end to end and back."""
        last = 4.0 * reach / rate
        if not self.raw:  # denser near null; the points of the way down lie between those of the way up
            s = np.linspace(-1.0, 1.0, self.points // 2)
            s = np.concatenate([s, np.concatenate([[-1.0], 0.5 * (s[:-1] + s[1:])])[::-1]])
            x = reach * np.sinh(2.5 * s) / np.sinh(2.5)
            up = np.arange(self.points) < self.points // 2
            return x, np.where(up, x + reach, 3.0 * reach - x) / rate, np.where(up, rate, -rate)
        time = last * np.arange(self.points) / self.points
        up = time <= 0.5 * last
        if self.sine:
            angle = 2.0 * np.pi * time / last
            return -reach * np.cos(angle), time, 2.0 * np.pi * reach / last * np.sin(angle)
        return np.where(up, rate * time - reach, 3.0 * reach - rate * time), time, np.where(up, rate, -rate)

    def readings(self, valve: Valve, effects: dict[str, float], rows: dict[str, Rows] | None = None) -> Readings:
        """Noise-free readings [SI] by (test, channel), at the true rows or at others."""
        stored = (effects.get(STORES[0], 0.0), effects.get(STORES[1], 0.0))
        others = Effects(**{k: v for k, v in effects.items() if k not in STORES})
        values = {}
        for test in self.tests:
            if any(stored) and test in BLOCKED:
                assert (valve, rows) == (self.valve, None)
                values[test] = self._storing(others, stored, tuple(effects.items()))[test]
            else:
                at = self.rows(test) if rows is None else rows[test]
                values[test] = static_tests.TESTS[test](valve, self.oil, at, others)
        return {(test, channel): values[test][channel] for test, channel in self.channels}

    def _storing(self, others: Effects, stored: tuple[float, float], key: tuple) -> dict[str, dict[str, np.ndarray]]:
        """Both tests with blocked ports side by side, which takes as long as one; and each amount only once."""
        if key not in self.swept:
            tests = [test for test in self.tests if test in BLOCKED]
            parts = [vars(self.rows(test)) for test in tests]
            parts = [part | {"run": part["run"] + 1000 * i} for i, part in enumerate(parts)]
            joined: dict[str, Any] = {
                name: None if value is None else np.concatenate([part[name] for part in parts])
                for name, value in parts[0].items()
            }
            read = port_storage.swept_together(self.valve, self.oil, Rows(**joined), others, stored, STORAGE_TOLERANCE)
            read["load_pressure"] = read["pressure_a"] - read["pressure_b"]
            ends = np.cumsum([len(part["run"]) for part in parts])[:-1]
            split = {channel: np.split(value, ends) for channel, value in read.items()}
            self.swept[key] = {test: {c: v[i] for c, v in split.items()} for i, test in enumerate(tests)}
        return self.swept[key]


@dataclass(frozen=True)
class Scale:
    """Changes of a bench's readings in units of its noise: correlated, rounded, and with the position's as effective variance."""

    bench: Bench

    @cached_property
    def ideal(self) -> Readings:
        return self.bench.readings(self.bench.valve, {})

    @cached_property
    def slopes(self) -> dict[str, Readings]:
        """Derivatives of the readings by the six parameters."""
        found = {}
        for name, step in STEPS.items():
            at = lambda sign, name=name, step=step: self.bench.readings(
                replace(self.bench.valve, **{name: getattr(self.bench.valve, name) + sign * step}), {}
            )
            high, low = at(1.0), at(-1.0)
            found[name] = {key: (high[key] - low[key]) / (2.0 * step) for key in high}
        return found

    def effective_noise(self, key: tuple[str, str]) -> np.ndarray:
        """Standard deviation of each row [SI]: the reading's, its rounding, and what the position's noise makes of the slope."""
        b = self.bench
        at_position = b.position_noise**2 + b.position_step**2 / 12.0
        own = b.noise[key[1]] ** 2 + b.step[key[1]] ** 2 / 12.0
        return np.sqrt(own + self.slopes["null_bias"][key] ** 2 * at_position)

    @property
    def _width(self) -> int:
        return -(-self.bench.points // MOST_BINS)

    def _binned(self, values: np.ndarray) -> np.ndarray:
        """Means of neighbours within each run: (runs, bins)."""
        runs = values.reshape(-1, self.bench.points)
        whole = runs.shape[1] // self._width * self._width
        return runs[:, :whole].reshape(len(runs), -1, self._width).mean(axis=2)

    @cached_property
    def _roots(self) -> dict[tuple[str, str], list[np.ndarray]]:
        """Cholesky factor of each run's covariance, by channel."""
        b, width = self.bench, self._width
        lags = np.abs(np.subtract.outer(np.arange(b.points), np.arange(b.points)))
        kept = b.points // width * width
        found = {}
        for key in b.channels:
            smooth = b.noise[key[1]] ** 2 * (b.phi**lags if b.phi else np.eye(b.points))
            extra = (self.effective_noise(key) ** 2 - b.noise[key[1]] ** 2).reshape(-1, b.points)
            found[key] = []
            for row in extra:
                full = (smooth + np.diag(row))[:kept, :kept]
                means = full.reshape(kept // width, width, kept // width, width).mean(axis=(1, 3))
                found[key].append(cholesky(means, lower=True))
        return found

    def whitened(self, difference: Readings) -> np.ndarray:
        parts = []
        for key, roots in self._roots.items():
            for root, run in zip(roots, self._binned(difference[key]), strict=True):
                parts.append(solve_triangular(root, run, lower=True))
        return np.concatenate(parts)

    @cached_property
    def columns(self) -> np.ndarray:
        """Whitened derivatives by the six parameters: (values, 6)."""
        return np.stack([self.whitened(slope) for slope in self.slopes.values()], axis=1)


def random_real_bench(
    random: np.random.Generator, seed: tuple[int, ...], *, raw: bool, complete: bool, plain: bool, ports: bool
) -> Bench:
    """A valve, an oil and a short programme. complete: no test is missing; plain: no dither, no sine, few rows."""
    pick = lambda options: options[int(random.integers(len(options)))]
    base = random_bench(random, correlated=False, ports_measured=ports)
    temperatures, supplies = pick(TEMPERATURES), pick(SUPPLIES)
    while not 2 <= len(temperatures) * len(supplies) <= 4:
        temperatures, supplies = pick(TEMPERATURES), pick(SUPPLIES)
    tests = list(CHANNELS)
    if not complete and random.random() < 0.3:
        tests.remove(pick(("pressure_gain", "flow_gain")))
    runs = _programme(random, tests, temperatures, supplies)
    total = np.exp(random.uniform(*np.log((2000.0, 4000.0 if plain else 12000.0) if raw else (650.0, 1500.0))))
    points = int(np.clip(total / len(runs), 60, 1e9 if raw else 200))
    # Positions: noisy, or rounded coarsely, or (of raw logs) a shaken spool whose reading is rounded.
    noisy, rounded, shaken = (np.exp(random.uniform(*np.log(r))) for r in ((0.02, 0.15), (0.02, 0.05), (0.05, 0.1)))
    way = pick(("noisy", "noisy", "rounded") if plain or not raw else ("noisy", "rounded", "shaken"))
    step = {"noisy": 0.001, "rounded": pick((0.1, 0.2)), "shaken": pick((0.1, 0.2))}[way]
    sizes = {c: (pick((0.3, 0.6, 1.2)) * s / UNITS[c][1], UNITS[c][1]) for c, s in base.noise.items()}
    return Bench(
        replace(base.valve, null_pressure=supplies[0] * 1e5),
        base.oil_name,
        runs,
        points // 2 * 2,
        raw,
        bool(raw and not plain and random.random() < 0.5),
        base.noise,
        {c: max([d for d in DIGITS if d <= wanted] or DIGITS[:1]) * size for c, (wanted, size) in sizes.items()},
        float(random.uniform(0.4, 0.9) if raw else random.uniform(0.3, 0.7)) if random.random() < 0.4 else 0.0,
        1e-6 * float(noisy if way == "noisy" else rounded),
        1e-6 * step,
        1e-6 * float(shaken) if way == "shaken" else 0.0,
        seed,
    )


def _programme(
    random: np.random.Generator, tests: list[str], temperatures: tuple[float, ...], supplies: tuple[float, ...]
) -> tuple[Run, ...]:
    """Every condition, slow or fast by turns, the first one at both; in some records a third rate, in some a repeat."""
    slow, fast = RATES[int(random.integers(len(RATES)))]
    other = float(np.round(np.sqrt(slow * fast), 1)) if random.random() < 0.3 else fast
    repeated, runs, clock = bool(random.random() < 0.4), [], 0.0
    for test in tests:
        wanted = []
        for i, temperature in enumerate(temperatures):
            for k, supply in enumerate(supplies):
                wanted.append((temperature, supply, (slow, fast)[(i + k) % 2]))
                if not wanted[1:] or len(temperatures) * len(supplies) == 2:
                    wanted.append((temperature, supply, (other, slow)[(i + k) % 2]))
        wanted += wanted[:1] if repeated else []
        for temperature, supply, rate in wanted:
            runs.append(Run(f"R{len(runs) + 1}", test, temperature, supply, rate * 1e-6, round(clock, 3)))
            clock += 4.0 * REACH[test] * STROKE / (rate * 1e-6) + random.uniform(20.0, 120.0)
    return tuple(runs)
