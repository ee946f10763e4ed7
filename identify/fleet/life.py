"""The life of every valve in a store: trends with error bars, overhauls, the time that is left to a limit, and who needs attention.

A type's valves are looked at together (`pooling.py`), over operating hours where all their records have them, else over the date.
What is trended are the parameters of each record's last diagnosis or fit, the amounts of named effects among them; gains and zeros of
instruments are the bench's and not the valve's.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.stats import norm

from .overhauls import ChangePoint, find_overhauls
from .pooling import Pooled, Series
from .query import query
from .remaining import Crossing, Limit, crossing, limits_of
from .store import Store


if TYPE_CHECKING:
    from rich.console import Console

OF_BENCH = re.compile(r"_(gain|zero)(_|$)")
FEWEST = 6  # records of a type with a value, for a trend of it
YEAR = 365.25 * 86400.0  # s
AXES = {"hours": "h", "date": "years"}
HORIZON = {"hours": 1000.0, "date": 1.0}  # within which a limit is near
UNUSUAL = 0.001  # a valve's wear rate this rare within its type needs attention; over all valves of a type
ALONG = 9  # points of a line as it is drawn
UNSETTLED = ("unexplained", "ambiguous", "misfit")


@dataclass(frozen=True)
class Trend:
    """One quantity of one valve, SI; per hour or per year, as the axis says. level: at its last record. type_rate: of the type."""

    quantity: str
    unit: str
    level: float
    level_std: float
    rate: float
    rate_std: float
    type_rate: float
    type_rate_std: float
    records: int
    points: list[tuple[float, float, float]] = field(default_factory=list)  # axis, value, standard error
    line: list[tuple[float, float, float]] = field(
        default_factory=list
    )  # axis, value, standard deviation: from its last step on


@dataclass(frozen=True)
class Remaining:
    """Time from the last record until a limit [SI] is reached, hours or years; None where it may never be."""

    quantity: str
    limit: float
    unit: str
    low: float | None
    middle: float | None
    high: float | None
    now_beyond: float


@dataclass(frozen=True)
class Overhaul:
    """A step between two records. before: of the first record after it, on the axis."""

    after: float
    before: float
    p_value: float
    quantities: tuple[str, ...]
    confirmed: bool


@dataclass
class Valve:
    """One valve's life. axis: "hours" or "date" (years); reasons: why it needs attention, the gravest first; grade: 0 for none."""

    type: str
    serial: str
    axis: str
    records: int
    last_date: str | None
    last_hours: float | None
    verdict: str
    trends: list[Trend] = field(default_factory=list)
    overhauls: list[Overhaul] = field(default_factory=list)
    remaining: list[Remaining] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    grade: int = 0
    urgency: float = math.inf  # hours or years to the nearest limit, at the earliest

    def to_dict(self) -> dict[str, Any]:
        content = asdict(self)
        content["urgency"] = self.urgency if math.isfinite(self.urgency) else None
        return content


@dataclass
class FleetLife:
    """All valves, those first that need attention most. undated: records without hours and date, which no trend can use."""

    valves: list[Valve]
    undated: int = 0

    def to_dict(self) -> dict[str, Any]:
        return {
            "valves": [valve.to_dict() for valve in self.valves],
            "undated": self.undated,
            "units": "SI; hours or years",
        }

    def print_on(self, console: "Console", most: int = 25) -> None:
        from thermohyd.identify.report.terminal import table

        shown = self.valves[:most]
        rows = [
            (v.type, v.serial, str(v.records), v.verdict, "; ".join(v.reasons) or "nothing unusual", _left(v))
            for v in shown
        ]
        console.print(table(("type", "serial", ">records", "~verdict", "~attention", ">limit in"), rows))
        if len(self.valves) > most:
            console.print(f"and {len(self.valves) - most:,} valves more")


def _left(valve: Valve) -> str:
    found = [r for r in valve.remaining if r.low is not None]
    if not found:
        return ""
    nearest = min(found, key=lambda r: r.low or 0.0)
    high = "never" if nearest.high is None else f"{nearest.high:,.3g}"
    return f"{nearest.low:,.3g} to {high} {AXES[valve.axis]}"


