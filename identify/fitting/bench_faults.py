"""Faults of the bench that have an amount: a zero, a drift, a wrong label, of one test, run or condition. NumPy only.

They stand beside the effects of the library as columns of the same fits (docs/diagnosis.md section 7.1): a search that has only
effects to offer would name one for a test that was zeroed anew. Amounts are shares of what was read, so that one size suits all.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from thermohyd.effects.effect_info import EffectInfo
from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.reduction.monotone_pieces import level_numbers, piece_bounds


MOST_RUNS = 30  # of a test, beyond which no run has faults of its own: nobody writes so many zeros down
TEMPERATURE_STEP, SUPPLY_STEP = 1.0, 0.01  # K, share of the largest: labels of one condition lie closer
BETWEEN = "|"  # parts of a fault's name; no effect's name has it


@dataclass(frozen=True)
class FaultInfo:
    """One kind of fault, in the terms of an effect's entry. moves: the column that was read wrong, "" for the readings.

    typical: (just visible, the largest usual): data sheets of gauges have 0.5 % of their range,
    which a reading seldom fills, and a label may be mistyped.
    """

    name: str
    unit: str  # of the amount
    typical: tuple[float, float]
    scale: float
    most: float
    moves: str
    sentence: str
    rowwise: ClassVar[bool] = False
    coupled: ClassVar[bool] = False
    stores: ClassVar[bool] = False
    computes_heat: ClassVar[bool] = False
    costly: ClassVar[bool] = False
    of_sweeps: ClassVar[bool] = False

    @property
    def lower(self) -> float:
        return -self.most

    @property
    def upper(self) -> float:
        return self.most


LEAST_SUPPLY = 0.05  # of what was read

KINDS = {
    info.name: info
    for info in (
        FaultInfo("position_zero", "1", (5e-4, 0.01), 2e-3, 0.5, "spool_position", "the position's zero moved"),
        FaultInfo("reading_zero", "1", (5e-4, 0.03), 5e-3, 1.0, "", "the reading's zero is off"),
        FaultInfo("reading_drift", "1", (5e-4, 0.05), 5e-3, 1.0, "", "the reading's zero drifts with the time"),
        FaultInfo("wrong_temperature", "K", (0.5, 10.0), 2.0, 60.0, "temperature", "the temperature is labelled wrong"),
        FaultInfo("wrong_supply", "1", (2e-3, 0.05), 0.01, 0.5, "supply_pressure", "the supply pressure is labelled wrong"),
    )
}  # fmt: skip


def is_fault(name: str) -> bool:
    """Whether an entry of a fit is the amount of a bench fault."""
    return BETWEEN in name


def info_of(name: str) -> EffectInfo | FaultInfo:
    """What is known of the amount of an effect, or of a fault."""
    return KINDS[kind_of(name)] if is_fault(name) else effect_info(name)


def kind_of(name: str) -> str:
    """An effect's own name, or what kind of fault it is."""
    return name.split(BETWEEN)[0]


@dataclass(frozen=True, eq=False)
class BenchFault:
    """One fault that a record may have: what was read is too large by amount * shape, in the rows of `shapes`.

    test: "" where it is of several; place: the run or the condition in words, "" where it is of a whole test; channel: of
    readings. shapes: {test: (rows,)}, SI per amount. size: SI per amount. among: how many faults of its kind there are.
    """

    kind: str
    test: str
    channel: str
    place: str
    shapes: Mapping[str, np.ndarray]
    size: float
    among: int = 1

    @property
    def name(self) -> str:
        return BETWEEN.join((self.kind, self.test, self.channel, self.place))

    @property
    def info(self) -> FaultInfo:
        return KINDS[self.kind]

    @property
    def allowance(self) -> float:
        """Chi-square that it must gain because it was looked for in so many places."""
        return 2.0 * float(np.log(self.among))


