"""Logs as another simulator's bench writes them, and the same log again with one nuisance off: what does each do to a diagnosis?

Each nuisance has random numbers of its own, so that a record drawn without it is otherwise the same to the last digit. What is hidden
(one effect in every other record) is handed out with the record: whoever fits with it has nothing left to find.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np
from scipy.signal import lfilter

from reference import static_tests
from reference.hidden_bench import CHANNELS, OILS, REACH, STROKE, random_bench
from reference.hidden_records import HiddenRecord
from reference.real_bench import UNITS
from reference.sample_text import LABEL
from reference.valve import Effects, Rows, Valve


# conditions: noise and steps of logged supply and temperature; position: noise of the transducer; rounding: steps of readings and of
# positions; dither: of the spool, which readings follow; wander: of supply and temperature, which they follow too; share: a second
# part of the readings' noise, in proportion to them; memory: of that noise; rates: two in a record.
NUISANCES = ("conditions", "position", "rounding", "dither", "wander", "share", "memory", "rates")
EFFECTS = {
    "hysteresis": (0.3e-6, 1e-6),
    "bushing_leakage": (1e-14, 4e-14),
    "pilot_leakage": (8e-11, 3e-10),
    "return_edge_wear": (6e-6, 15e-6),
    "unequal_underlap": (1e-6, 3e-6),
    "flow_saturation": (1e13, 3e13),
    "pressure_clearance": (1.5e-14, 3e-14),
}
RATED_CURRENT = 25e-3  # A, over the stroke
ROWS = (1_000, 30_000)  # of a test


@dataclass(frozen=True)
class Log:
    """A record's plan (SI). runs: (test, supply, temperature, rate) each; share: {channel: share of the reading}; steps: {column: step}.

    position_noise, dither: of one row; supply, temperature: (noise of a row, size of the wander); current: positions are logged as one.
    """

    seed: int
    off: frozenset[str]
    stated: bool
    valve: Valve
    oil_name: str
    effects: dict[str, float]
    runs: tuple[tuple[str, float, float, float], ...]
    rows: int
    noise: dict[str, float]
    share: dict[str, float]
    steps: dict[str, float]
    phi: float
    position_noise: float
    dither: float
    supply: tuple[float, float]
    temperature: tuple[float, float]
    current: bool

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(run[0] for run in self.runs))

    @property
    def rows_of_run(self) -> dict[str, int]:
        return {test: self.rows // sum(run[0] == test for run in self.runs) for test in self.tests}

    def has(self, nuisance: str) -> bool:
        return nuisance not in self.off


def draw(seed: int, *, off: Iterable[str] = (), stated: bool | None = None, most_rows: int = ROWS[1]) -> Log:
    """The log of a seed; off: nuisances that it has not. stated: every row's noise stands beside it; None: in every third log."""
    random = np.random.default_rng([seed, 5329])
    pick = lambda options: options[int(random.integers(len(options)))]
    gauges = bool(random.random() < 0.4)
    base = random_bench(random, correlated=False, ports_measured=gauges)
    supplies = pick(((70.0, 210.0), (100.0, 200.0), (140.0, 210.0)))
    temperatures = pick(((40.0,), (25.0, 50.0)))
    slow, fast = pick(((4.0, 20.0), (5.0, 15.0), (3.0, 25.0)))
    runs = []
    for test in CHANNELS:
        for i, temperature in enumerate(temperatures):
            for k, supply in enumerate(supplies):
                rate = slow if "rates" in off or (i + k) % 2 == 0 else fast
                runs.append((test, supply * 1e5, temperature + 273.15, rate * 1e-6))
    name = pick(tuple(EFFECTS))
    amount = float(np.exp(random.uniform(*np.log(EFFECTS[name]))))
    kept = lambda nuisance, value, none=0.0: none if nuisance in off else value
    shares = {channel: kept("share", random.uniform(0.001, 0.004)) for channel in base.noise}
    steps = {c: kept("rounding", pick((0.02, 0.3, 1.0)) * s, 1e-9 * s) for c, s in base.noise.items()}
    current = bool(random.random() < 0.25)
    x_step = pick((0.1, 0.2)) * 1e-3 / RATED_CURRENT * STROKE if current else pick((0.01, 0.05, 0.1)) * 1e-6
    position_noise = random.uniform(0.05, 0.2) * 1e-6
    dither = random.uniform(0.05, 0.15) * 1e-6
    phi = random.uniform(0.4, 0.9) if random.random() < 0.4 else 0.0
    return Log(
        seed,
        frozenset(off),
        seed % 3 == 0 if stated is None else stated,
        replace(base.valve, null_pressure=supplies[0] * 1e5),
        base.oil_name,
        {name: amount} if seed % 2 else {},
        tuple(runs),
        int(np.exp(random.uniform(*np.log((ROWS[0], most_rows))))),
        {channel: 0.4 * size for channel, size in base.noise.items()},
        shares,
        steps
        | {
            "position": kept("rounding", x_step, 1e-13),
            "supply_pressure": kept("conditions", 0.1e5, 1e-4),
            "temperature": kept("conditions", 0.1, 1e-9),
        },
        kept("memory", phi),
        kept("position", position_noise),
        kept("dither", dither),
        (kept("conditions", 0.05e5), kept("wander", random.uniform(0.1, 0.5) * 1e5)),
        (kept("conditions", 0.03), kept("wander", random.uniform(0.2, 1.0))),
        current,
    )


def _random(log: Log, what: str, *more: int) -> np.random.Generator:
    return np.random.default_rng([log.seed, crc32(what.encode()), *more])