def fleet_life(
    store: Store,
    limits: Mapping[str, Mapping[str, Limit]] | None = None,
    progress: Callable[[str], None] | None = None,
) -> FleetLife:
    """The life of every valve. Raises BenchInputError where a limit has a unit that does not fit."""
    say = progress or (lambda words: None)
    records: Any = query(store, "SELECT identity, type, serial, date, operating_hours, verdict FROM records")
    values: Any = query(
        store, "SELECT identity, name, value, std, unit FROM parameters WHERE NOT coalesce(fixed, false)"
    )
    values = values[~values["name"].map(lambda name: bool(OF_BENCH.search(name)))]
    undated = int((records["date"].isna() & records["operating_hours"].isna()).sum())
    valves: list[Valve] = []
    for type_, of_type in records.groupby("type", sort=True):
        say(f"the life of type {type_}: {of_type['serial'].nunique():,} valves, {len(of_type):,} records")
        valves += _of_type(str(type_), of_type, values, limits or {})
    valves.sort(key=lambda v: (-v.grade, v.urgency, v.type, v.serial))
    return FleetLife(valves, undated)


def _of_type(type_: str, records: Any, values: Any, limits: Mapping[str, Mapping[str, Limit]]) -> list[Valve]:
    axis = "hours" if records["operating_hours"].notna().all() else "date"
    seconds = (records["date"] - pd.Timestamp("2000-01-01")).dt.total_seconds()
    records = records.assign(at=records["operating_hours"] if axis == "hours" else seconds / YEAR)
    found = [
        (str(serial), one.sort_values(["at", "date", "identity"]))
        for serial, one in records.groupby("serial", sort=True)
    ]
    valves = [_valve(type_, serial, axis, one) for serial, one in found]
    tables = [one[one["at"].notna()] for _, one in found]
    used = [i for i, table in enumerate(tables) if len(table)]
    quantities, units = _series([tables[i] for i in used], values[values["identity"].isin(records["identity"])])
    if quantities:
        series, lines, points = find_overhauls(quantities)
        for name in series:
            _add_trends([valves[i] for i in used], name, units[name], series[name], lines[name])
        for point in points:
            _add_overhaul(valves[used[point.valve]], point, next(iter(series.values()))[point.valve].time)
        for name in series:
            ends = limits_of(limits, type_, name, units[name])
            _add_remaining([valves[i] for i in used], name, units[name], series[name], lines[name], ends)
        _unusual([valves[i] for i in used])
    for valve in valves:
        _grade(valve)
    return valves


def _valve(type_: str, serial: str, axis: str, records: Any) -> Valve:
    last = records.iloc[-1]
    date = None if pd.isna(last["date"]) else last["date"].date().isoformat()
    hours = None if pd.isna(last["operating_hours"]) else float(last["operating_hours"])
    return Valve(type_, serial, axis, len(records), date, hours, str(last["verdict"]))


def _series(tables: list[Any], values: Any) -> tuple[dict[str, list[Series]], dict[str, str]]:
    """({quantity: a series for each valve, all on the valve's records}, {quantity: unit})"""
    values = values[values["std"].notna() & values["value"].notna() & (values["std"] > 0.0)]
    quantities: dict[str, list[Series]] = {}
    units: dict[str, str] = {}
    for name, of_name in values.groupby("name", sort=True):
        unit = of_name["unit"].mode().iloc[0]
        of_name = of_name[of_name["unit"] == unit]
        if len(of_name) < FEWEST:
            continue
        value = dict(zip(of_name["identity"], of_name["value"], strict=True))
        std = dict(zip(of_name["identity"], of_name["std"], strict=True))
        quantities[str(name)] = [
            Series(
                table["at"].to_numpy(float),
                np.array([value.get(identity, 0.0) for identity in table["identity"]]),
                np.array([std.get(identity, math.inf) for identity in table["identity"]]),
            )
            for table in tables
        ]
        units[str(name)] = str(unit)
    return quantities, units