def corrected(tests: Mapping[str, TestRecord], amounts: Mapping[BenchFault, float]) -> dict[str, TestRecord]:
    """The tests with positions and labels as they would have been read without these faults; readings stay as they are.

    Faults of a run, a level and a test at once may add up beyond any oil or pump: there the label stays at what is possible.
    """
    # A fit asks this, with JAX loaded; the faults of a record need none.
    from thermohyd.arguments import COLDEST, HOTTEST

    found = dict(tests)
    for fault, amount in amounts.items():
        column = fault.info.moves
        for name, shape in fault.shapes.items() if column else ():
            test = found[name]
            found[name] = replace(test, **{column: getattr(test, column) - amount * shape})
    for name, test in found.items():
        if test is not tests[name]:
            temperature = np.clip(test.temperature, COLDEST, HOTTEST)
            supply = np.maximum(test.supply_pressure, LEAST_SUPPLY * tests[name].supply_pressure)
            found[name] = replace(test, temperature=temperature, supply_pressure=supply)
    return found


def faults_of(tests: Mapping[str, TestRecord]) -> dict[str, BenchFault]:
    """{name: fault} of all that these static tests may have; of two with the same rows the first stays."""
    found: dict[tuple[str, str, bytes], BenchFault] = {}
    for fault in (*_zeros(tests), *_drifts(tests), *_labels(tests)):
        rows = b"".join(name.encode() + (shape != 0.0).tobytes() for name, shape in sorted(fault.shapes.items()))
        found.setdefault((fault.kind, fault.channel, rows), fault)
    kinds = [fault.kind for fault in found.values()]
    return {f.name: replace(f, among=kinds.count(f.kind)) for f in found.values()}


def _zeros(tests: Mapping[str, TestRecord]) -> Iterator[BenchFault]:
    """Of positions and readings: tests, then runs. One zero for all positions is the null bias."""
    stroke = max((float(np.ptp(test.spool_position)) for test in tests.values()), default=0.0)
    for by_run in (False, True):
        for test in tests.values():
            parts = list(_runs(test)) if by_run else [("", np.ones(test.rows, dtype=bool))]
            for place, rows in parts:
                if stroke > 0.0 and (by_run or len(tests) > 1):
                    yield BenchFault("position_zero", test.name, "", place, {test.name: stroke * rows}, stroke)
                for name, size in _sizes(test):
                    yield BenchFault("reading_zero", test.name, name, place, {test.name: size * rows}, size)


def _drifts(tests: Mapping[str, TestRecord]) -> Iterator[BenchFault]:
    for test in tests.values():
        clock = _elapsed(test)
        if clock is None:
            continue
        for name, size in _sizes(test):
            yield BenchFault("reading_drift", test.name, name, "", {test.name: size * clock}, size)


def _labels(tests: Mapping[str, TestRecord]) -> Iterator[BenchFault]:
    """Of one temperature or supply pressure: at one level, in all tests and in each; at one pair of both; in one run."""
    warm, high = _temperatures(tests), _supplies(tests)
    pairs = condition_levels(tests)
    degrees = lambda v: f"{v - 273.15:.0f} degC"
    bars = lambda v: f"{v / 1e5:.0f} bar"
    mean = lambda column, rows: float(
        np.mean(np.concatenate([getattr(tests[n], column)[own] for n, own in rows.items()]))
    )

    def words(rows: dict[str, np.ndarray], *columns: str) -> str:
        of = {"temperature": degrees, "supply_pressure": bars}
        return ", ".join(of[column](mean(column, rows)) for column in columns)

    for kind, column, level in (("wrong_temperature", "temperature", warm), ("wrong_supply", "supply_pressure", high)):
        if len(_codes(level)) < 2:
            continue

        def fault(rows: dict[str, np.ndarray], test: str, place: str, kind=kind, column=column) -> BenchFault:
            # A gauge of pressure is wrong by a share, a thermometer by kelvins.
            size = mean(column, rows) if column == "supply_pressure" else 1.0
            shape = {
                n: own * (getattr(tests[n], column) if column == "supply_pressure" else 1.0) for n, own in rows.items()
            }
            only = next(iter(rows)) if len(rows) == 1 < len(tests) else ""
            return BenchFault(kind, test or only, "", place, shape, size)

        # Runs first: what is a run's and a level's at once is better known by the run.
        for test in tests.values():
            yield from (fault({test.name: own}, test.name, place) for place, own in _runs(test))
        for rows in _parts(level):
            yield fault(rows, "", words(rows, column))
        for rows in _parts(pairs):
            yield fault(rows, "", words(rows, "temperature", "supply_pressure"))
        for rows in _parts(level):
            yield from (fault({name: own}, name, words(rows, column)) for name, own in rows.items())


