"""Made-up lives of valves: tables of parameters with errors, as a store would hold them, whose truth is known. No simulator."""

from dataclasses import dataclass

import numpy as np

from thermohyd.identify.fleet.pooling import Series


# {quantity: (level, spread of levels, wear per 1000 h, its spread, standard error of a record, share of wear that an overhaul undoes)}
QUANTITIES = {
    "clearance": (2.4e-6, 0.2e-6, 0.12e-6, 0.04e-6, 0.03e-6, 1.0),
    "edge_radius": (8e-6, 1.0e-6, 0.5e-6, 0.2e-6, 0.2e-6, 0.9),
    "discharge_coefficient": (0.69, 0.01, 0.0, 0.001, 0.004, 0.0),
}
BETWEEN_TESTS = 0.7  # of the standard error: what one test differs from the next beyond its error bar
YEARS, HOURS_A_YEAR = 6.0, 1800.0


@dataclass(frozen=True)
class Fleet:
    """series: {quantity: one for each valve}; slopes, levels at the last record: {quantity: (valves,)}; overhaul: before which record."""

    series: dict[str, list[Series]]
    slopes: dict[str, np.ndarray]
    levels: dict[str, np.ndarray]
    overhaul: list[int | None]


def fleet(seed: int, valves: int = 200, records: tuple[int, int] = (5, 10), overhauled: float = 0.3) -> Fleet:
    """Times in 1000 h. An overhaul lies between any two records, the last two excepted: what it did is then seen in two records."""
    rng = np.random.default_rng(seed)
    series: dict[str, list[Series]] = {name: [] for name in QUANTITIES}
    slopes: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    levels: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    overhaul: list[int | None] = []
    for _ in range(valves):
        count = int(rng.integers(records[0], records[1] + 1))
        span = YEARS * HOURS_A_YEAR / 1000.0 * rng.uniform(0.6, 1.2)
        time = np.sort(rng.uniform(0.0, span, count))
        before = int(rng.integers(2, count - 1)) if rng.random() < overhauled and count > 3 else None
        overhaul.append(before)
        for name, (level, level_spread, wear, wear_spread, std, undone) in QUANTITIES.items():
            slope = wear + wear_spread * rng.standard_normal()
            truth = level + level_spread * rng.standard_normal() + slope * time
            if before is not None:
                at = 0.5 * (time[before - 1] + time[before])
                truth = truth - np.where(np.arange(count) >= before, undone * wear * at, 0.0)
            errors = std * rng.uniform(0.7, 1.5, count)
            noise = np.hypot(errors, BETWEEN_TESTS * std) * rng.standard_normal(count)
            series[name].append(Series(time, truth + noise, errors))
            slopes[name].append(slope)
            levels[name].append(float(truth[-1]))
    return Fleet(
        series, {n: np.array(v) for n, v in slopes.items()}, {n: np.array(v) for n, v in levels.items()}, overhaul
    )
