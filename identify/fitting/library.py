"""Which effects of the library a record can speak of at all, and how they are grouped for compiling."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from thermohyd.effects.effect_info import EffectInfo
from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, whole_library
from thermohyd.identify.bench.test_record import DynamicTest, TestRecord

from .bench_faults import info_of


# Sweeps whose rates differ by less are one rate: a lag then cannot be told from hysteresis.
RATES_DIFFER = 1.2


@dataclass(frozen=True)
class Library:
    """Effects that a record's columns allow, in the registry's order, and why the others are out: {name: reason}."""

    names: tuple[str, ...]
    impossible: dict[str, str]

    def without(self, names: Iterable[str]) -> "Library":
        """The library with these effects taken out."""
        out = set(names)
        kept = {name: why for name, why in self.impossible.items() if name not in out}
        return Library(tuple(name for name in self.names if name not in out), kept)

    @property
    def steady(self) -> tuple[str, ...]:
        """Those that leave every row of a sweep a balance of its own."""
        return tuple(name for name in self.names if not stores(name))

    def program(self, chosen: Iterable[str], heat: bool = False) -> tuple[str, ...]:
        """The effects that share a compiled program with `chosen`: all that make no evaluation of it longer than these do.

        heat: computed in any case.
        """
        needs = _needs(chosen, heat)
        if needs == {COSTLY}:  # where ports and rows are apart, one more program to compile takes longer than it saves
            needs |= {HEAT}
        return tuple(name for name in self.names if _needs((name,)) <= needs)


NOTHING = Library((), {})  # of a plain fit
TIED, STORED, HEAT, COSTLY = "tied", "stored", "heat", "costly"


def _needs(names: Iterable[str], heat: bool = False) -> frozenset[str]:
    """What of a program that is dear to run effects ask for."""
    infos = [info_of(name) for name in names]
    heat = heat or any(info.computes_heat for info in infos)
    asked = {
        TIED: any(info.coupled for info in infos),
        STORED: any(info.stores for info in infos),
        HEAT: heat,
        COSTLY: heat or any(info.costly for info in infos),
    }
    return frozenset(need for need in asked if asked[need])


def program_of_all(names: Iterable[str], heat: bool) -> tuple[str, ...]:
    """Effects of the whole library, whatever a record can show, in a program no dearer than that of `names`; heat: computed there."""
    needs = _needs(names, heat)
    return tuple(name for name in EFFECTS if _needs((name,)) <= needs)


def same_program(names: Iterable[str], heat: bool) -> tuple[str, ...]:
    """Those of `program_of_all` that act row by row. No effect among them stores oil."""
    return tuple(name for name in program_of_all(names, heat) if EFFECTS[name].rowwise and not EFFECTS[name].stores)


def run_most(names: Iterable[str]) -> bool:
    """Whether effects share the program that a search runs most: a diagnosis of 2,400 readings calls it 4,000 times, and those with
    something dear in them a hundred times each."""
    return not _needs(names)


def coupled(name: str) -> bool:
    """Whether an effect ties the balances together (lines, flow between the ports)."""
    return info_of(name).coupled


def stores(name: str) -> bool:
    """Whether an effect ties the rows of a sweep together."""
    return info_of(name).stores


def with_heat(names: Iterable[str]) -> bool:
    """Whether any of these effects needs the heat of throttling computed."""
    return any(info_of(name).computes_heat for name in names)


def expensive_to_compile(names: Iterable[str]) -> bool:
    """Whether effects need a coupled balance and heat or storage beside it: a program of its own, which takes long to compile."""
    names = tuple(names)
    return any(coupled(name) for name in names) and (with_heat(names) or any(stores(name) for name in names))


def asks_for_more(names: Iterable[str]) -> bool:
    """Whether effects need a program that most records do without: one that takes long to compile, or that of stored oil."""
    names = tuple(names)
    return expensive_to_compile(names) or any(stores(name) for name in names)


# Times that an evaluation of a real valve's 1,608 readings took, on one core and without anything costly: 6.8 ms, 13.5 where lines or
# a path tie the ports together, 59 where they store oil, 110 with both; 26, 80 and 168 ms with what is costly; 24, 57, 106 and
# 337 with heat. In units of 24 ms.
COSTS = {
    frozenset(): 0.3,
    frozenset({TIED}): 0.6,
    frozenset({STORED}): 2.5,
    frozenset({TIED, STORED}): 4.6,
    frozenset({COSTLY}): 1.0,
    frozenset({TIED, COSTLY}): 1.1,
    frozenset({STORED, COSTLY}): 3.3,
    frozenset({TIED, STORED, COSTLY}): 7.0,
    frozenset({HEAT, COSTLY}): 1.0,
    frozenset({TIED, HEAT, COSTLY}): 2.4,
    frozenset({STORED, HEAT, COSTLY}): 4.4,
    frozenset({TIED, STORED, HEAT, COSTLY}): 14.0,
}


def relative_cost(names: Iterable[str]) -> float:
    """What an evaluation of static tests with these effects takes, in those of heat with every row and port apart."""
    return COSTS[_needs(names)]


def library_for(tests: Iterable[TestRecord]) -> Library:
    """The part of the library that the columns of these tests can show."""
    tests = list(tests)
    names, impossible = [], {}
    for name, info in EFFECTS.items():
        reason = _why_not(info, tests)
        if reason:
            impossible[name] = reason
        else:
            names.append(name)
    return Library(tuple(names), impossible)


def _why_not(info: EffectInfo, tests: list[TestRecord]) -> str:
    shown = [test for test in tests if test.name in info.shows]
    if not shown:
        return f"none of its tests ({', '.join(info.shows)}) is in the record"
    if "time" in info.needs and not all(test.time is not None for test in shown):
        return f"needs the column time in every test that shows it ({', '.join(test.name for test in shown)})"
    if "rate" in info.needs and not all(test.rate is not None for test in tests):
        return "needs the column time in every test"
    if "several_rates" in info.needs and not _several_rates(tests):
        return f"all sweeps run at one rate, at which it looks like {info.looks_like or 'a loop of constant width'}"
    if "both_directions" in info.needs and not any(len(np.unique(test.direction)) > 1 for test in tests):
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


def motion_library(tests: dict[str, DynamicTest], heat: str) -> Library:
    """The dynamic effects, and a few static ones, that these tests can show."""
    names, impossible = [], {}
    kinds = {test.kind for test in tests.values()}
    readings = {channel.name for test in tests.values() for channel in test.channels}
    # Few static ones, as each is one more name that chance may hit. A leak between the ports is the jack's leak by another
    # name, and stands for itself in the static library.
    for name, info in whole_library().items():
        if name in EFFECTS and not info.also_in_motion:
            continue
        if name in DYNAMIC_EFFECTS and not kinds & set(info.shows):
            impossible[name] = f"none of its tests ({', '.join(info.shows)}) is in the record"
        elif "warm_chambers" in info.needs and heat == "isothermal":
            impossible[name] = 'the record says heat = "isothermal": all oil has the supply\'s temperature'
        elif "measured_spool" in info.needs and "spool_position" not in readings:
            impossible[name] = "the spool's position is not measured"
        else:
            names.append(name)
    return Library(tuple(names), impossible)
