"""Which effects of the library a record can speak of at all, and how they are grouped for compiling."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, EffectInfo, effect_info
from thermohyd.identify.bench.record import DynamicTest, TestRecord


# Sweeps whose rates differ by less are one rate: a lag then cannot be told from hysteresis.
RATES_DIFFER = 1.2


HEAT = "throttle_heating"


@dataclass(frozen=True)
class Library:
    """Effects that a record's columns allow, in the registry's order, and why the others are out: {name: reason}."""

    names: tuple[str, ...]
    impossible: dict[str, str]

    @property
    def plain(self) -> tuple[str, ...]:
        """Those that leave the ports' balances apart: cheap to compile and to run."""
        return tuple(name for name in self.names if not coupled(name))

    @property
    def cold(self) -> tuple[str, ...]:
        """Those that need no heat computed, coupled ones included: half as dear as all together."""
        return tuple(name for name in self.names if name != HEAT)


NOTHING = Library((), {})  # of a plain fit


def coupled(name: str) -> bool:
    """Whether an effect ties the balances together (lines, flow between the ports)."""
    return any(stage in ("lines", "crossing") for stage in effect_info(name).stages)


def dear(names: Iterable[str]) -> bool:
    """Whether effects need heat and a coupled balance together: a program of its own, which takes long to compile."""
    names = tuple(names)
    return HEAT in names and any(coupled(name) for name in names)


def library_for(tests: Iterable[TestRecord]) -> Library:
    """The part of the library that the columns of these tests can show."""
    tests = list(tests)
    names, impossible = [], {}
    for name, info in EFFECTS.items():
        reason = _why_not(name, info, tests)
        if reason:
            impossible[name] = reason
        else:
            names.append(name)
    return Library(tuple(names), impossible)


def _why_not(name: str, info: EffectInfo, tests: list[TestRecord]) -> str:
    shown = [test for test in tests if test.name in info.shows]
    if not shown:
        return f"none of its tests ({', '.join(info.shows)}) is in the record"
    if name == "flowmeter_lag" and not all(test.time is not None for test in shown):
        return "needs the column time in every test that measures a flow"
    if name == "position_lag":
        if not all(test.rate is not None for test in tests):
            return "needs the column time in every test"
        if not _several_rates(tests):
            return "all sweeps run at one rate, at which it looks like hysteresis"
    if name == "hysteresis" and not any(len(np.unique(test.direction)) > 1 for test in tests):
        return "all sweeps run in one direction"
    return ""


def _several_rates(tests: list[TestRecord]) -> bool:
    rates = []
    for test in tests:
        if test.rate is None:
            continue
        for run in np.unique(test.run):
            moving = np.abs(test.rate[test.run == run])
            moving = moving[moving > 0.0]
            if len(moving):
                rates.append(float(np.median(moving)))
    return bool(rates) and max(rates) > RATES_DIFFER * min(rates)


# Static effects that a step test can show: few, as each is one more name that chance may hit. A leak between the ports is
# the jack's leak by another name, and stands for itself in the static library.
STATIC = ("unequal_underlap", "position_scale")


def motion_library(tests: dict[str, DynamicTest], heat: str) -> Library:
    """The dynamic effects, and a few static ones, that these tests can show."""
    names, impossible = [], {}
    kinds = {test.name for test in tests.values()}
    readings = {channel.name for test in tests.values() for channel in test.channels}
    for name in (*STATIC, *DYNAMIC_EFFECTS):
        info = effect_info(name)
        if name in DYNAMIC_EFFECTS and not kinds & set(info.shows):
            impossible[name] = f"none of its tests ({', '.join(info.shows)}) is in the record"
        elif name == "wall_heat" and heat == "isothermal":
            impossible[name] = 'the record says heat = "isothermal": all oil has the supply\'s temperature'
        elif name == "position_scale" and "spool_position" not in readings:
            impossible[name] = "the spool's position is not measured"
        else:
            names.append(name)
    known = list({**EFFECTS, **DYNAMIC_EFFECTS})
    return Library(tuple(sorted(names, key=known.index)), impossible)
