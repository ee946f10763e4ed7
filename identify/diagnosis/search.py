"""Choose the missing effects by forward selection: score tests over the library, then refits of the leading singles and pairs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice

import numpy as np
from scipy.optimize import nnls
from scipy.special import chdtrc, fdtrc

from thermohyd.effects.library import effect_info
from thermohyd.identify.fitting.bench_faults import info_of, is_fault
from thermohyd.identify.fitting.library import expensive_to_compile, stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.trimmed import FAR
from thermohyd.side_by_side import by_name, each

from .max_t import NoiseFreedom, normal_score
from .result import MOST_USUAL
from .screening import Screen, Signature, screen
from .screening_faults import p_of_fault, screen_of_faults
from .stored_oil import RELATIVE_REACH, could_explain, within_reach


LEVEL = 0.005  # probability of naming anything, at each step of the search, in a record that needs nothing more
MOST_EFFECTS = 6  # of one record: what is still left then is told as left over
SINGLES, PAIRS, FAULTS = 10, 6, 4  # refits of each step
BY_GAIN = 4  # more of them, of those that would close as much as any
EXPLAINED = 1.1  # reduced chi-square of a refit that leaves nothing to look for elsewhere
MOST_HOPPING = 3  # refits that go on by basin hopping
HOPPING_REACH = 2.0  # times the lowest chi-square: hopping moved none of a real valve's refits by a tenth of that
# Evaluations of the model after which a search adds nothing more, each counted for what it takes (`relative_cost`): of static
# tests so many, or fewer where these have many readings, and in motion. Four effects take a few hundred: an answer without the
# last ones beats none.
MOST_EVALUATIONS, LEAST_EVALUATIONS, MOST_IN_MOTION = 4000, 750, 1500
MOST_READINGS = 8_000_000  # evaluated
# Steps of a refit that only has to show which candidate is worth more; each about halves the way to its optimum at worst.
GLANCE = 15
# Chi-square below the critical value of a score within which an effect is asked by a refit, and may weigh in error bars: a likelihood
# ratio of 20, as between rivals. Refits of so few at most, for cost alone.
NEARLY, MOST_NEARLY = 6.0, 3
# A pair must beat the best single effect by this much chi-square beyond the search's own critical value.
PAIR_PENALTY = 4.0
# Chi-square per squared e-fold beyond the largest amount that is usual: a prior whose standard deviation there is half an e-fold.
BEYOND_TYPICAL = 4.0


@dataclass(frozen=True)
class Step:
    """One round of the search: what it looked at and what it added."""

    screen: Screen
    singles: dict[str, Fit]
    added: tuple[str, ...]
    p_value: float


@dataclass(frozen=True)
class Selection:
    """The effects that a forward selection added, in that order. `base`: the ideal valve; `final`: with these effects.

    complete: False where the search had taken all its evaluations before it was at its end. nearly: effects that `final` lacks,
    which it was nearly beyond chance to miss, each with chi-square that its refit fell short by.
    """

    base: Fit
    final: Fit
    effects: tuple[str, ...]
    p_values: dict[str, float]
    steps: tuple[Step, ...]
    complete: bool = True
    nearly: dict[str, float] = field(default_factory=dict)


def times_usual(fit: Fit) -> dict[str, float]:
    """The amount of each effect over the largest that is usual."""
    return {name: abs(fit.values[name]) / info_of(name).typical[1] for name in fit.effects}


def implausible(fit: Fit) -> float:
    """Penalty in chi-square for amounts beyond what is usual: it decides between effects that fit alike."""
    return sum(BEYOND_TYPICAL * float(np.log(times)) ** 2 for times in times_usual(fit).values() if times > 1.0)


def merit(fit: Fit) -> float:
    """What the search minimises: chi-square, the penalty of implausible amounts, and what faults of the bench must gain."""
    return fit.chi2 + penalty(fit) if np.isfinite(fit.chi2) else np.inf


def penalty(fit: Fit) -> float:
    """What `merit` adds to the chi-square."""
    return implausible(fit) + fit.allowance


def believable(fit: Fit) -> bool:
    """Whether no effect has an amount that it cannot have."""
    return max((times for name, times in times_usual(fit).items() if name in fit.physics), default=0.0) <= MOST_USUAL


def gains_enough(current: Fit, fit: Fit, critical: float) -> bool:
    """Whether `fit` does so much better than `current` that what it adds may be added."""
    return merit(current) - merit(fit) >= critical**2 * max(0.25, needed_beside(fit))


def needed_beside(fit: Fit) -> float:
    """Gain that an effect must bring, in critical values, beside the misfit that `fit` leaves.

    What nothing explains is systematic: any effect closes a bit of it, the more the larger it is.
    """
    degrees_of_freedom = max(int(fit.used.sum()) - len(fit.free), 1)
    return 2.0 * (fit.chi2 / degrees_of_freedom - 1.0)


def search(
    problem: Problem,
    base: Fit,
    steps_of: dict[str, np.ndarray],
    *,
    begin: Fit | None = None,
    level: float = LEVEL,
    most: int = MOST_EFFECTS,
    freedom: NoiseFreedom | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Selection:
    """Add effects to the ideal valve `base` while the strongest score is beyond what chance gives the whole library.

    steps_of: finite-step signatures (see `screening`). freedom: of the noise, None where it is stated.
    begin: a fit of effects to start from instead of none.
    """
    names = problem.library.names
    current, chosen, p_values, steps = begin or base, begin.effects if begin else (), {}, []
    seen = {frozenset(chosen)}
    complete, enough = True, budget(problem)
    while True:
        gains: dict[str, float] = {}
        nearly: dict[str, float] = {}
        screened = problem.with_all_columns(current)
        candidates = [name for name in names if name not in chosen]
        scores = screen(screened, candidates, steps_of, level=level, freedom=freedom)
        ranked = scores.ranked
        pairs = best_pairs(scores, ranked)
        faults = screen_of_faults(problem, current, level=level, freedom=freedom)
        p_single = scores.p_value(ranked[0]) if ranked else 1.0
        p_pair = _p_of_pair(*pairs[0], len(ranked)) if pairs else 1.0
        p_fault = p_of_fault(faults)
        p_step = min(p_single, p_pair, p_fault)
        if p_step > level and len(chosen) < most and problem.work.cost < enough:
            gains = _gains_of_refits(problem, current, chosen, scores, ranked)
            p_single = min([p_single, *(_p_of_gain(scores, name, gain) for name, gain in gains.items())])
            p_step = min(p_single, p_step)
            short = {name: scores.critical**2 - gain for name, gain in gains.items()}
            nearly = {name: max(by, 0.0) for name, by in short.items() if by < NEARLY} if p_step > level else {}
        if len(chosen) >= most or p_step > level:
            steps.append(Step(scores, {}, (), p_step))
            break
        if problem.work.cost >= enough:
            steps.append(Step(scores, {}, (), p_step))
            complete = False
            break
        say(f"effect {len(chosen) + 1}: refitting the leading candidates")
        singles = _singles(problem, current, chosen, scores, ranked)
        singles |= _faults(problem, current, chosen, faults)
        best = min(singles.values(), key=merit)
        stored = any(stores(name) for name in (*chosen, *singles))
        # In motion, where a refit takes seconds, only where one effect leaves something. Two that are the truth take the place of
        # one that resembles them later (`rivals`).
        leaves = best.chi2 > EXPLAINED * max(int(best.used.sum()), 1)
        asked = pairs if leaves or not problem.in_motion else []
        threshold = scores.critical**2 + PAIR_PENALTY
        double = _best_pair(problem, current, chosen, scores, asked, best, stored, threshold)
        if double is not None and merit(double) < merit(best) - threshold and len(chosen) + 2 <= most:
            best = double
        added = tuple(name for name in best.effects if name not in chosen)
        steps.append(Step(scores, singles, added, p_step))
        if not gains_enough(current, best, scores.critical):
            steps[-1] = Step(scores, singles, (), p_step)
            break
        chosen += added
        for name in added:
            if is_fault(name):
                signature = None if faults is None else faults.best(name)
                p_values[name] = p_fault if signature is None or faults is None else faults.p_value(signature)
                continue
            signature = scores.best(name)
            p_alone = p_single if signature is None else scores.p_value(signature)
            p_values[name] = min(p_alone, p_pair, _p_of_gain(scores, name, gains[name]) if name in gains else 1.0)
        current = problem.fit(chosen, best.values, hop_basins=True)
        if current.chi2 > FAR * np.sum(current.used):
            current = problem.unbent(current)
        current, chosen = prune(problem, current, chosen, scores.critical**2 * max(1.0, needed_beside(current)))
        if frozenset(chosen) in seen:  # what was added replaced what was pruned before: going round in a circle
            break
        seen.add(frozenset(chosen))
    kept = {name: p_values[name] for name in chosen if name in p_values}
    nearly = {name: by for name, by in nearly.items() if name not in chosen}
    return Selection(base, current, chosen, kept, tuple(steps), complete, nearly)


def _gains_of_refits(
    problem: Problem, current: Fit, chosen: tuple[str, ...], scores: Screen, ranked: list[Signature]
) -> dict[str, float]:
    """Chi-square that a refit with each candidate gains whose score is nearly enough: the likelihood-ratio test beside Rao's.

    Both agree where the model is straight between both fits. Where a parameter has gone far to make up for the effect (edge radius for
    the wear of some edges, where the score saw 13 of a chi-square of 32), the score says less than there is.
    """
    near = [s for s in ranked if s.gain > scores.critical**2 - NEARLY]
    near = [s for s in near if not stores(s.name) and _is_cheap(s.name, chosen)]
    fits = _glances(problem, current, chosen, near[:MOST_NEARLY])
    return {s.name: max(merit(current) - merit(fits[s.name]), s.gain) for s in near[:MOST_NEARLY]}


def _glances(problem: Problem, current: Fit, chosen: tuple[str, ...], asked: Sequence[Signature]) -> dict[str, Fit]:
    """Short refits with each of these beside the effects chosen so far, from `current` and its estimate on paper.

    One that ends worse than without it was led astray, by parameters that were bent to what is missing: it begins again from the nominal
    valve. Not in motion, where a refit takes seconds.
    """
    estimates = {s.name: s.estimate for s in asked}

    def ask(name: str) -> Fit:
        fit = problem.fit((*chosen, name), {**current.values, name: estimates[name]}, most_steps=GLANCE)
        if fit.chi2 <= current.chi2 or is_fault(name) or problem.in_motion:
            return fit
        return min(fit, _from_nominal(problem, current, chosen, name), key=merit)

    return by_name(ask, estimates)


def _from_nominal(problem: Problem, current: Fit, chosen: tuple[str, ...], name: str) -> Fit:
    """A short refit with `name` from the nominal valve, where the null and the effects chosen so far are those of `current`."""
    kept = {n: current.values[n] for n in (*chosen, "null_bias") if n in current.values}
    return problem.fit((*chosen, name), {**kept, name: effect_info(name).scale}, most_steps=GLANCE)


def _is_cheap(name: str, chosen: tuple[str, ...]) -> bool:
    return not expensive_to_compile((*chosen, name)) or expensive_to_compile(chosen)


def _p_of_gain(scores: Screen, name: str, gain: float) -> float:
    """The p-value of a chi-square gained, corrected for the size of the library."""
    signature = scores.best(name)
    assert signature is not None
    strength = normal_score(float(np.sqrt(gain)), signature.freedom)
    return scores.law.p_value(strength, two_sided=not signature.one_sided)


def budget(problem: Problem) -> float:
    """Evaluations of the model that a diagnosis of so many readings may take before its search adds nothing and exchanges nothing more."""
    if problem.in_motion:
        return MOST_IN_MOTION
    rows = max(place.stop for place in problem.rows().values())
    return min(MOST_EVALUATIONS, max(LEAST_EVALUATIONS, MOST_READINGS / rows))


def _singles(
    problem: Problem,
    current: Fit,
    chosen: tuple[str, ...],
    scores: Screen,
    ranked: list[Signature],
) -> dict[str, Fit]:
    """Refits of the leading candidates, each beside the effects chosen so far.

    A model that misses by far has bent its parameters to the misfit: scores beside it say little, and refits that start
    from it end in local minima. Then every candidate is tried, from the nominal valve too, and the best ones go on by basin hopping.
    """
    dear = lambda name: not _is_cheap(name, chosen)
    glances = lambda asked: _glances(problem, current, chosen, asked)
    lead = leading(ranked)
    fits = glances([s for s in lead if not dear(s.name) and (any(map(stores, chosen)) or not stores(s.name))])
    # Programs of their own, and oil stored at the ports, where they could explain as much as the best of the others, and enough to
    # be added at all.
    gain = current.chi2 - min((fit.chi2 for fit in fits.values()), default=current.chi2)
    needed = (1.0 - RELATIVE_REACH) * scores.critical**2 * max(1.0, needed_beside(current))
    least = lambda s: max(within_reach(gain), needed if dear(s.name) else -np.inf)
    fits |= glances([s for s in lead if dear(s.name) and not stores(s.name) and s.gain >= least(s)])
    left = [s for s in ranked if stores(s.name) and s.name not in fits]
    asked = could_explain(problem, current, scores, least(left[0])) if left else []
    fits |= glances([s for s in left if s.name in asked])
    rows = max(int(current.used.sum()), 1)
    explained = any(fit.chi2 <= EXPLAINED * rows for fit in fits.values())
    if chosen or explained or current.chi2 <= FAR * rows:
        return fits
    every = dict.fromkeys([*fits, *problem.library.names])
    others = [n for n in every if not (n in chosen or dear(n) or (stores(n) and n not in fits))]
    nominal = lambda name: _from_nominal(problem, current, chosen, name)
    for name, fit in by_name(nominal, others).items():
        if name not in fits or merit(fit) < merit(fits[name]):
            fits[name] = fit
    lowest = min(map(merit, fits.values()))
    near = (name for name in sorted(fits, key=lambda n: merit(fits[n])) if merit(fits[name]) <= HOPPING_REACH * lowest)
    hop = lambda name: problem.fit(fits[name].effects, fits[name].values, hop_basins=True)
    return fits | by_name(hop, islice(near, MOST_HOPPING))


def _faults(problem: Problem, current: Fit, chosen: tuple[str, ...], scores: Screen | None) -> dict[str, Fit]:
    """Refits of the leading faults of the bench that are beyond what chance gives all of them."""
    if scores is None:
        return {}
    lead = [s for s in leading(scores.ranked)[:FAULTS] if s.strength > scores.critical]
    return _glances(problem, current, chosen, lead)


def leading(ranked: list[Signature]) -> list[Signature]:
    """The candidates worth a refit: linear scores may rank strong effects wrongly, not arbitrarily.

    Those that would close as much as any are asked as well: where the noise along them is known from few readings (a channel that the
    log rounds), the largest gain of all can be the nineteenth by its strength.
    """
    strong = [s for s in ranked[:SINGLES] if s.strength > max(1.0, 0.2 * ranked[0].strength)]
    most = max((s.gain for s in ranked), default=0.0)
    asked = {s.name for s in strong}
    close = sorted((s for s in ranked if s.name not in asked and s.gain > 0.5 * most), key=lambda s: -s.gain)
    return [*strong, *(s for s in close[:BY_GAIN] if s.strength > 1.0)] or ranked[:1]


def best_pairs(scores: Screen, ranked: list[Signature]) -> list[tuple[tuple[Signature, Signature], float]]:
    """Pairs of effects by the chi-square that both together take off, linearly and with their signs; best first."""
    pairs = []
    for a, b in combinations(ranked, 2):
        gain = pair_gain(a, b, scores.residual)
        if gain > max(a.gain, b.gain) + PAIR_PENALTY:
            pairs.append(((a, b), gain))
    return sorted(pairs, key=lambda pair: -pair[1])


def pair_gain(a: Signature, b: Signature, residual: np.ndarray) -> float:
    """Fall of chi-square by two directions, amounts of known sign not below 0."""
    columns = [a.direction, b.direction]
    columns += [-s.direction for s in (a, b) if not s.one_sided]
    _, norm = nnls(np.stack(columns, axis=1), -residual)
    return float(residual @ residual - norm**2)


def _p_of_pair(pair: tuple[Signature, Signature], gain: float, candidates: int) -> float:
    """By Bonferroni's bound over all pairs; where the noise was estimated gain/2 follows Fisher's F, not chi-square."""
    freedom = min(s.freedom for s in pair)
    p = float(chdtrc(2, gain)) if np.isinf(freedom) else float(fdtrc(2.0, freedom, gain / 2.0))
    return min(1.0, candidates * (candidates - 1) / 2.0 * p)


def _best_pair(
    problem: Problem,
    current: Fit,
    chosen: tuple[str, ...],
    scores: Screen,
    pairs: list[tuple[tuple[Signature, Signature], float]],
    best: Fit,
    stored: bool,
    threshold: float,
) -> Fit | None:
    """The best nonlinear refit among the leading pairs; partners of the best single effect are tried too.

    stored: whether oil stored at the ports was refitted already. threshold: by how much a pair must do better than `best`.
    """
    lead = next((name for name in best.effects if name not in chosen), None)
    too_expensive = lambda pair: (
        (expensive_to_compile((*chosen, pair[0][0].name, pair[0][1].name)) and not expensive_to_compile(chosen))
        or (not stored and any(stores(s.name) for s in pair[0]))
    )
    cheap = [pair for pair in pairs if not too_expensive(pair) or (pair is pairs[0] and not _nearly(pairs))]
    partners = [pair for pair in cheap if lead in (pair[0][0].name, pair[0][1].name)][:3]
    chosen_pairs = {(a.name, b.name): (a, b) for (a, b), _ in [*cheap[:PAIRS], *partners]}

    def ask(pair: tuple[Signature, Signature]) -> Fit:
        a, b = pair
        start = {**current.values, a.name: a.estimate, b.name: b.estimate}
        if lead in (a.name, b.name):  # downhill from the best single effect, which is no linear estimate any more
            start = dict(best.values)
        return problem.fit((*chosen, a.name, b.name), start, most_steps=GLANCE, goal=merit(best) - threshold)

    return min(each(ask, chosen_pairs.values()), key=merit, default=None)


def _nearly(pairs: list[tuple[tuple[Signature, Signature], float]]) -> bool:
    """Whether a second pair explains about as much as the first, so that the first may be left out."""
    return len(pairs) > 1 and pairs[1][1] > 0.95 * pairs[0][1]


def fits_without(problem: Problem, fit: Fit, names: Iterable[str]) -> dict[str, Fit]:
    """{effect or fault: the fit without it}."""
    return by_name(lambda name: problem.fit([n for n in fit.effects if n != name], fit.values), names)


# An effect whose loss costs so many times the threshold by the linear estimate is not asked by a refit.
FAR_FROM_PRUNED = 10.0


def prune(problem: Problem, fit: Fit, chosen: tuple[str, ...], threshold: float) -> tuple[Fit, tuple[str, ...]]:
    """Drop effects whose loss costs less chi-square than naming one must gain: later ones may have replaced them."""
    while chosen:
        costs = fit.linear_losses()
        in_doubt = [name for name in chosen if not costs.get(name, 0.0) > FAR_FROM_PRUNED * threshold]
        without = fits_without(problem, fit, in_doubt)
        weakest = min(in_doubt, key=lambda name: without[name].chi2, default=None)
        if weakest is None or without[weakest].chi2 - fit.chi2 > threshold:
            break
        fit, chosen = without[weakest], tuple(n for n in chosen if n != weakest)
    return fit, chosen