def condition_levels(tests: Mapping[str, TestRecord]) -> dict[str, np.ndarray]:
    """{test: (rows,)}: number of the pair of temperature and supply pressure that each row was read at, over all tests."""
    warm, high = _temperatures(tests), _supplies(tests)
    return {name: warm[name] + 1000 * high[name] for name in tests}


def _temperatures(tests: Mapping[str, TestRecord]) -> dict[str, np.ndarray]:
    return _levels({name: test.temperature for name, test in tests.items()}, TEMPERATURE_STEP)


def _supplies(tests: Mapping[str, TestRecord]) -> dict[str, np.ndarray]:
    largest = max((float(np.max(test.supply_pressure)) for test in tests.values()), default=0.0)
    return _levels({name: test.supply_pressure for name, test in tests.items()}, SUPPLY_STEP * largest)


def _codes(levels: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.unique(np.concatenate([*levels.values()])) if levels else np.zeros(0, dtype=int)


def _parts(levels: Mapping[str, np.ndarray]) -> Iterator[dict[str, np.ndarray]]:
    """{test: rows} of every level, tests without it left out."""
    for code in _codes(levels):
        yield {name: level == code for name, level in levels.items() if np.any(level == code)}


def _runs(test: TestRecord) -> Iterator[tuple[str, np.ndarray]]:
    """(name, rows) of each run of a test that has a few."""
    if 1 < len(np.unique(test.run)) <= MOST_RUNS:
        yield from test.runs.items()


def _sizes(test: TestRecord) -> Iterator[tuple[str, float]]:
    """(channel, its largest reading) of what is read in SI, not as a signal of free gain."""
    for channel in test.channels:
        size = float(np.max(np.abs(channel.value), initial=0.0))
        if size > 0.0 and (channel.sensor is None or channel.sensor.gain is not None):
            yield channel.name, size


def _elapsed(test: TestRecord) -> np.ndarray | None:
    """(rows,) from 0 to 1 over the test, its runs one after the other; by rows where there is no time. None in a moment."""
    if test.rows < 2:
        return None
    if test.time is None:
        return np.arange(test.rows) / (test.rows - 1.0)
    clock, end = np.zeros(test.rows), 0.0
    for a, b in piece_bounds(test.run):
        own = test.time[a:b]
        # A clock that starts again with every run says nothing of the pauses; one that goes on need not begin at zero.
        clock[a:b] = own if a == 0 or own[0] >= end else own - own[0] + end
        end = float(clock[a:b].max())
    span = float(np.ptp(clock))
    return (clock - clock.min()) / span if span > 0.0 else None


def _levels(columns: Mapping[str, np.ndarray], step: float) -> dict[str, np.ndarray]:
    """{test: (rows,)}: number of the level that each row's label belongs to, over all tests."""
    values = np.concatenate([*columns.values()]) if columns else np.zeros(0)
    sizes = np.cumsum([len(column) for column in columns.values()])[:-1]
    return dict(zip(columns, np.split(level_numbers(values, step), sizes), strict=True))


def allowance_of(names: Iterable[str], faults: Mapping[str, BenchFault]) -> float:
    """Chi-square that a model's faults must gain because each was looked for in many places."""
    return sum(faults[name].allowance for name in names if is_fault(name))