def true_rows(log: Log, test: str) -> tuple[Rows, np.ndarray]:
    """Where the valve really is, run by run, and the sweep without its dither (rows,)."""
    parts, smooth = [], []
    for number, (name, supply, temperature, rate) in enumerate(log.runs):
        if name != test:
            continue
        rows, reach = log.rows_of_run[test], REACH[test] * STROKE
        last = 4.0 * reach / rate
        time = last * np.arange(rows) / rows
        up = time <= 0.5 * last
        x = np.where(up, rate * time - reach, 3.0 * reach - rate * time)
        shaken = x + log.dither * _random(log, "dither", number).standard_normal(rows)
        wave = _random(log, "wander", number).uniform(0.0, 2.0 * np.pi, 4)
        drift = lambda size, a, b, time=time, last=last: (
            size * (0.7 * np.sin(2.0 * np.pi * time / last + a) + 0.3 * np.sin(14.0 * np.pi * time / last + b))
        )
        parts.append((
            shaken, supply + drift(log.supply[1], wave[0], wave[1]), temperature + drift(log.temperature[1], *wave[2:]),
            np.where(up, 1.0, -1.0), time, np.full(rows, number), np.where(up, rate, -rate),
        ))  # fmt: skip
        smooth.append(x)
    x, supply, temperature, direction, time, run, rate = (np.concatenate(each) for each in zip(*parts, strict=True))
    rows = Rows(x, supply, 0.0 * x, temperature, direction=direction, time=time, run=run, rate=rate)
    return rows, np.concatenate(smooth)


def readings(log: Log, test: str) -> dict[str, np.ndarray]:
    """Noise-free readings (rows,) by channel, SI."""
    rows, _ = true_rows(log, test)
    found = static_tests.TESTS[test](log.valve, OILS[log.oil_name][1], rows, Effects(**log.effects))
    return {channel: found[channel] for channel in CHANNELS[test] if channel in log.noise}


def row_noise(log: Log, channel: str, value: np.ndarray) -> np.ndarray:
    """Standard deviation of each reading (rows,), SI: a part of its own and one in proportion to it."""
    return np.hypot(log.noise[channel], log.share[channel] * value)


def record_of(log: Log, name: str) -> HiddenRecord:
    csv = {f"{test}.csv": _csv(log, test) for test in log.tests}
    truth = {"effects": log.effects, "noise_declared": log.stated, "gauges": "pressure_a" in log.noise}
    truth |= {"current": log.current, "phi": log.phi, "rows": log.rows, "off": sorted(log.off)}
    truth["parameters"] = {
        k: float(getattr(log.valve, k))
        for k in ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
    }
    return HiddenRecord(name, truth, _bench_toml(log, name), csv)


def _csv(log: Log, test: str) -> str:
    rows, _ = true_rows(log, test)
    count = len(rows.spool_position)
    noise = lambda what, size: size * _random(log, f"{what} {test}").standard_normal(count)
    stepped = lambda values, step: np.round(values / step) * step
    read = stepped(rows.spool_position + noise("position", log.position_noise), log.steps["position"])
    columns = {
        "time [s]": (rows.time, 6),
        "run": (rows.run, 0),
        "current [mA]" if log.current else "spool_position [um]": (
            read / STROKE * RATED_CURRENT * 1e3 if log.current else read * 1e6,
            9,
        ),
        "supply_pressure [bar]": (
            stepped(rows.supply_pressure + noise("supply", log.supply[0]), log.steps["supply_pressure"]) / 1e5,
            9,
        ),
        "temperature [degC]": (
            stepped(rows.temperature + noise("temperature", log.temperature[0]), log.steps["temperature"]) - 273.15,
            9,
        ),
    }
    for channel, value in readings(log, test).items():
        unit, size = UNITS[channel]
        std, own = row_noise(log, channel, value), noise(channel, 1.0)
        if log.phi:
            assert rows.run is not None
            own = _remembered(own, log.phi, rows.run)
        columns[f"{channel} [{unit}]"] = (stepped(value + std * own, log.steps[channel]) / size, 9)
        if log.stated:
            columns[f"{channel}_std [{unit}]"] = (std / size, 9)
    table = [[format(v, f".{digits}g" if digits else ".0f") for v in values] for values, digits in columns.values()]
    return "\n".join([",".join(columns), *map(",".join, zip(*table, strict=True))]) + "\n"


def _remembered(white: np.ndarray, phi: float, run: np.ndarray) -> np.ndarray:
    """AR(1) noise of variance 1, run by run."""
    found = np.empty_like(white)
    for code in np.unique(run):
        own = white[run == code].copy()
        own[1:] *= np.sqrt(1.0 - phi**2)
        found[run == code] = np.asarray(lfilter([1.0], [1.0, -phi], own))
    return found


def _bench_toml(log: Log, name: str) -> str:
    lines = [
        LABEL,
        "",
        "[valve]",
        f'name = "{name}"',
        'stroke = "213 um"',
        f'rated_current = "{RATED_CURRENT * 1e3:g} mA"',
    ]
    lines += [f'slot_width = "{log.valve.slot_width * 1e3:g} mm"', 'rated_flow = "9.8 l/min"']
    lines += ['rated_pressure_drop = "70 bar"', "", "[oil]", OILS[log.oil_name][0], ""]
    lines += ["[conditions]", 'return_pressure = "0 bar"']
    for test in log.tests:
        lines += ["", f"[tests.{test}]", f'file = "{test}.csv"']
    return "\n".join(lines) + "\n"


def write(folder: Path, log: Log) -> HiddenRecord:
    """Write one record into a folder of its own; its truth is returned, not written."""
    record = record_of(log, folder.name)
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in {"bench.toml": record.bench_toml, **record.csv}.items():
        (folder / file).write_text(text, encoding="utf-8")
    return record
