"""The measurement that separates what a record cannot: the rivals' predictions elsewhere, after each adapts itself.

T-optimal design (Atkinson and Fedorov, Biometrika 62, 1975) over a small menu of changes to the tests that were run. Where
nothing explains the record there are no rivals to separate: the run that shows most of the gap is read once more. Where everything
is explained the same menu says what would show the effects that this record cannot.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.bench_faults import TEMPERATURE_STEP, is_fault
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit

from .found_faults import where
from .other_law import ANOTHER_LAW, OtherLawSays
from .result import NextTest, Region, Variation
from .rivals import Rivals
from .screening import BOTH_PORTS, POWER, Projection, can_measure_ports, ports_apart


ENOUGH = 12.0  # chi-square that settles a choice: odds of 400 to 1


def next_test(
    problem: Problem,
    final: Fit,
    rivals: dict[str, Rivals],
    scale: float,
    say: Callable[[str], None] = lambda _: None,
    law: OtherLawSays | None = None,
) -> NextTest | None:
    """The change of conditions under which the closest pair of rivals differs most, with the evidence to expect.

    law: another law of the edge that stands in the place of named effects is a rival too.
    """
    of_the_valve = {
        name: [r for r in rival.alike if not is_fault(r.name)] for name, rival in rivals.items() if not is_fault(name)
    }
    pairs = [(problem, r.fit) for alike in of_the_valve.values() for r in alike]
    names = {r.name for alike in of_the_valve.values() for r in alike} | {
        n for n, alike in of_the_valve.items() if alike
    }
    ports = can_measure_ports(problem)
    if law is not None and law.in_place_of:
        # What both port pressures would show is only worked out for two models of one law.
        pairs, ports = [*pairs, (law.problem, law.needed)], False
        names |= {*law.in_place_of, ANOTHER_LAW}
    if not pairs:
        return _repeat(problem, final, rivals, scale)
    say("designing the next test")
    found = []
    for words, tests in menu(problem.tests):
        there = lambda here, tests=tests: replace(here, tests=tests, used=None)
        # Every pair has to come apart, so the weakest one counts.
        evidence = min(
            min(
                _apart(here, there(here), there(problem), final, b),
                _apart(problem, there(problem), there(here), b, final),
            )
            for here, b in pairs
        )
        found.append((words, evidence / scale))
    if ports:
        evidence = min(min(ports_apart(problem, final, b), ports_apart(problem, b, final)) for _, b in pairs)
        found.append((BOTH_PORTS, evidence / scale))
    found.sort(key=lambda option: -option[1])
    words, evidence = found[0]
    names = sorted(names)
    if words == BOTH_PORTS and evidence >= ENOUGH:
        sentence = f"repeat the pressure-gain test {words}: {', '.join(names)} would then differ by about {evidence:.0f} in chi-square"
    elif evidence < ENOUGH:
        sentence = (
            f"No change of temperature, supply pressure or sweep rate of these tests separates {', '.join(names)}: the best, "
            f"{words}, would show a chi-square difference of {evidence:.1f}; a direct measurement is needed "
            "(the oil's viscosity, a calibrated flowmeter or position transducer)"
        )
    else:
        sentence = (
            f"repeat the tests {words}: {', '.join(names)} would then differ by about {evidence:.0f} in chi-square"
        )
    return NextTest(sentence, evidence, tuple(found))


def _repeat(problem: Problem, final: Fit, rivals: dict[str, Rivals], scale: float) -> NextTest | None:
    """Where a fault of the bench stands against an effect: what was read once, read again."""
    open_ = {
        name: rival
        for name, rival in rivals.items()
        if any(is_fault(n) for n in (name, *(r.name for r in rival.alike)))
    }
    open_ = {name: rival for name, rival in open_.items() if rival.alike}
    if not open_:
        return None
    faults = dict.fromkeys(n for name, r in open_.items() for n in (name, *(a.name for a in r.alike)) if is_fault(n))
    evidence = min(rival.without.chi2 - final.chi2 for rival in open_.values()) / scale
    return _proposed([_zeroed(", ".join(dict.fromkeys(where(problem.faults[name]) for name in faults)), evidence)])


Option = tuple[str, str, float]  # what to do, what it tells, evidence


def _zeroed(places: str, evidence: float) -> Option:
    words = f"zero the instruments, check the labels and repeat {places}"
    return words, "a fault of the bench would not come back, an effect of the valve would", evidence


def _proposed(options: list[Option]) -> NextTest:
    """The first of them, the others beside it."""
    words, meaning, evidence = options[0]
    return NextTest(f"{words}: {meaning}", evidence, tuple((words, evidence) for words, _, evidence in options))


WITH_THE_RATE = ("rate", "direction", "elapsed")  # variables of a curve that stored oil or a lag makes
WITH_THE_ORDER = ("temperature", "time")  # those that go together where a bench warms up once
MOST = 0.5  # of the gap: a curve over a variable that closes this share says what to change


def check_of(
    problem: Problem,
    fit: Fit,
    worst: tuple[Region, ...],
    smooth: tuple[Variation, ...],
    rivals: dict[str, Rivals],
    scale: float,
) -> NextTest | None:
    """Where nothing explains the gap: what was read once, read again, so that one kind of cause is ruled out.

    worst: where the final model misses most. Of its test the run that shows most is repeated: as it was, at half the rate, or with the
    temperatures in another order, whichever the curve that closes most of the gap asks for; where several runs have a fault of their
    own, these. Evidence is the chi-square beyond noise of the rows to be read again, or what the change takes from it: half of a
    misfit is a quarter of its chi-square.
    """
    variable = smooth[0].variable if smooth and smooth[0].gap_closed > MOST else ""
    options = _runs_again(problem, fit, worst[0], variable) if worst and worst[0].test in problem.tests else []
    placed = {name: fault for name in fit.faults if (fault := problem.faults[name]).test and fault.place}
    if placed:
        places: dict[str, dict[str, None]] = {}
        for fault in placed.values():
            places.setdefault(fault.test.replace("_", " "), {})[fault.place] = None
        evidence = min(rivals[name].without.chi2 - fit.chi2 for name in placed) / scale
        again = _zeroed(" and ".join(f"{test} ({', '.join(own)})" for test, own in places.items()), evidence)
        options.insert(0 if not variable else len(options), again)
    return _proposed(options) if options else None


def _runs_again(problem: Problem, fit: Fit, worst: Region, variable: str) -> list[Option]:
    """Each way to repeat the run that misses most, what a curve over `variable` asks for first."""
    test = problem.tests[worst.test]
    words = test.name.replace("_", " ")
    runs = {name: _excess(problem, fit, test, own) for name, own in test.runs.items()}
    run = max(runs, key=lambda name: runs[name])
    excess, own = runs[run], test.runs[run]
    seconds = "" if test.time is None else f", {float(np.ptp(test.time[own])):.3g} s"
    spoken = f"{words}{f', run {run}' if len(runs) > 1 else ''} ({int(own.sum())} rows{seconds})"
    found = [(f"repeat {spoken} as it was", "a misfit of the valve comes back, one of the bench does not", excess)]
    if test.time is not None and not test.in_motion:
        halved = "a misfit that goes with the rate (oil stored, a lag) halves, one of the position does not"
        found.append((f"repeat {spoken} at half the rate", halved, 0.25 * excess))
        if variable in WITH_THE_RATE:
            found.reverse()
    if variable in WITH_THE_ORDER and float(np.ptp(test.temperature)) > TEMPERATURE_STEP:
        order = "what comes with the temperature comes with it again, what comes with the hour does not"
        again = f"repeat {words} with the temperatures in the opposite order"
        found.insert(0, (again, order, sum(runs.values())))
    return found


def _excess(problem: Problem, fit: Fit, test: TestRecord, own: np.ndarray) -> float:
    """Chi-square of a test's own rows beyond one per row."""
    rows = (problem.rows()[test.name, channel.name] for channel in test.channels)
    return float(sum(np.sum(np.square(fit.residual[place][own]) - 1.0) for place in rows))


