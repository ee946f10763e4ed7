"""Find effects that could stand in a named one's place: refit with each of them, and keep those that do about as well."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.fitting.bench_faults import BenchFault, info_of, is_fault
from thermohyd.identify.fitting.library import asks_for_more, expensive_to_compile, stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.side_by_side import by_name, each

from .max_t import NoiseFreedom, normal_score
from .screening import Screen, Signature, screen
from .screening_faults import SHARE, screen_of_faults
from .search import (
    FAULTS,
    GLANCE,
    LEVEL,
    MOST_EFFECTS,
    NEARLY,
    PAIR_PENALTY,
    best_pairs,
    budget,
    merit,
    needed_beside,
    penalty,
)
from .stored_oil import REACH, could_explain, within_reach


# Chi-square within which two effects explain a record alike: a likelihood ratio of 20.
ALIKE = 6.0
# Correlation of two signatures from which on one is refitted in the place of the other in any case: what is left of ten standard errors
# of the one beside the other, (1 - 0.97^2) 10^2, is then `ALIKE`.
SAME_SHAPE = 0.97
SAME_THING = 0.9999  # likewise of 170 standard errors
MOST_REFITS, MOST_PAIRS, MOST_SWAPS = 8, 3, 3  # what is asked at most: cost alone
BETTER = 0.01  # chi-square: ten times what a refit that is only compared is wrong by (`problem.CLOSE_TO_COMPARE`)
FAR_BEHIND = 5.0 * ALIKE  # chi-square
HALF_WAY = 0.5  # of what the named one gains: an effect that has not come so far at a glance is no rival, and is left where it is


@dataclass(frozen=True)
class Rival:
    """A refit with `name` in the place of `instead_of`; "": beside all, neither proven nor excluded.

    beside: the same with what is missed in the readings' error, where that is what makes it a rival.
    """

    name: str
    instead_of: str
    fit: Fit
    chi2_more: float
    beside: Fit | None = None


@dataclass(frozen=True)
class Rivals:
    """For one named effect: the fit without it, and the refits of what was put in its place, the best first.

    p_value: of the final model with it removed, corrected for the size of the library. two: the fit with two others in its place, where
    these do better by more than chance gives all pairs.
    """

    instead_of: str
    without: Fit
    tried: tuple[Rival, ...]
    p_value: float = 1.0
    two: Fit | None = None

    @property
    def alike(self) -> tuple[Rival, ...]:
        return tuple(r for r in self.tried if r.chi2_more < ALIKE)


def rivals_of(
    problem: Problem,
    final: Fit,
    name: str,
    steps: dict,
    *,
    scale: float = 1.0,
    freedom: NoiseFreedom | None = None,
    hopeless: frozenset[str] = frozenset(),
    pairs: bool = True,
) -> Rivals:
    """Effects that explain what the named one explains, each refitted in its place beside the other effects of `final`.

    scale: of chi-square (1: noise known). freedom: of the noise, for the p-value; None where it is stated. hopeless: effects that
    need not be asked, as a refit beside nearly the same model said. pairs: whether two are asked in its place as well.
    """
    others = tuple(n for n in final.effects if n != name)
    without = problem.fit(others, {**final.values, name: 0.0})
    gain = without.chi2 - final.chi2
    candidates = [n for n in problem.library.names if n not in final.effects]
    own = [] if is_fault(name) else [name]
    scores = screen(problem.with_all_columns(without), [*candidates, *own], steps, level=LEVEL)
    faults = screen_of_faults(problem, without, level=LEVEL)
    named = (scores if own or faults is None else faults).best(name)
    ranked = [s for s in scores.ranked if s.name != name]
    within = within_reach(gain, scale)
    twin = lambda s: named is not None and abs(float(s.direction @ named.direction)) > SAME_SHAPE
    # A score is a tangent's, and an effect may bend: a wear of half the radius took seven times what its tangent promised. So what would
    # have been beyond chance by itself is asked too.
    least = min(within, scores.critical**2)
    likely = sorted([s for s in ranked if s.gain > least or twin(s)], key=lambda s: not (twin(s) or s.gain > within))
    if len(likely) < 2:
        likely = [s for s in ranked if not stores(s.name) or asks_for_more(final.effects)][:2]
    dear = not asks_for_more(final.effects) and any(stores(s.name) for s in likely)
    if info_of(name).of_sweeps or dear:
        # What ports store lags and loops as well, in another way at every amount: its score alone does not dismiss it,
        # nor does it ask for the program that fits stored oil.
        asked = could_explain(problem, without, scores, within)
        likely = [s for s in likely if not dear or s.name in asked or not stores(s.name)]
        known = {s.name for s in likely}
        likely += [s for s in ranked if s.name in asked and s.name not in known]
    # Heat beside a coupled effect compiles for long: only where the linear score says that it could be an equal.
    likely = [
        s
        for s in likely
        if not expensive_to_compile((*others, s.name)) or expensive_to_compile(final.effects) or s.gain > gain - ALIKE
    ]
    # A fault whose column is that of a gauge's own error in the library is this error by another name; that of the valve's is a rival, and
    # so is the same fault of another test: of two tests whose zeros differ the readings cannot say which one is off.
    of_the_bench = is_fault(name) or effect_info(name).elsewhere == "bench"
    same_curve = lambda s: named is not None and abs(float(s.direction @ named.direction)) > SAME_THING
    same_place = lambda s: not of_another_test(problem.faults, s.name, name)
    alias = lambda s: s.name == name or (of_the_bench and same_curve(s) and same_place(s))
    at_fault = [s for s in ([] if faults is None else faults.ranked) if not alias(s) and (s.gain > within or twin(s))]

    def ask(s: Signature) -> Rival | None:
        # Further behind than that is no equal, and is not asked from elsewhere (below).
        in_sight = final.chi2 + scale * (REACH + penalty(final))
        start = on_paper = {**without.values, s.name: s.estimate}
        if named is not None and twin(s):  # the same curve by another name: start where the named one ended
            same = final.values[name] * named.size / s.size * float(np.sign(s.direction @ named.direction))
            start = {**final.values, s.name: same}
        fit = problem.fit((*others, s.name), start, most_steps=GLANCE, goal=in_sight)
        if fit.chi2 > without.chi2 and start is not on_paper:  # worse than without it: led astray by that start
            fit = problem.fit((*others, s.name), on_paper, most_steps=GLANCE, goal=in_sight)
        if not fit.converged and fit.chi2 < without.chi2 - HALF_WAY * gain:
            fit = problem.fit((*others, s.name), fit.values, goal=in_sight)
        if 0.5 * ALIKE < _more(fit, final, scale) < REACH:
            fit = problem.fit((*others, s.name), fit.values, hop_basins=True)
        if fit.values[s.name] == 0.0 or s.name in fit.active:
            return None
        more = _more(fit, final, scale)
        if is_fault(s.name) and not of_the_bench and twin(s):
            # What a fault must gain for the many places that it was looked for in is a matter of chance: no chance made it the same curve.
            # It stands beside the effect then, and takes its place only where it has gained that.
            more = min(more, max(more - (fit.allowance - final.allowance), 0.0))
        return Rival(s.name, name, fit, more)

    asked = [s for s in (*likely[:MOST_REFITS], *at_fault[:FAULTS]) if s.name not in hopeless]
    tried = [rival for rival in each(ask, asked) if rival is not None]
    law, share = (scores.law, 1.0) if own or faults is None else (faults.law, SHARE)
    known = np.inf if named is None or freedom is None else freedom.along(named.direction, without.used)
    strength = normal_score(float(np.sqrt(max(gain / scale, 0.0))), known)
    p = law.p_value(strength, two_sided=info_of(name).lower < 0.0)
    two = None if is_fault(name) or not pairs else _two_in_its_place(problem, final, name, without, scores)
    return Rivals(name, without, tuple(sorted(tried, key=lambda r: r.chi2_more)), min(1.0, p / share), two)


def _two_in_its_place(problem: Problem, final: Fit, name: str, without: Fit, scores: Screen) -> Fit | None:
    """The best refit with two effects in the place of a named one, if they do better by what a pair must in the search.

    One effect that resembles two together is found before either, and beside it neither is missed enough to be added: a leak over
    the lands that grows with the square root of the pressure, say, for one in proportion to it and an offset of the flow meter.
    """
    own = scores.best(name)
    if own is None or len(final.effects) >= MOST_EFFECTS:
        return None
    others = without.effects
    needed = (scores.critical**2 + PAIR_PENALTY) * max(1.0, needed_beside(final))
    ready = lambda a, b: (
        (asks_for_more(final.effects) or not (stores(a) or stores(b)))
        and (expensive_to_compile(final.effects) or not expensive_to_compile((*others, a, b)))
    )
    pairs = best_pairs(scores, [s for s in scores.ranked if s.name != name])
    likely = [(a, b) for (a, b), gain in pairs if gain > own.gain + needed - NEARLY and ready(a.name, b.name)]
    ask = lambda pair: problem.fit(
        (*others, *(s.name for s in pair)),
        {**without.values, **{s.name: s.estimate for s in pair}},
        goal=merit(final) - needed,
    )
    best = min(each(ask, likely[:MOST_PAIRS]), key=merit, default=None)
    return best if best is not None and merit(final) - merit(best) > needed else None


def of_another_test(faults: Mapping[str, BenchFault], one: str, other: str) -> bool:
    """Whether both are one kind of fault, in different tests."""
    if not (is_fault(one) and is_fault(other)):
        return False
    first, second = faults[one], faults[other]
    return first.kind == second.kind and bool(first.test and second.test) and first.test != second.test


def mirrors(problem: Problem, final: Fit, scale: float = 1.0) -> tuple[Rival, ...]:
    """The named effects themselves with the other sign, where a parameter that moves with it makes that the same valve: for error bars,
    which one of two valleys is not all of.

    The effect's own caveat says it in words.
    """
    found = []
    for name in final.physics:
        parameter, amount = effect_info(name).mirrored_in, final.values[name]
        if parameter not in final.free or amount == 0.0:
            continue
        start = {**final.values, parameter: final.values[parameter] + amount, name: -amount}
        fit = problem.fit(final.effects, start)
        mirror = Rival(name, name, fit, _more(fit, final, scale))
        if fit.values[name] * amount < 0.0 and mirror.chi2_more < ALIKE:
            found.append(mirror)
    return tuple(found)


def with_edges_exchanged(
    problem: Problem, final: Fit, rivals: Mapping[str, Rivals], scale: float = 1.0
) -> dict[str, Rivals]:
    """The rivals of `final` and, where several of its effects change with supply and return edges, all of them changed together: one
    alone, beside the others as they are, is another valve, and no rival that is asked for itself shows that.
    """
    changed = {name: other for name in final.physics if (other := effect_info(name).exchanged)}
    mirrored = [name for name in final.physics if effect_info(name).mirrored_in in final.free]
    if len(changed) + len(mirrored) < 2 or not changed or set(changed.values()) & set(final.effects):
        return dict(rivals)
    values = {changed.get(name, name): value for name, value in final.values.items() if name not in changed.values()}
    for name in mirrored:
        values |= {effect_info(name).mirrored_in: values[effect_info(name).mirrored_in] + values[name]}
        values |= {name: -values[name]}
    fit = problem.fit([changed.get(name, name) for name in final.effects], values, hop_basins=True)
    more, found = _more(fit, final, scale), dict(rivals)
    for name, other in changed.items():
        if more < ALIKE and fit.values[other] != 0.0 and other not in fit.active:
            tried = (*(r for r in found[name].tried if r.name != other), Rival(other, name, fit, more))
            found[name] = replace(found[name], tried=tuple(sorted(tried, key=lambda r: r.chi2_more)))
    return found


def _more(fit: Fit, final: Fit, scale: float) -> float:
    """Chi-square that `fit` needs more than `final`; what is implausible stays so however large the misfit is."""
    if not np.isfinite(fit.chi2):
        return np.inf
    return (fit.chi2 - final.chi2) / scale + penalty(fit) - penalty(final)


def settle_rivals(
    problem: Problem, final: Fit, steps: dict, *, scale: float = 1.0, freedom: NoiseFreedom | None = None
) -> tuple[Fit, dict[str, Rivals]]:
    """The rivals of every effect of `final`; where one does better on all rows, or two by more than chance, it takes the place and
    all is asked again.

    Among equals the data of all rows decide who is named first; that they are equals is said either way.
    """
    hopeless: dict[str, frozenset[str]] = {}
    # As many evaluations as a search may take; in motion, where each takes long, what that has left.
    enough = budget(problem) + (0.0 if problem.in_motion else problem.work.cost)
    for _ in range(MOST_SWAPS):
        rivals = all_rivals(problem, final, steps, scale, freedom, hopeless, pairs=True)
        tried: list[Rival] = [r for rival in rivals.values() for r in rival.tried]
        best = min(tried, key=lambda r: r.chi2_more, default=None)
        if problem.work.cost >= enough:  # the names as they stand, with what does better among their rivals, beat none
            return final, rivals
        if best is None or best.chi2_more >= -BETTER:
            two = min((r.two for r in rivals.values() if r.two is not None), key=merit, default=None)
            if two is None:
                return final, rivals
            final, hopeless = problem.fit(two.effects, two.values, hop_basins=True), {}
            continue
        # What was further behind than the swap gains will not draw level by it.
        behind = FAR_BEHIND - best.chi2_more
        hopeless = {n: frozenset(r.name for r in rival.tried if r.chi2_more > behind) for n, rival in rivals.items()}
        final = problem.fit(best.fit.effects, best.fit.values, hop_basins=True)
    return final, all_rivals(problem, final, steps, scale, freedom, hopeless)


def all_rivals(
    problem: Problem,
    final: Fit,
    steps: dict,
    scale: float,
    freedom: NoiseFreedom | None = None,
    hopeless: Mapping[str, frozenset[str]] = MappingProxyType({}),
    *,
    pairs: bool = False,
) -> dict[str, Rivals]:
    """`rivals_of` every effect of `final`; hopeless: by the name of that effect."""
    of = lambda name: rivals_of(
        problem, final, name, steps, scale=scale, freedom=freedom, hopeless=hopeless.get(name, frozenset()), pairs=pairs
    )
    return by_name(of, final.effects)
