"""Refit the chosen effects to all rows, settle their rivals, test what is left, and judge the model on held-out rows.

Two judgements use rows that took no part in the choice: how far the gap closes there, and how far it would with another effect
in the named one's place (the exchange test). While a misfit of unknown cause remains, effects that close too little of the gap
are dropped again.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.fitting.library import asks_for_more, stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import misfit_scale
from thermohyd.side_by_side import by_name

from .case import LEVEL_OF_ALL_ROWS, Case, Progress
from .confirmation import PROVEN, Confirmation, confirmation, fit_of_rows_left, strength, unproven
from .held_out import Split
from .left_over import LackOfFit, misfit_left, smooth_block
from .result import MOST_USUAL, HeldOut, Suspect
from .rivals import Rival, Rivals, all_rivals, settle_rivals, with_edges_exchanged
from .search import Selection, believable, fits_without, search, times_usual


SEED = 20110913


def held_out_result(
    whole: Problem,
    final_whole: Problem,
    split: Split,
    base: Fit,
    final: Fit,
    exchanged: dict[str, Fit],
    what: str,
) -> HeldOut:
    """Judge fits of the other rows on the rows kept back. final_whole: the problem with the terms that `final` learned."""
    before, after = mean_square(whole, base, split), mean_square(final_whole, final, split)
    rows = int(split.held.sum())
    exchange = {name: closed(before, mean_square(whole, fit, split), rows) for name, fit in exchanged.items()}
    return HeldOut(
        rows=rows,
        what=what,
        before=max(before - 1.0, 0.0),
        after=max(after - 1.0, 0.0),
        reduced_chi2_before=before,
        reduced_chi2_after=after,
        gap_closed=closed(before, after, rows),
        exchange=exchange,
    )


def mean_square(whole: Problem, fit: Fit, split: Split) -> float:
    """Mean squared whitened misfit of the rows kept back: 1 where a model is right."""
    judged = whole.evaluate(fit.values, fit.effects)
    return float(np.mean(judged.residual[: len(split.held)][split.held] ** 2))


def closed(before: float, after: float, rows: int = 0, least: float | None = None) -> float:
    """Share of the excess over noise that is gone; 0 where there was none.

    rows: of these means. Where they fall beyond chance (as in a proof) to less than 1, what is left is the noise: one that was stated, or
    estimated, a few per cent too large would hide any small gap. least: what the model leaves whose part `after` is of, if that is less.
    """
    least = after if least is None else least
    noise = min(1.0, least) if (before - least) * rows > PROVEN else 1.0
    gap = before - noise
    return float(np.clip((before - after) / gap, -1.0, 1.0)) if gap > 0.0 else 0.0


def exchange_fits(
    problem: Problem,
    final: Fit,
    ranked: list[str],
    spared: set[str],
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Fit]:
    """Refits with the runner-up, and with an effect drawn by lot, in the place of the first named effect.

    ranked: candidates, the best first. spared: the named ones and their equals.
    """
    if not final.physics:
        return {}
    # None whose program nobody else has asked for.
    rest = [n for n in ranked if n not in spared and (not stores(n) or asks_for_more(final.effects))]
    chosen = rest[:1]
    if len(rest) > 2:
        chosen.append(str(np.random.default_rng(SEED).permutation(rest[1:])[0]))
    first = final.physics[0]
    others = tuple(name for name in final.effects if name != first)
    say("exchange test")
    return by_name(lambda name: problem.fit((*others, name), {**final.values, first: 0.0}), chosen)


# Far below the level of the search: the test trusts a correlation of the noise that was itself estimated.
LEVEL_OF_LEFT_OVER = 1e-5
# What all of them must close together: of the whole gap, or of one channel's. Two that pull against each other close little.
TOGETHER, TOGETHER_IN_A_CHANNEL, ON_HELD_OUT = 0.25, 0.5, 0.1
# What an effect must close to be named while a misfit of unknown cause remains: a share of the whole gap, of the gap that
# is left without it, or of one channel's gap.
OF_THE_GAP, OF_WHAT_IS_LEFT, OF_A_CHANNEL = 0.1, 0.1, 0.2
A_GAP = 0.2  # reduced chi-square beyond 1 from which a channel has a gap to speak of
# A reduced chi-square beyond this, and beyond chance, is a misfit even where it is not smooth: noise that is 4 % larger than stated
# is none.
MISFIT, MISFIT_SCORE = 1.08, 5.0


def relative_closure(problem: Problem, base: Fit, without: Fit, fit: Fit) -> float:
    """Share of the gap that an effect closes, over the least share for which it may be named: 1 or more where it may.

    Of the whole gap, of what is left without the effect, or of what one channel shows, whichever is best.

    One channel with little noise has most of the chi-square, but a gap in another is a gap as well.
    """
    loss, count = without.chi2 - fit.chi2, len(base.residual)
    closure = 0.0
    for gap, share in ((base.chi2 - count, OF_THE_GAP), (without.chi2 - count, OF_WHAT_IS_LEFT)):
        if gap > 0.0:
            closure = max(closure, loss / gap / share)
    shares = _channel_shares(problem, base, without, fit)
    return max([closure, *(share / OF_A_CHANNEL for share in shares)])


def _enough_together(problem: Problem, base: Fit, fit: Fit) -> bool:
    gap = base.chi2 - len(base.residual)
    if gap > 0.0 and (base.chi2 - fit.chi2) / gap >= TOGETHER:
        return True
    return max(_channel_shares(problem, base, base, fit), default=0.0) >= TOGETHER_IN_A_CHANNEL


def _holds_up(problem: Problem, base: Fit, fit: Fit, split: Split) -> bool:
    """Whether the effects, fitted to the other rows, close anything of the gap on the rows held out."""
    chosen = problem.with_rows(~split.held)
    before = mean_square(problem, chosen.fit(start=base.values), split)
    return closed(before, mean_square(problem, fit_of_rows_left(chosen, fit.effects, fit.values), split)) > ON_HELD_OUT


def _channel_shares(problem: Problem, base: Fit, without: Fit, fit: Fit) -> list[float]:
    """Of each channel with a gap to speak of: the share of it that opens again in `without`."""
    square = lambda f, rows: float(np.sum(f.residual[rows] ** 2))
    shares = []
    for rows in problem.rows().values():
        count = rows.stop - rows.start
        gap = square(base, rows) - count
        if gap > A_GAP * count:
            shares.append((square(without, rows) - square(fit, rows)) / gap)
    return shares


HOPELESS = 0.5  # times the least share: an equal in its place would have to close twice as much, and so is not asked


def without_weak(
    problem: Problem,
    base: Fit,
    fit: Fit,
    block: np.ndarray,
    least: float,
    without: dict[str, Fit] | None = None,
    keep: int = 0,
) -> tuple[Fit, LackOfFit]:
    """The model without effects that close too little of a misfit that remains, the weakest first, and what smooth curves find then.

    Beside a misfit of unknown cause small gains are found everywhere. least: `relative_closure` of what may stay. without: fits
    without each effect, where they are known. keep: so many effects stay in any case.
    """
    left = misfit_left(problem, fit, block)
    while left.p_value < LEVEL_OF_LEFT_OVER and len(fit.effects) > keep:
        without = fits_without(problem, fit, fit.effects) if without is None else without
        closures = {name: relative_closure(problem, base, without[name], fit) for name in fit.effects}
        weakest = min(closures, key=lambda name: closures[name])
        if closures[weakest] >= least:
            break
        fit = problem.fit(without[weakest].effects, without[weakest].values, hop_basins=True)
        left, without = misfit_left(problem, fit, block), None
    return fit, left


def proven(
    case: Case, fit: Fit, rivals: dict[str, Rivals], split: Split, scale: Callable[[Fit], float]
) -> tuple[Fit, dict[str, Rivals], Confirmation | None, tuple[Suspect, ...], tuple[Rival, ...]]:
    """The model without effects that do not predict what they were not fitted to, or that nobody would believe in such an amount:
    the fit, its rivals, the proof, what went, and the models with it or with a rival of it, if anybody would believe them."""
    problem, suspects, doubted = case.problem, [], []
    without = {name: rivals[name].without for name in fit.physics}
    proof: Confirmation | None = None
    while fit.physics:
        alone = len(fit.physics) == 1
        bare = without[fit.physics[0]] if alone else problem.fit(fit.faults, {n: fit.values[n] for n in fit.order})
        proof = confirmation(problem, fit, bare, without, scale(fit), split.held)
        times = times_usual(fit)
        gone = unproven(proof, fit.physics) or next((n for n in fit.physics if times[n] > MOST_USUAL), None)
        if gone is None:
            break
        lost = strength(fit, without[gone], scale(fit))
        there = proof.held_out.get(gone)
        suspects.append(
            Suspect(gone, fit.values[gone], effect_info(gone).unit, proof.each[gone], times[gone], lost, held_out=there)
        )
        alike = rivals[gone].alike if not doubted else ()  # later ones were never beside the model that is left
        doubted += [replace(r, instead_of="") for r in (Rival(gone, "", fit, 0.0), *alike) if believable(r.fit)]
        fit = problem.fit(without[gone].effects, without[gone].values, hop_basins=True)
        without, proof = fits_without(problem, fit, fit.effects), None
    if suspects:
        rivals = all_rivals(problem, fit, case.steps, scale(fit), case.freedom)
    more = lambda r: replace(r, chi2_more=(r.fit.chi2 - fit.chi2) / scale(fit))
    return fit, rivals, proof, tuple(suspects), tuple(map(more, doubted))


def p_values(fit: Fit, rivals: dict[str, Rivals], proof: Confirmation | None) -> dict[str, float]:
    """{effect or fault: p-value}, never below what rows left out prove."""
    proven_to = lambda name: proof.p_value(name) if proof is not None and name in proof.each else 0.0
    return {name: max(rivals[name].p_value, proven_to(name)) for name in fit.effects}


def _nearly_found(problem: Problem, fit: Fit, whole: Selection, known: Iterable[str]) -> tuple[Rival, ...]:
    """The models with an effect that the search was nearly beyond chance to miss, for error bars: chance is no proof of its absence.

    They weigh as much as what is missing to the critical value lets them: at that value as much as the model without.
    """
    others = {*fit.effects, *known}
    names = [name for name in whole.nearly if name not in others]
    asked = by_name(lambda name: problem.fit((*fit.effects, name), fit.values), names)
    return tuple(Rival(name, "", more, whole.nearly[name]) for name, more in asked.items() if believable(more))


def scattered(case: Case, fit: Fit) -> bool:
    """Whether several single runs (or conditions of one test) ask for a fault each: that is a misfit which nothing explains."""
    faults = [case.problem.faults[name] for name in fit.faults]
    return sum(bool(fault.test and fault.place) for fault in faults) > 1


@dataclass(frozen=True)
class FinalModel:
    """The model that a diagnosis ends with, fitted to all rows, and what speaks for and against it.

    excess: chi-square of the ideal valve beyond noise. scale: reduced chi-square of `fit`, at least 1.
    left: what smooth curves still find beside `fit`. disagrees: a misfit beyond noise remains.
    seen_apart: every effect was found without the rows held out. proof: how the effects do where they were not fitted; None without
    any. suspects: what the search found and that did not prove itself, taken out again. doubted: the models with it, and with what
    the search nearly found, for error bars.
    complete: see `Selection`.
    terms: typed terms, where names were asked beside them (`stand_ins`); None where they were not. told: the terms beside other names.
    """

    base: Fit  # the ideal valve, in the deepest valley that was seen
    fit: Fit
    rivals: dict[str, Rivals]
    p_values: dict[str, float]
    left: LackOfFit
    excess: float
    scale: float
    disagrees: bool
    seen_apart: bool
    proof: Confirmation | None = None
    suspects: tuple[Suspect, ...] = ()
    doubted: tuple[Rival, ...] = ()
    complete: bool = True
    terms: tuple[Any, ...] | None = None  # `typed_terms.Found`, whose module knows this one
    told: Mapping[tuple[str, ...], tuple[Any, ...]] = field(default_factory=dict)

    def gap_closed(self, without: Fit) -> float:
        """Share of the gap that opens again in the model `without` something."""
        return self.share(without, self.fit)

    def share(self, without: Fit, fit: Fit) -> float:
        """Share of the gap that `fit` closes and `without` does not, 0 to 1."""
        loss = without.chi2 - fit.chi2
        return float(np.clip(loss / max(self.excess, loss, 1e-300), 0.0, 1.0))


def still_disagrees(case: Case, fit: Fit, left: LackOfFit, suspects: Iterable[Suspect], *, complete: bool) -> bool:
    """Whether a misfit beyond noise remains beside `fit`, or a doubt that counts as one."""
    count = len(fit.residual) - len(case.problem.plans)
    scale = misfit_scale(case.problem, fit)
    known = all(n.known for n in case.noise.values())
    # A reduced chi-square scatters by chance, and by what the noise itself is known to.
    scatter = np.sqrt(2.0 / max(count - len(case.base.free), 1) + 2.0 / case.freedom.of_all)
    rough = known and scale > MISFIT and scale - 1.0 > MISFIT_SCORE * scatter
    # Beside effects that are proven a suspect is a doubt; alone it is a misfit that nothing explains, unless it is so weak that
    # neither the size of the misfit nor a smooth curve shows one without it.
    return bool(
        left.p_value < LEVEL_OF_LEFT_OVER
        or rough
        or (any(not suspect.hint for suspect in suspects) and not fit.physics)
        or scattered(case, fit)
        or not complete
    )


def final_model(case: Case, selection: Selection, split: Split, say: Progress = lambda _: None) -> FinalModel:
    """Refit what the search found to all rows, ask all rows for more, settle rivals, test what is left.

    The rows held out have a say only where a misfit remains: effects that close nothing of it there are not named.
    """
    problem, base = case.problem, case.base
    say("refitting with all rows")
    begin = problem.fit(selection.effects, selection.final.values) if selection.effects else None
    whole = search(
        problem,
        base,
        case.steps,
        begin=begin,
        level=LEVEL_OF_ALL_ROWS,
        freedom=case.freedom,
        say=say,
    )
    rows = len(base.residual) - len(problem.plans)
    degrees_of_freedom = max(rows - len(base.free), 1)
    scale = lambda fit: max(fit.chi2 / max(rows - len(fit.free), 1), 1.0)
    block = smooth_block(problem, len(base.residual))
    fit, _ = without_weak(problem, base, whole.final, block, HOPELESS, keep=1)
    fit, rivals = settle_rivals(problem, fit, case.steps, scale=scale(fit), freedom=case.freedom)

    # The way back from a model that fits may lead to a better ideal valve than any first search found.
    base = min([base, *(r.without for r in rivals.values() if not r.without.effects)], key=lambda f: f.chi2)
    say("looking at what is left")
    excess = base.chi2 - degrees_of_freedom
    settled, without = fit, {name: rival.without for name, rival in rivals.items()}
    fit, left = without_weak(problem, base, fit, block, 1.0, without)
    dropped = fit is not settled
    misfit = left.p_value < LEVEL_OF_LEFT_OVER and bool(fit.effects)
    if misfit and not (_enough_together(problem, base, fit) and _holds_up(problem, base, fit, split)):
        fit, dropped = base, True
    if dropped:
        fit, rivals = settle_rivals(problem, fit, case.steps, scale=scale(fit), freedom=case.freedom)
        left = misfit_left(problem, fit, block)
    fit, rivals, proof, suspects, doubted = proven(case, fit, rivals, split, scale)
    if suspects:
        left = misfit_left(problem, fit, block)
    rivals = with_edges_exchanged(problem, fit, rivals, scale(fit))
    disagrees = still_disagrees(case, fit, left, suspects, complete=whole.complete)
    if not disagrees:  # beside a misfit nearly everything is nearly found
        doubted += _nearly_found(problem, fit, whole, (r.name for r in doubted))
    return FinalModel(
        base=base,
        fit=fit,
        rivals=rivals,
        p_values=p_values(fit, rivals, proof),
        left=left,
        excess=excess,
        scale=scale(fit),
        disagrees=disagrees,
        seen_apart=len(fit.effects) <= len(selection.effects),
        proof=proof,
        suspects=suspects,
        doubted=doubted,
        complete=whole.complete,
    )
