"""Faults of a bench: what they do to the positions, labels and readings that are written down."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from reference.hidden_bench import CHANNELS
from reference.real_bench import Bench, Readings, Scale
from reference.valve import Rows


NAMES = (
    "outliers",
    "clipped",
    "meter_dead_band",
    "position_zero",
    "reading_zero",
    "reading_drift",
    "wrong_temperature",
    "wrong_supply",
)
# A zero shift of the whole test is an effect of the library (pressure_offset), or nothing that one test alone can show.
ZERO_OF_RUN_ONLY = "pressure_gain"


@dataclass(frozen=True)
class BenchFault:
    """One fault. runs: names of the runs that it spoils; test is empty where they are of several, channel where it has none.

    amount (SI): of position_zero the reading's error [m], of reading_zero the same; of reading_drift its error per second of
    the record's time; of clipped and meter_dead_band the limit; of wrong_temperature and wrong_supply label minus truth.
    rows: of outliers, {row of the test: error [SI]}.
    """

    name: str
    test: str
    runs: tuple[str, ...]
    channel: str
    amount: float
    rows: dict[int, float]

    def touches(self, bench: Bench, test: str) -> np.ndarray:
        """Which rows of a test are of a run that it spoils."""
        return np.repeat([run.name in self.runs for run in bench.runs_of(test)], bench.points)


def written_rows(bench: Bench, faults: tuple[BenchFault, ...]) -> dict[str, Rows]:
    """The operating points as labelled, without the noise of the position."""
    found = {}
    for test in bench.tests:
        rows = bench.rows(test)
        for fault in faults:
            error = fault.amount * fault.touches(bench, test)
            if fault.name == "position_zero":
                rows = replace(rows, spool_position=rows.spool_position + error)
            elif fault.name == "wrong_temperature":
                rows = replace(rows, temperature=rows.temperature + error)
            elif fault.name == "wrong_supply":
                rows = replace(rows, supply_pressure=rows.supply_pressure + error)
        found[test] = rows
    return found


def shown(bench: Bench, test: str, channel: str, values: np.ndarray, faults: tuple[BenchFault, ...]) -> np.ndarray:
    """What the instrument shows of `values` [SI], before it is rounded."""
    own = [fault for fault in faults if (fault.test, fault.channel) == (test, channel)]
    for fault in own:
        if fault.name == "reading_zero":
            values = values + fault.amount * fault.touches(bench, test)
        elif fault.name == "reading_drift":
            values = values + fault.amount * bench.clock(test)
        elif fault.name == "outliers":
            values = values.copy()
            for row, error in fault.rows.items():
                values[row] += error
    for fault in own:
        if fault.name == "meter_dead_band":
            values = np.where(np.abs(values) < fault.amount, 0.0, values)
        elif fault.name == "clipped":
            values = np.clip(values, -fault.amount, fault.amount)
    return values


def random_fault(random: np.random.Generator, name: str, scale: Scale, exact: Readings) -> BenchFault:
    """A fault of usual size somewhere in the record; exact: its noise-free readings."""
    bench = scale.bench
    pick = lambda options: options[int(random.integers(len(options)))]
    sign = float(pick((-1.0, 1.0)))
    if name.startswith("wrong_"):
        return _wrong_label(random, name, bench, sign)
    if name == "meter_dead_band":  # small beside the meter's range: of a table's flow it would take a row or two
        meters = [key for key in bench.channels if key[0] == "leakage" or (key[0] == "flow_gain" and bench.raw)]
        test, channel = pick(meters)
        limit = float(np.quantile(np.abs(exact[test, channel]), random.uniform(0.05, 0.12)))
        limit = max(limit, float(3.0 * bench.noise[channel]))
        return BenchFault(name, test, _names(bench, test), channel, _digits(limit), {})
    if name == "clipped":
        test, channel = pick(bench.channels)
        limit = float(random.uniform(0.5, 0.95) * np.max(np.abs(exact[test, channel])))
        return BenchFault(name, test, _names(bench, test), channel, _digits(limit), {})
    test, channel = pick(bench.channels)
    names = _names(bench, test)
    if name == "outliers":
        # Not in the first and last rows of a sweep: there nothing says where the curve goes.
        half = bench.points // 2
        inner = [row for row in range(len(names) * bench.points) if 5 <= row % half < half - 5]
        at = random.choice(inner, int(random.integers(1, 7)), replace=False)
        sigmas = np.exp(random.uniform(np.log(10.0), np.log(100.0), len(at))) * random.choice([-1.0, 1.0], len(at))
        noise = scale.effective_noise((test, channel))
        rows = {int(row): float(sigma * noise[row]) for row, sigma in zip(at, sigmas, strict=True)}
        return BenchFault(name, test, names, channel, float(len(rows)), dict(sorted(rows.items())))
    if name == "reading_drift":  # 3 to 15 times the noise from the first to the last row of the test
        clock = bench.clock(test)
        total = sign * np.exp(random.uniform(*np.log((3.0, 15.0)))) * bench.noise[channel]
        return BenchFault(name, test, names, channel, _digits(total / float(np.ptp(clock))), {})
    of_run = bool(random.random() < 0.5) or (name == "reading_zero" and test == ZERO_OF_RUN_ONLY)
    runs = (str(pick(names)),) if of_run else names
    if name == "position_zero":
        return BenchFault(name, test, runs, "", _digits(sign * np.exp(random.uniform(*np.log((0.3e-6, 2e-6))))), {})
    amount = sign * np.exp(random.uniform(*np.log((2.0, 10.0)))) * bench.noise[channel]
    return BenchFault("reading_zero", test, runs, channel, _digits(amount), {})


def _wrong_label(random: np.random.Generator, name: str, bench: Bench, sign: float) -> BenchFault:
    """All runs of one condition in all tests, or one run alone."""
    one = bench.runs[int(random.integers(len(bench.runs)))]
    same = [run for run in bench.runs if (run.temperature, run.supply) == (one.temperature, one.supply)]
    spoiled = [one] if random.random() < 0.5 else same
    tests = {run.test for run in spoiled}
    amount = random.uniform(3.0, 10.0) if name == "wrong_temperature" else random.uniform(0.01, 0.04) * one.supply
    amount = sign * round(float(amount), 1) * (1.0 if name == "wrong_temperature" else 1e5)
    return BenchFault(name, tests.pop() if len(tests) == 1 else "", tuple(r.name for r in spoiled), "", amount, {})


def _names(bench: Bench, test: str) -> tuple[str, ...]:
    return tuple(run.name for run in bench.runs_of(test))


def _digits(value: float) -> float:
    return float(f"{value:.3g}")


def bad_share(bench: Bench, fault: BenchFault, exact: Readings) -> float:
    """Share of a test's rows that a limit or a dead band takes."""
    value = np.abs(exact[fault.test, fault.channel])
    return float(np.mean(value > fault.amount if fault.name == "clipped" else value < fault.amount))


def as_truth(bench: Bench, fault: BenchFault, rows_before: int) -> dict[str, Any]:
    """What truth.json says of it. rows_before: lines of a file above its first row."""
    tests = (
        [fault.test]
        if fault.test
        else [t for t in CHANNELS if any(r.test == t and r.name in fault.runs for r in bench.runs)]
    )
    conditions = sorted({(run.temperature, run.supply) for run in bench.runs if run.name in fault.runs})
    return {
        "name": fault.name,
        "test": fault.test,
        "tests": tests,
        "runs": list(fault.runs),
        "channel": fault.channel,
        "amount": fault.amount,
        "conditions": [list(pair) for pair in conditions],
        "lines": [row + rows_before + 1 for row in fault.rows],
    }