def _add_trends(valves: list[Valve], name: str, unit: str, series: list[Series], line: Pooled) -> None:
    type_std = float(np.sqrt(line.population_covariance[1, 1]))
    for i, (valve, one) in enumerate(zip(valves, series, strict=True)):
        count = int(np.isfinite(one.std).sum())
        if not count:
            continue
        level, level_std = line.at(i, one.time[-1])
        rate_std = float(np.sqrt(line.covariance[i, 1, 1]))
        rates = (float(line.mean[i, 1]), rate_std, float(line.population[1]), type_std)
        known = np.isfinite(one.std)
        points = [
            (float(t), float(y), float(s))
            for t, y, s in zip(one.time[known], one.value[known], one.std[known], strict=True)
        ]
        first, last = float(one.time[one.steps[-1] if one.steps else 0]), float(one.time[-1])
        at = np.linspace(first, last + max(last - first, HORIZON[valve.axis]) / 3.0, ALONG)
        drawn = [(float(t), float(y), float(s)) for t, y, s in zip(at, *line.at(i, at), strict=True)]
        ends = (float(level[0]), float(level_std[0]))
        valve.trends.append(Trend(name, unit, *ends, *rates, count, points, drawn))


def _add_overhaul(valve: Valve, point: ChangePoint, time: np.ndarray) -> None:
    between = (float(time[point.before - 1]), float(time[point.before]))
    valve.overhauls.append(Overhaul(*between, point.p_value, point.quantities, point.confirmed))


def _add_remaining(
    valves: list[Valve], name: str, unit: str, series: list[Series], line: Pooled, ends: Mapping[str, float]
) -> None:
    for i, (valve, one) in enumerate(zip(valves, series, strict=True)):
        if not np.isfinite(one.std).any():
            continue
        span = float(one.time[-1] - one.time[0]) or HORIZON[valve.axis]
        for end, limit in ends.items():
            told: Crossing = crossing(line, i, float(one.time[-1]), limit, end == "max", span)
            low, middle, high = (t if math.isfinite(t) else None for t in (told.low, told.middle, told.high))
            valve.remaining.append(Remaining(name, limit, unit, low, middle, high, told.now_beyond))


def _unusual(valves: list[Valve]) -> None:
    """Rates that are rare among the valves of the type: beside what the others do, and not beside the error alone."""
    names = {trend.quantity for valve in valves for trend in valve.trends}
    for name in sorted(names):
        mine = [(valve, trend) for valve in valves for trend in valve.trends if trend.quantity == name]
        rates = np.array([trend.rate for _, trend in mine])
        if len(rates) < FEWEST:
            continue
        middle = float(np.median(rates))
        spread = float(np.median(np.abs(rates - middle))) * 1.4826  # of a normal law
        for valve, trend in mine:
            z = (trend.rate - middle) / math.hypot(spread, trend.rate_std)
            if len(rates) * 2.0 * float(norm.sf(abs(z))) < UNUSUAL:
                valve.reasons.append(
                    f"{name} changes {'faster' if z * middle > 0 else 'otherwise'} than in its type ({z:+.1f} sigma)"
                )
                valve.grade = max(valve.grade, 2)


def _grade(valve: Valve) -> None:
    """4: beyond a limit; 3: one is near; 2: wears as others of its type do not; 1: its last record is not explained, or a step is fresh."""
    reasons: list[tuple[int, str]] = [(2, reason) for reason in valve.reasons]
    unit = AXES[valve.axis]
    for one in valve.remaining:
        valve.urgency = min(valve.urgency, math.inf if one.low is None else one.low)
        if one.now_beyond >= 0.5:
            reasons.append((4, f"{one.quantity} is beyond its limit"))
        elif one.low is not None and one.low < HORIZON[valve.axis]:
            reasons.append((3, f"{one.quantity} may reach its limit within {max(one.low, 0.0):,.3g} {unit}"))
    if valve.verdict in UNSETTLED:
        reasons.append((1, f"last record: {valve.verdict}"))
    if valve.overhauls and not valve.overhauls[-1].confirmed:
        reasons.append((1, "a step in the last record: an overhaul, or a bad test"))
    reasons.sort(key=lambda pair: -pair[0])
    valve.reasons = [words for _, words in reasons]
    valve.grade = max((grade for grade, _ in reasons), default=0)