def what_shows(
    problem: Problem,
    fit: Fit,
    absorbed: Iterable[str],
    critical: float,
    say: Callable[[str], None] = lambda _: None,
) -> NextTest | None:
    """Where parameters absorb effects: the change of conditions under which most of them would show in their largest usual amounts.

    critical: the score that names an effect. None where no change shows any. Evidence: the chi-square of the one that shows least.
    """
    names = [name for name in absorbed if not stores(name)]
    if not names:
        return None
    say("designing the next test")
    least = (critical + float(ndtri(POWER))) ** 2
    here, found = problem.with_all_columns(fit), []
    for words, tests in menu(problem.tests):
        anew = replace(problem, tests=tests, used=None)
        there = anew.with_all_columns(anew.evaluate(fit.values, fit.effects))
        both = lambda name, there=there: np.concatenate(
            [here.column(name), there.column(name)[: -len(problem.parameters)]]
        )
        nuisance = np.stack([both(name) for name in fit.free if name not in fit.active], axis=1)
        if not np.isfinite(nuisance).all():
            continue
        beside = Projection.beside(nuisance)
        size = {name: float(np.linalg.norm(beside(both(name)))) * effect_info(name).typical[1] for name in names}
        shown = {name: length**2 for name, length in size.items() if length**2 >= least}
        if shown:
            found.append((words, shown))
    if not found:
        return None
    found.sort(key=lambda option: (-len(option[1]), -min(option[1].values())))
    words, shown = found[0]
    whose = "its largest usual amount" if len(shown) == 1 else "their largest usual amounts"
    sentence = (
        f"repeat the tests {words}: {', '.join(shown)} would then show in {whose}, as this record alone cannot tell"
    )
    return NextTest(sentence, min(shown.values()), tuple((words, min(shown.values())) for words, shown in found))


