"""The measurement that separates what a record cannot: the rivals' predictions elsewhere, after each adapts itself.

T-optimal design (Atkinson and Fedorov, Biometrika 62, 1975) over a small menu of changes to the tests that were run. Where
nothing explains the record there are no rivals to separate: the run that shows most of the gap is read once more. Where everything
is explained the same menu says what would show the effects that this record cannot, or settle what is suspected.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from .result import WEAK, NextTest, Proposal, Region, Suspect, Variation
from .rivals import Rivals
from .screening import BOTH_PORTS, POWER, Projection, can_measure_ports, ports_apart


ENOUGH = 12.0  # chi-square that settles a choice: odds of 400 to 1, 2 ln 400
APART, COLDEST, HOTTEST = 25.0, 233.0, 403.0  # K: a step beyond the temperatures read, and between which a bench can be
ALL = ""  # tests, in the place of a test's name
MUCH_LESS = 0.7  # of the reading: from here on a cheaper measurement is worth a word


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
    found: list[Proposal] = []
    for words, tests in menu(problem.tests):
        noise = problem.under(tests, final).noise
        there = lambda here, tests=tests, noise=noise: replace(here, tests=tests, noise=noise, used=None)
        both_ways = [
            way
            for here, b in pairs
            for way in (
                _apart(here, there(here), there(problem), final, b),
                _apart(problem, there(problem), there(here), b, final),
            )
        ]
        # Every pair has to come apart, so the weakest one counts.
        each = {name: min(way[name] for way in both_ways) / scale for name in both_ways[0]}
        found.append(Proposal(words, each.pop(ALL), *cost_of(tests.values())))
        if len(each) > 1:
            best = max(each, key=lambda name: each[name])
            only = f"{words}, {best.replace('_', ' ')} alone"
            found.append(Proposal(only, each[best], *cost_of([tests[best]])))
    if ports:
        evidence = min(min(ports_apart(problem, final, b), ports_apart(problem, b, final)) for _, b in pairs)
        found.append(Proposal(BOTH_PORTS, evidence / scale, *cost_of([problem.tests["pressure_gain"]])))
    found.sort(key=lambda option: -option.evidence)
    words, evidence = found[0].words, found[0].evidence
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
        if (less := cheaper(found)) is not None:
            option, share = less
            sentence += f"; {option.words}, by {option.evidence:.0f}, in {100.0 * share:.0f} % of the reading"
    return NextTest(sentence, evidence, tuple(found))


def cost_of(tests: Iterable[TestRecord], asked: Mapping[str, np.ndarray] | None = None) -> tuple[int, float | None]:
    """(rows, seconds) of reading these tests, or of each its rows `asked` (rows,); seconds of all runs, None without a time."""
    count, seconds = 0, 0.0
    for test in tests:
        rows = np.ones(test.rows, dtype=bool) if asked is None else asked[test.name]
        count += int(np.sum(rows if test.rows_of_log is None else test.rows_of_log[rows]))
        runs = [rows & own for own in test.runs.values() if (rows & own).any()]
        seconds += np.nan if test.time is None else sum(float(np.ptp(test.time[own])) for own in runs)
    return count, None if np.isnan(seconds) else seconds


def cheaper(found: list[Proposal]) -> tuple[Proposal, float] | None:
    """Of proposals, the best first, the cheapest that settles the choice too, and its share of the reading; at most `MUCH_LESS` of it.

    By seconds where all have them, else by rows.
    """
    seconds = [p.seconds for p in found if p.seconds is not None]
    costs = seconds if len(seconds) == len(found) else [float(p.rows) for p in found]
    cost, least = min(
        ((c, p) for c, p in zip(costs, found, strict=True) if p.evidence >= ENOUGH), key=lambda pair: pair[0]
    )
    return (least, cost / costs[0]) if cost <= MUCH_LESS * costs[0] else None


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
    places = ", ".join(dict.fromkeys(where(problem.faults[name]) for name in faults))
    return _proposed([_zeroed(places, evidence, *_cost_of_faults(problem, faults))])


Option = tuple[Proposal, str]  # what to do, what it tells


def _cost_of_faults(problem: Problem, names: Iterable[str]) -> tuple[int, float | None]:
    """(rows, seconds) of what these faults spoil."""
    spoilt: dict[str, np.ndarray] = {}
    for name in names:
        for test, shape in problem.faults[name].shapes.items():
            spoilt[test] = spoilt.get(test, False) | (shape != 0.0)
    return cost_of([problem.tests[test] for test in spoilt], spoilt)


def _zeroed(places: str, evidence: float, rows: int, seconds: float | None) -> Option:
    words = f"zero the instruments, check the labels and repeat {places}"
    told = "a fault of the bench would not come back, an effect of the valve would"
    return Proposal(words, evidence, rows, seconds), told


def _proposed(options: list[Option]) -> NextTest:
    """The first of them, the others beside it."""
    (first, meaning), proposals = options[0], tuple(proposal for proposal, _ in options)
    return NextTest(f"{first.words}: {meaning}", first.evidence, proposals)


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
        cost = _cost_of_faults(problem, placed)
        again = _zeroed(" and ".join(f"{test} ({', '.join(own)})" for test, own in places.items()), evidence, *cost)
        options.insert(0 if not variable else len(options), again)
    return _proposed(options) if options else None


def _runs_again(problem: Problem, fit: Fit, worst: Region, variable: str) -> list[Option]:
    """Each way to repeat the run that misses most, what a curve over `variable` asks for first."""
    test = problem.tests[worst.test]
    words = test.name.replace("_", " ")
    runs = {name: _excess(problem, fit, test, own) for name, own in test.runs.items()}
    run = max(runs, key=lambda name: runs[name])
    excess, own = runs[run], test.runs[run]
    rows, seconds = cost_of([test], {test.name: own})
    spoken = f"{words}{f', run {run}' if len(runs) > 1 else ''} ({rows} rows{'' if seconds is None else f', {seconds:.3g} s'})"
    as_it_was = Proposal(f"repeat {spoken} as it was", excess, rows, seconds)
    found = [(as_it_was, "a misfit of the valve comes back, one of the bench does not")]
    if seconds is not None and not test.in_motion:
        halved = "a misfit that goes with the rate (oil stored, a lag) halves, one of the position does not"
        found.append((Proposal(f"repeat {spoken} at half the rate", 0.25 * excess, rows, 2.0 * seconds), halved))
        if variable in WITH_THE_RATE:
            found.reverse()
    if variable in WITH_THE_ORDER and float(np.ptp(test.temperature)) > TEMPERATURE_STEP:
        order = "what comes with the temperature comes with it again, what comes with the hour does not"
        again = f"repeat {words} with the temperatures in the opposite order"
        found.insert(0, (Proposal(again, sum(runs.values()), *cost_of([test])), order))
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
    found = []
    for words, length, cost in _seen_beside(problem, fit, names):
        shown = {name: (size * effect_info(name).typical[1]) ** 2 for name, size in length.items()}
        shown = {name: square for name, square in shown.items() if square >= least}
        if shown:
            found.append((words, shown, cost))
    if not found:
        return None
    found.sort(key=lambda option: (-len(option[1]), -min(option[1].values())))
    words, shown, _ = found[0]
    whose = "its largest usual amount" if len(shown) == 1 else "their largest usual amounts"
    sentence = (
        f"repeat the tests {words}: {', '.join(shown)} would then show in {whose}, as this record alone cannot tell"
    )
    proposals = tuple(Proposal(words, min(shown.values()), *cost) for words, shown, cost in found)
    return NextTest(sentence, proposals[0].evidence, proposals)


def what_settles(
    problem: Problem,
    fit: Fit,
    suspects: Iterable[Suspect],
    scale: float,
    say: Callable[[str], None] = lambda _: None,
) -> NextTest | None:
    """Where something was found and not proven: the change of conditions under which it would stand out most, in the amount that was
    found. Evidence: the chi-square of the one that stands out least, of both records together.

    None where nothing is suspected that a change of conditions could settle.
    """
    amounts = {s.name: s.value for s in suspects if s.hint and not stores(s.name)}
    if not amounts:
        return None
    say("designing the next test")
    found = [
        Proposal(words, min((size * amounts[name]) ** 2 for name, size in length.items()) / scale, *cost)
        for words, length, cost in _seen_beside(problem, fit, tuple(amounts))
    ]
    if not found:
        return None
    found.sort(key=lambda option: -option.evidence)
    words, errors, names = found[0].words, float(np.sqrt(found[0].evidence)), ", ".join(amounts)
    if errors >= WEAK:
        sentence = (
            f"repeat the tests {words}: {names}, if it is there as it was found, would then stand at {errors:.0f} standard errors, where "
            f"{WEAK:.0f} are enough; if not, it goes"
        )
    else:
        sentence = (
            f"no change of temperature, supply pressure or sweep rate of these tests lifts {names} beyond doubt: the best, {words}, "
            f"would show it at {errors:.1f} standard errors, where {WEAK:.0f} are enough; read several times, or measure it directly"
        )
    return NextTest(sentence, found[0].evidence, tuple(found))


def _seen_beside(
    problem: Problem, fit: Fit, names: Sequence[str]
) -> Iterator[tuple[str, dict[str, float], tuple[int, float | None]]]:
    """Of each change of conditions: the words, what a unit of each effect does that the free parameters cannot, in noise units, with this
    record and the tests under the change together, and the cost."""
    here = problem.with_all_columns(fit)
    for words, tests in menu(problem.tests):
        anew = problem.under(tests, fit)
        there = anew.with_all_columns(anew.evaluate(fit.values, fit.effects))
        both = lambda name, there=there: np.concatenate(
            [here.column(name), there.column(name)[: -len(problem.parameters)]]
        )
        nuisance = np.stack([both(name) for name in fit.free if name not in fit.active], axis=1)
        if np.isfinite(nuisance).all():
            beside = Projection.beside(nuisance)
            yield words, {name: float(np.linalg.norm(beside(both(name)))) for name in names}, cost_of(tests.values())


def menu(tests: dict[str, TestRecord]) -> list[tuple[str, dict[str, TestRecord]]]:
    """Changes of conditions that a bench can make, in words, and the tests under them."""
    every = list(tests.values())
    warm = float(max(np.max(t.temperature) for t in every))
    cold = float(min(np.min(t.temperature) for t in every))
    high = float(max(np.max(t.supply_pressure) for t in every))
    options: list[tuple[str, dict[str, TestRecord]]] = [("once more as they were", dict(tests))]

    def add(words: str, change: Callable[[TestRecord], TestRecord]) -> None:
        options.append((words, {name: change(test) for name, test in tests.items()}))

    for temperature in (cold - APART, warm + APART):
        if COLDEST < temperature < HOTTEST:
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


def _apart(here: Problem, there: Problem, truth: Problem, true: Fit, other: Fit) -> dict[str, float]:
    """Chi-square by which `other` would miss new data that follow `true`, once refitted to old and new data together.

    Of each test's new data alone, and of `ALL`. here, there: the old and the new data as `other` sees them. truth: the new data as
    `true` sees them.
    """
    made = truth.evaluate(true.values, true.effects)
    claimed = there.evaluate(other.values, other.effects)
    columns = [other.order.index(name) for name in other.free]
    new_columns = claimed.columns[:, [claimed.order.index(name) for name in other.free]]
    old = here.evaluate(other.values, other.effects).columns[:, columns]
    difference = claimed.residual - made.residual
    if not (np.isfinite(old).all() and np.isfinite(new_columns).all() and np.isfinite(difference).all()):
        return dict.fromkeys((*there.tests, ALL), 0.0)
    rows = {name: np.zeros(len(difference), dtype=bool) for name in (*there.tests, ALL)}
    for (name, _), own in there.rows().items():
        rows[name][own] = rows[ALL][own] = True  # not the priors, which no new data bring
    apart = {}
    for name, own in rows.items():
        left = Projection.beside(np.concatenate([old, new_columns[own]]))(
            np.append(np.zeros(len(old)), difference[own])
        )
        apart[name] = float(left @ left)
    return apart
