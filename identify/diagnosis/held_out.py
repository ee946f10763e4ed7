"""Which rows take no part in the choice: whole conditions where a record has several, else repeats, else stretches."""

from dataclasses import dataclass

import numpy as np

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.reduction.monotone_pieces import level_numbers, piece_bounds, sweep_ids


SHARE = 0.25  # of each test's rows, about
STRETCHES = 12  # of a sweep that has no other sweep beside it


@dataclass(frozen=True)
class Split:
    """held (rows,): True where a row was kept back, channel after channel as in a fit's residual (no priors)."""

    held: np.ndarray
    what: str


def split_rows(tests: dict[str, TestRecord]) -> Split:
    """Keep back about a quarter of every test, by condition, so that every temperature and pressure is still fitted."""
    parts, words = [], []
    for test in tests.values():
        held, what = _held_rows(test)
        words.append(f"{test.name}: {what}")
        parts += [held] * len(test.channels)
    return Split(np.concatenate(parts), "; ".join(words))


def _held_in_motion(test: TestRecord) -> tuple[np.ndarray, str]:
    """Later runs where there are several, else the end of each run; every fourth frequency."""
    held = np.zeros(test.rows, dtype=bool)
    codes = np.unique(test.run)
    if test.axis == "frequency":
        held[np.argsort(test.place, kind="stable")[2::4]] = True
        return held, "every fourth frequency"
    if len(codes) > 2:
        last = codes[-max(1, round(SHARE * len(codes))) :]
        names = ", ".join(test.run_names[code] for code in last)
        return np.isin(test.run, last), f"run {names}" if len(last) == 1 else f"runs {names}"
    for code in codes:
        rows = np.flatnonzero(test.run == code)
        held[rows[round((1.0 - SHARE) * len(rows)) :]] = True
    return held, f"the last {100 * SHARE:.0f} % of every run"


def conditions_of_rows(test: TestRecord) -> tuple[np.ndarray, np.ndarray]:
    """Temperature, supply pressure and rate of each of a static test's conditions (conditions, 3), as numbers of their levels, and
    the number (rows,) of each row's."""
    levels = np.stack([_level(test.temperature, 1.0), _level(test.supply_pressure, 0.02), _rates(test)], axis=1)
    conditions, number = np.unique(levels, axis=0, return_inverse=True)
    return conditions, number.reshape(-1)


def _held_rows(test: TestRecord) -> tuple[np.ndarray, str]:
    if test.in_motion:
        return _held_in_motion(test)
    conditions, number = conditions_of_rows(test)
    for columns in ((0, 1, 2), (0, 1)):  # first keep every rate in the fit too, then do without
        chosen = _kept_back(conditions, number, columns)
        if len(chosen):
            held = np.isin(number, chosen)
            return held, f"{len(chosen)} of {len(conditions)} conditions ({_words(test, held)})"
    sweeps = sweep_ids(test)
    runs = np.unique(test.run)
    if len(runs) > 1:
        held = np.isin(test.run, runs[1::2][: max(1, int(SHARE * len(runs)))])
        return held, f"repeated sweeps ({int(held.sum())} rows)"
    held = np.zeros(test.rows, dtype=bool)
    for start, stop in piece_bounds(sweeps):
        place = np.arange(stop - start) * STRETCHES // max(stop - start, 1)
        held[start:stop] = place % 4 == 2
    return held, f"every fourth stretch of each sweep ({int(held.sum())} rows)"


def _kept_back(conditions: np.ndarray, number: np.ndarray, columns: tuple[int, ...]) -> list[int]:
    """Conditions to keep back so that every level of the columns stays in the fit. Deterministic."""
    total, chosen, taken = len(number), [], 0
    kept = list(range(len(conditions)))
    # Not in their order: conditions next to each other would leave a corner of the range unseen.
    for i in np.random.default_rng(len(conditions)).permutation(len(conditions)):
        rows = int(np.sum(number == i))
        if taken + rows > 1.2 * SHARE * total and chosen:
            continue
        if taken + rows > 0.55 * total:
            continue
        rest = [j for j in kept if j != i]
        if all(conditions[i, c] in conditions[rest, c] for c in columns) and len(rest) >= 1:
            chosen.append(int(i))
            kept = rest
            taken += rows
    return chosen


def _level(values: np.ndarray, step: float) -> np.ndarray:
    """Numbers of the levels that a condition was held at; `step` is absolute (K) for temperatures, else relative."""
    width = step if step >= 1.0 else step * max(float(np.max(np.abs(values))), 1e-300)
    return level_numbers(values, width)


def _rates(test: TestRecord) -> np.ndarray:
    """Number of each run's sweep rate, to a fifth."""
    found = np.zeros(test.rows, dtype=int)
    if test.rate is None:
        return found
    for run in np.unique(test.run):
        rows = test.run == run
        moving = np.abs(test.rate[rows])
        moving = moving[moving > 0.0]
        if len(moving):
            found[rows] = round(float(np.log(np.median(moving))) / 0.2)
    return found


def _words(test: TestRecord, held: np.ndarray) -> str:
    """The conditions kept back, in words."""
    pairs = sorted(
        {
            (round(float(t) - 273.15), round(float(p) / 1e5))
            for t, p in zip(test.temperature[held], test.supply_pressure[held], strict=True)
        }
    )
    seen: dict[tuple[int, int], None] = {}
    for t, p in pairs:
        if not any(abs(t - a) <= 1 and abs(p - b) <= 2 for a, b in seen):
            seen[t, p] = None
    return ", ".join(f"{t} degC {p} bar" for t, p in seen)
