"""The record data/seed_valve: the seed paper's valve and oil at five temperatures and two supply pressures."""

from collections.abc import Iterator

import numpy as np

from reference import static_tests
from reference.oil import seed_oil
from reference.sample_text import truth_table
from reference.valve import Rows, Valve


VALVE = Valve(null_bias=1.5e-6)  # the seed paper's valve, but for a small null bias
TEMPERATURES = (-20.0, 0.0, 20.0, 40.0, 70.0)  # degC
SUPPLY_PRESSURES = (70.0, 210.0)  # bar
POINTS = 40  # of one sweep, up or down
SWEEP_RATE = 5.0  # um/s

# test: (reading's header, its size in SI, noise standard deviation, format, reach of the sweep [um], seed)
TESTS = {
    "leakage": ("leakage_flow [l/min]", 1e-3 / 60.0, 0.002, ".5f", 213.0, 1),
    "pressure_gain": ("load_pressure [bar]", 1e5, 0.3, ".3f", 60.0, 2),
    "flow_gain": ("flow [l/min]", 1e-3 / 60.0, 0.03, ".4f", 213.0, 3),
}

BENCH = """# The seed paper's servovalve (second stage) swept at five temperatures and two supply pressures.

[valve]
name = "seed valve (MOOG 76101 class)"
stroke = "213 um"
slot_width = "12 mm"              # four slots of 3 mm per edge
land_diameter = "6.9 mm"
rated_flow = "9.8 l/min"
rated_pressure_drop = "70 bar"

[oil]
viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]

[conditions]
return_pressure = "0 bar"

[tests.leakage]
file = "leakage.csv"
noise = "0.002 l/min"

[tests.pressure_gain]
file = "pressure_gain.csv"
noise = "0.3 bar"

[tests.flow_gain]
file = "flow_gain.csv"
noise = "0.03 l/min"
"""


def positions(reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Up and down sweep [um], denser near null; the down sweep's points lie between those of the up sweep."""
    curve = lambda s: reach * np.sinh(3.5 * s) / np.sinh(3.5)
    s = np.linspace(-1.0, 1.0, POINTS)
    between = np.concatenate([s[:1], 0.5 * (s[:-1] + s[1:])])[::-1]
    return curve(s), curve(between)


def tests() -> Iterator[tuple[str, list[str], dict[str, list[str]]]]:
    """(file name, comments, columns) of every test."""
    for test, (header, unit, noise, fmt, reach, seed) in TESTS.items():
        random = np.random.default_rng(seed)
        up, down = positions(reach)
        cycle = np.round(np.concatenate([up, down]), 2)
        time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(cycle)))]) / SWEEP_RATE
        runs, n = [(t, p) for t in TEMPERATURES for p in SUPPLY_PRESSURES], cycle.size
        temperature = np.concatenate([t + np.round(drift(random, n, 0.3), 2) for t, _ in runs])
        supply = np.concatenate([p + np.round(0.15 * random.standard_normal(n), 2) for _, p in runs])
        position = np.tile(cycle, len(runs))
        rows = Rows(position * 1e-6, supply * 1e5, np.zeros(position.size), temperature + 273.15)
        exact = static_tests.TESTS[test](VALVE, seed_oil(), rows)[static_tests.READING[test]] / unit
        reading = exact + noise * random.standard_normal(exact.size)
        comments = [f"white noise, standard deviation {noise} {header.split('[')[1].rstrip(']')}; truth in README.md"]
        yield (
            f"{test}.csv",
            comments,
            {
                "time [s]": [f"{v:.2f}" for v in np.tile(time, len(runs))],
                "run": [f"{t:g} degC {p:g} bar" for t, p in runs for _ in range(n)],
                "spool_position [um]": [f"{v:.2f}" for v in position],
                "supply_pressure [bar]": [f"{v:.2f}" for v in supply],
                "temperature [degC]": [f"{v:.2f}" for v in temperature],
                header: [format(v, fmt) for v in reading],
            },
        )


def drift(random: np.random.Generator, n: int, size: float) -> np.ndarray:
    """Slow wander of a controlled temperature: one and a half waves of random phase and amplitude."""
    return size * random.uniform(0.3, 1.0) * np.sin(3.0 * np.pi * np.arange(n) / n + random.uniform(0.0, 2.0 * np.pi))


def readme() -> str:
    temperatures = ", ".join(f"{t:g}" for t in TEMPERATURES)
    pressures = " and ".join(f"{p:g}" for p in SUPPLY_PRESSURES)
    return f"""# Sample record: the seed valve

Synthetic: made by the project's reference simulator, not measured. The servovalve of the paper that the model comes
from, its second stage swept up and down at {temperatures} degC and {pressures} bar. Ideal valve, all heat
leaving the oil (isothermal), white noise: leakage 0.002 l/min, load pressure 0.3 bar, flow 0.03 l/min (standard
deviations). The columns spool_position, supply_pressure and temperature are exact as written.

{truth_table(VALVE)}"""
