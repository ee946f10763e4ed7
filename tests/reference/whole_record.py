"""Records of one valve and its jack: static tests, step tests of several names and sampling rates, a frequency response."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from reference import static_tests
from reference.actuator import Jack
from reference.dynamic_bench import Bench, actuator_table, frequency_table, step_noise, step_table
from reference.oil import seed_oil
from reference.sample_text import LABEL, csv_text
from reference.valve import Rows, Valve


# test: (reading's name, its unit, the unit's size in SI, format, reach of the sweep [um])
STATIC = {
    "leakage": ("leakage_flow", "l/min", 1e-3 / 60.0, ".5f", 213.0),
    "pressure_gain": ("load_pressure", "bar", 1e5, ".3f", 60.0),
    "flow_gain": ("flow", "l/min", 1e-3 / 60.0, ".4f", 213.0),
}
STATIC_NOISE = {"leakage": 0.004, "pressure_gain": 0.4, "flow_gain": 0.03}
SWEEP_RATE = 5.0  # um/s
SUPPLY, BACK, TEMPERATURE = 210.0, 2.0, 40.0  # bar, bar, degC: where a test does not say otherwise
FREQUENCIES = tuple(round(2.0 * 1.25**i, 3) for i in range(20))
# Noise of the motion's readings [bench units]: a transducer's.
NOISE = {"spool_position": 1.0, "pressure_a": 0.5, "pressure_b": 0.5, "piston_position": 0.01}


@dataclass(frozen=True)
class StepPlan:
    """One step test. steps: setpoint of each run [mm]; supplies: of the runs in turn [bar], where they differ."""

    steps: tuple[float, ...]
    seconds: float
    spacing: float
    measured: tuple[str, ...] = ("spool_position", "pressure_a", "pressure_b", "piston_position")
    supplies: tuple[float, ...] = ()


FAST = StepPlan((3.0, -6.0), 0.15, 1e-3)
SLOW = StepPlan((-2.0, 4.0, 8.0), 0.6, 6e-3, ("pressure_a", "pressure_b", "piston_position"), (210.0, 140.0))


@dataclass(frozen=True)
class Whole:
    """Truth and test programme of one record. conditions: (degC, bar) of the static sweeps; points: of a sweep, one way.

    Every table has a stream of random numbers of its own, so that one can change without the others.
    """

    valve: Valve
    jack: Jack
    seed: int
    conditions: tuple[tuple[float, float], ...]
    points: int
    steps: dict[str, StepPlan] = field(default_factory=lambda: {"step_fast": FAST, "step_slow": SLOW})
    frequencies: tuple[float, ...] = FREQUENCIES
    noise: dict[str, float] = field(default_factory=lambda: dict(STATIC_NOISE))  # of the static tests [bench units]

    def bench(self, plan: StepPlan, number: int) -> Bench:
        """The test as `dynamic_bench` knows it."""
        return Bench(
            self.valve, self.jack, steps=plan.steps, seconds=plan.seconds, spacing=plan.spacing, supply=SUPPLY, back=BACK,
            temperature=TEMPERATURE, measured=plan.measured, supplies=plan.supplies, noise=NOISE,
            seed=1000 * self.seed + number,
        )  # fmt: skip

    @property
    def response(self) -> Bench:
        return replace(self.bench(FAST, 8), frequencies=self.frequencies)


def cycle(reach: float, points: int) -> np.ndarray:
    """Up and down [um], denser near null; the points of the way down lie between those of the way up."""
    curve = lambda s: reach * np.sinh(3.5 * s) / np.sinh(3.5)
    s = np.linspace(-1.0, 1.0, points)
    between = np.concatenate([s[:1], 0.5 * (s[:-1] + s[1:])])[::-1]
    return np.round(np.concatenate([curve(s), curve(between)]), 2)


def static_table(whole: Whole, test: str) -> dict[str, list[str]]:
    """Header: fields."""
    reading, unit, size, fmt, reach = STATIC[test]
    random = np.random.default_rng([whole.seed, list(STATIC).index(test)])
    one = cycle(reach, whole.points)
    n, count = one.size, len(whole.conditions)
    time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(one)))]) / SWEEP_RATE
    position, full = np.tile(one, count), np.full(n * count, BACK * 1e5)
    temperature = np.repeat([t for t, _ in whole.conditions], n) + np.round(random.uniform(-0.3, 0.3, n * count), 2)
    supply = np.repeat([p for _, p in whole.conditions], n) + np.round(0.15 * random.standard_normal(n * count), 2)
    rows = Rows(position * 1e-6, supply * 1e5, full, temperature + 273.15)
    exact = static_tests.TESTS[test](whole.valve, seed_oil(), rows)[reading] / size
    read = exact + whole.noise[test] * random.standard_normal(exact.size)
    return {
        "time [s]": [f"{v:.2f}" for v in np.tile(time, count)],
        "run": [f"{t:g} degC {p:g} bar" for t, p in whole.conditions for _ in range(n)],
        "spool_position [um]": [f"{v:.2f}" for v in position],
        "supply_pressure [bar]": [f"{v:.2f}" for v in supply],
        "temperature [degC]": [f"{v:.2f}" for v in temperature],
        f"{reading} [{unit}]": [format(v, fmt) for v in read],
    }


def bench_toml(whole: Whole, name: str, comment: str) -> str:
    """All tests with their noise; of the valve and of the jack only what a data sheet would say."""
    tests = ""
    for test, (_, unit, *_) in STATIC.items():
        tests += f'[tests.{test}]\nfile = "{test}.csv"\nnoise = "{whole.noise[test]:g} {unit}"\n\n'
    for number, (test, plan) in enumerate(whole.steps.items()):
        kind = "" if test == "step" else 'kind = "step"\n'
        tests += f'[tests.{test}]\n{kind}file = "{test}.csv"\n{step_noise(whole.bench(plan, number))}\n'
    tests += f'[tests.frequency]\nfile = "frequency.csv"\noutput = "{whole.response.output}"\nnoise = {{ phase = "0.5 deg" }}\n'
    return f"""{LABEL}
# {comment}

[valve]
name = "{name}"
stroke = "213 um"
slot_width = "12 mm"
rated_current = "25 mA"

[oil]
viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]

[conditions]                      # of the tests that have no such column
supply_pressure = "{SUPPLY:g} bar"
return_pressure = "{BACK:g} bar"
temperature = "{TEMPERATURE:g} degC"

{actuator_table(whole.response)}
{tests}"""


def files_of(whole: Whole, name: str, comment: str) -> dict[str, str]:
    """{file name: text}"""
    found = {"bench.toml": bench_toml(whole, name, comment)}
    found |= {f"{test}.csv": csv_text([], static_table(whole, test)) for test in STATIC}
    for number, (test, plan) in enumerate(whole.steps.items()):
        found[f"{test}.csv"] = csv_text([], step_table(whole.bench(plan, number)))
    found["frequency.csv"] = csv_text([], frequency_table(whole.response))
    return found


def write(folder: Path, whole: Whole, name: str = "whole servo", comment: str = "one valve and its jack") -> Path:
    """The record's files in `folder`, made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in files_of(whole, name, comment).items():
        (folder / file).write_text(text, encoding="utf-8", newline="\n")
    return folder