def menu(tests: dict[str, TestRecord]) -> list[tuple[str, dict[str, TestRecord]]]:
    """Changes of conditions that a bench can make, in words, and the tests under them."""
    every = list(tests.values())
    warm = float(max(np.max(t.temperature) for t in every))
    cold = float(min(np.min(t.temperature) for t in every))
    high = float(max(np.max(t.supply_pressure) for t in every))
    options: list[tuple[str, dict[str, TestRecord]]] = [("once more as they were", dict(tests))]

    def add(words: str, change: Callable[[TestRecord], TestRecord]) -> None:
        options.append((words, {name: change(test) for name, test in tests.items()}))

    for temperature in (cold - 25.0, warm + 25.0):
        if 233.0 < temperature < 403.0:
            add(f"at {temperature - 273.15:.0f} degC", lambda t, k=temperature: _at_temperature(t, k))
    for pressure in (0.4 * high, 1.5 * high):
        if pressure < 355e5:
            add(f"at {pressure / 1e5:.0f} bar supply pressure", lambda t, p=pressure: _at_supply(t, p))
    back = 0.15 * high
    add(f"with {back / 1e5:.0f} bar in the return", lambda t: replace(t, return_pressure=np.full(t.rows, back)))
    if all(t.time is not None for t in every):
        add("at five times the sweep rate", lambda t: _at_rate(t, 5.0))
        add("at a fifth of the sweep rate", lambda t: _at_rate(t, 0.2))
    return options


def _at_temperature(test: TestRecord, temperature: float) -> TestRecord:
    return replace(test, temperature=np.full(test.rows, temperature))


def _at_supply(test: TestRecord, pressure: float) -> TestRecord:
    factor = pressure / np.maximum(test.supply_pressure, 1.0)
    load = None if test.load_pressure is None else test.load_pressure * factor
    nodes = test.nodes
    if nodes is not None and nodes.axis == "load_pressure":
        nodes = replace(nodes, offset=nodes.offset * factor[:, None])
    return replace(test, supply_pressure=np.full(test.rows, pressure), load_pressure=load, nodes=nodes)


def _at_rate(test: TestRecord, factor: float) -> TestRecord:
    assert test.time is not None
    rate = None if test.rate is None else test.rate * factor
    nodes = None if test.nodes is None else replace(test.nodes, time=test.nodes.time / factor)
    return replace(test, time=test.time / factor, rate=rate, nodes=nodes)


def _apart(here: Problem, there: Problem, truth: Problem, true: Fit, other: Fit) -> float:
    """Chi-square by which `other` would miss new data that follow `true`, once refitted to old and new data together.

    here, there: the old and the new data as `other` sees them. truth: the new data as `true` sees them.
    """
    made = truth.evaluate(true.values, true.effects)
    claimed = there.evaluate(other.values, other.effects)
    columns = [other.order.index(name) for name in other.free]
    new_columns = claimed.columns[:, [claimed.order.index(name) for name in other.free]]
    at = np.concatenate([here.evaluate(other.values, other.effects).columns[:, columns], new_columns])
    difference = np.concatenate([np.zeros(len(at) - len(made.residual)), claimed.residual - made.residual])
    if not (np.isfinite(at).all() and np.isfinite(difference).all()):
        return 0.0
    left = Projection.beside(at)(difference)
    return float(left @ left)
