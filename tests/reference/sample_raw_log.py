"""The record data/raw_log: what a data logger leaves behind, thousands of rows per test with a current as abscissa."""

from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter

from reference import static_tests
from reference.oil import Oil, walther
from reference.sample_text import truth_table
from reference.valve import Rows, Valve


VALVE = Valve(
    edge_radius=8e-6,
    clearance=3e-6,
    underlap=4e-6,
    discharge_coefficient=0.66,
    transition_number=80.0,
    null_bias=2.1e-6,
)
OIL = Oil(*walther([(40.0, 32.0), (100.0, 5.4)]), density=870.0)
STROKE, RATED_CURRENT, POLARITY = 213e-6, 25.0, -1  # m, mA
TEMPERATURE = 40.0  # degC
LOGGING = 50.0  # Hz
SWEEPS = (120.0, 60.0, 30.0)  # s, there and back
DITHER = 0.05  # mA, standard deviation: half the logger's step, so that rounding averages out
CURRENT_STEP = 0.1  # mA
CORRELATION = 0.9  # of the noise from one row to the next

# test: (reading's header, its size in SI, noise, format, coarse above, coarse step, supply [bar], reach [mA], seed)
TESTS = {
    "leakage": ("leakage_flow [l/min]", 1e-3 / 60.0, 0.01, ".3f", np.inf, 1.0, 210.0, 25.0, 11),
    "pressure_gain": ("load_pressure [bar]", 1e5, 0.6, ".2f", 70.0, 7.0, 210.0, 10.0, 12),
    "flow_gain": ("flow [l/min]", 1e-3 / 60.0, 0.03, ".3f", 4.0, 0.4, 70.0, 25.0, 13),
}

BENCH = """# A data logger's record: 50 Hz, current as abscissa, three sweep rates, correlated noise, and large readings
# rounded coarsely.

[valve]
name = "logged servovalve (synthetic)"
stroke = "213 um"
slot_width = "12 mm"
land_diameter = "6.9 mm"
rated_flow = "9.8 l/min"
rated_pressure_drop = "70 bar"
rated_current = "25 mA"
polarity = -1                     # a positive current gives a negative flow

[oil]
viscosity = [["40 degC", "32 cSt"], ["100 degC", "5.4 cSt"]]
density = "870 kg/m^3"

[conditions]
return_pressure = "0 bar"
temperature = "40 degC"

[tests.leakage]
file = "leakage.csv.gz"

[tests.pressure_gain]
file = "pressure_gain.csv.gz"     # the log rounds readings above 70 bar to 7 bar

[tests.flow_gain]
file = "flow_gain.csv.gz"         # the log rounds readings above 4 l/min to 0.4 l/min
"""


def sweep(random: np.random.Generator, seconds: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and true current [mA]: from -reach to +reach and back, with a dither that the spool follows."""
    time = np.arange(round(seconds * LOGGING)) / LOGGING
    ramp = reach * (1.0 - np.abs(4.0 * time / seconds - 2.0))
    return time, ramp + DITHER * random.standard_normal(time.size)


def correlated(random: np.random.Generator, n: int, size: float) -> np.ndarray:
    """First-order autoregressive noise of standard deviation `size`, stationary from its first value."""
    white = size * np.sqrt(1.0 - CORRELATION**2) * random.standard_normal(n)
    white[0] /= np.sqrt(1.0 - CORRELATION**2)
    return np.asarray(lfilter([1.0], [1.0, -CORRELATION], white))


def tests() -> Iterator[tuple[str, list[str], dict[str, list[str]]]]:
    """(file name, comments, columns) of every test."""
    for test, (header, unit, noise, fmt, threshold, step, supply, reach, seed) in TESTS.items():
        random = np.random.default_rng(seed)
        sweeps = [sweep(random, seconds, reach) for seconds in SWEEPS]
        current = np.concatenate([i for _, i in sweeps])
        n = current.size
        rows = Rows(
            POLARITY * STROKE * current / RATED_CURRENT,
            np.full(n, supply * 1e5),
            np.zeros(n),
            np.full(n, TEMPERATURE + 273.15),
        )
        exact = static_tests.TESTS[test](VALVE, OIL, rows)[static_tests.READING[test]] / unit
        reading = exact + np.concatenate([correlated(random, t.size, noise) for t, _ in sweeps])
        reading = np.where(np.abs(reading) > threshold, step * np.round(reading / step), reading)
        unit_name = header.split("[")[1].rstrip("]")
        comments = [
            f"noise {noise} {unit_name} (standard deviation), correlated by {CORRELATION} from row to row",
            "truth in README.md",
        ]
        yield (
            f"{test}.csv.gz",
            comments,
            {
                "time [s]": [f"{v:.2f}" for t, _ in sweeps for v in t],
                "run": [f"sweep {s:g} s" for s, (t, _) in zip(SWEEPS, sweeps, strict=True) for _ in t],
                "current [mA]": [f"{v:.1f}" for v in CURRENT_STEP * np.round(current / CURRENT_STEP)],
                "supply_pressure [bar]": [f"{supply:g}"] * n,
                header: [format(v, fmt) for v in reading],
            },
        )


def readme() -> str:
    sweeps = ", ".join(f"{s:g}" for s in SWEEPS)
    return f"""# Sample record: a raw log

Synthetic: made by the project's reference simulator, not measured. It looks like a data logger's files: {LOGGING:g} Hz,
the current as abscissa (logged to {CURRENT_STEP:g} mA, with a dither of {DITHER:g} mA that the spool follows), sweeps
of {sweeps} s, noise correlated by {CORRELATION:g} from row to row (standard deviations: leakage 0.01 l/min,
load pressure 0.6 bar, flow 0.03 l/min), large readings rounded coarsely (load pressure above 70 bar to 7 bar, flow
above 4 l/min to 0.4 l/min),
polarity -1. Nothing else: an ideal, isothermal valve without hysteresis.

{truth_table(VALVE)}"""
