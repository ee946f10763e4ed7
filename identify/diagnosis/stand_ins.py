"""Do the names only stand in for something that the library lacks? One place of the circuit is asked beside several names.

Two or three effects of the library together can bend a model into what one missing effect does. Where one typed term beside the plain
model explains the readings better than they do, with fewer amounts, they are no finding: the term is told, the names are suspects. Where
names leave a misfit, each has to be of use beside the best term, too; so have faults of the bench, which can stand in as well.
Whatever a misfit is left beside, a name has to earn its place, and a label is not called wrong (`without_unearned`).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.fitting.bench_faults import BenchFault
from thermohyd.identify.fitting.library import expensive_to_compile, stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import misfit_scale
from thermohyd.identify.report.term_words import term_name
from thermohyd.side_by_side import by_name, each

from .case import Case, Progress
from .confirmation import PROVEN, strength
from .final_model import LEVEL_OF_LEFT_OVER, FinalModel, p_values, proven, scattered, still_disagrees
from .found_faults import found as found_fault
from .held_out import Split
from .left_over import misfit_left, smooth_block
from .result import Suspect
from .rivals import all_rivals
from .screening import Signature, screen
from .search import LEVEL, believable, fits_without, gains_enough, merit, pair_gain, times_usual
from .term_fit import PATIENT, FittedTerm, fitted_inside, straightened, usable
from .typed_terms import Found, terms_of


# Several names are always asked; one, or a fault of the bench, only where smooth curves still find something at this level, which is
# one right answer in twenty.
UNCLEAN = 0.05


def without_stand_ins(
    case: Case, model: FinalModel, split: Split, critical: float, say: Progress = lambda _: None
) -> FinalModel:
    """The final model, or one without the names and faults of the bench that are of no use beside a typed term, with the terms.

    Where the names leave a misfit, the best term beside them is asked, too. Of use is what gains as much beside the term, in units of the
    misfit left, as the search asks of an effect. And the term, with what is of use beside it, does better than the names alone by a proof
    (10.6, docs/diagnosis.md section 11.1) in BIC, with what a fault's many places ask, and, where names explain the readings, in
    chi-square: an effect's own place says no more than its name.
    critical: score that chance does not reach in the search.
    """
    fit = model.fit
    if any(stores(name) for name in fit.effects):  # ports that store oil have no terms of their own
        return model
    # In motion every set of names is a program of its own, which takes half a minute to compile.
    if not model.disagrees and not (case.problem.in_motion and fit.effects):
        model = _with_what_no_curve_sees(case, model, split, say)
    unclean = bool(fit.effects) and model.left.p_value < UNCLEAN
    asked = fit.physics or (model.terms and fit.effects) if model.disagrees else len(fit.physics) > 1 or unclean
    if not asked:
        return model
    beside, told = _best_beside(case, model, split, critical, say)
    if model.disagrees:
        model = replace(model, terms=next(iter(told.values())), told=told)
    if beside is None or set(fit.effects) <= set(beside.names) or not _far_better(model, beside):
        return model
    instead = None if case.problem.in_motion else _in_names(case, model, beside, critical)
    if instead is not None:
        renamed = _ended_with(case, model, instead, split)
        if len(renamed.fit.effects) == len(instead.effects):  # each of them proves itself
            left = still_disagrees(case, renamed.fit, renamed.left, renamed.suspects, complete=model.complete)
            return replace(renamed, disagrees=left, seen_apart=False)
    return _with_fewer_names(case, model, split, beside, told, say)


def _with_what_no_curve_sees(case: Case, model: FinalModel, split: Split, say: Progress) -> FinalModel:
    """The model, or one that disagrees where the whole table finds a term that holds beside it, at the level of what is left over.

    A meter that lags a little goes with the rate of its own reading: neither smooth curves nor conditions show that.
    """
    found = terms_of(case.problem, model.fit, split, say, level=LEVEL_OF_LEFT_OVER)
    if not found or not found[0].holds or found[0].p_value > LEVEL_OF_LEFT_OVER:
        return model
    return replace(model, disagrees=True, terms=found)


_Told = dict[tuple[str, ...], tuple[Found, ...]]  # {names, sorted: the terms beside them}


def _key(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(names))


@dataclass(frozen=True)
class _Beside:
    """A typed term and names (effects, faults of the bench) fitted together."""

    names: tuple[str, ...]
    fitted: FittedTerm

    @property
    def each(self) -> float:
        """BIC's penalty of an amount."""
        return float(np.log(max(int(self.fitted.fit.used.sum()), 2)))

    def cost(self, scale: float, critical: float) -> float:
        """Chi-square in units of the misfit left, `scale`, and what it must gain."""
        fit = self.fitted.fit
        asked = len(self.names) * max(self.each, critical**2) + len(self.fitted.term.coefficients) * self.each
        return (fit.chi2 + fit.allowance) / scale + asked


def _best_beside(
    case: Case, model: FinalModel, split: Split, critical: float, say: Progress
) -> tuple[_Beside | None, _Told]:
    """The term that does best, with the names that are of use beside it, and what was told on the way: first beside all names where these
    leave a misfit.

    From two ends: the best term beside all names, and the best beside none, as names that together stand in for one place hide it.
    """
    problem, fit = case.problem, model.fit
    # A fault for each of several runs is a patch over what is missing. One that is the whole answer is asked itself.
    own = () if scattered(case, fit) else fit.faults
    faults = own if fit.physics else ()
    again = lambda names, values: problem.fit(names, values, hop_basins=True)
    told: _Told = {}
    leave = fit.chi2 - PROVEN * model.scale
    if model.disagrees:
        bent = fit if own == fit.faults else again(fit.physics, fit.values)
        known = model.terms if bent is fit else None
        found = terms_of(problem, bent, split, say) if known is None else known
        told[_key(bent.effects)] = found
        leave = found[0].fitted.fit.chi2 if found and found[0].holds else leave
    say("asking whether one place does what the names do")
    base = again(faults, model.base.values) if faults else model.base
    # Names beside it may be of use: what the term alone leaves may be more by what they must gain.
    below = leave + len(fit.physics) * critical**2 * model.scale if model.disagrees else leave
    told[_key(faults)] = terms_of(problem, base, split, say, below=below)
    begun = [_Beside(names, found[0].fitted) for names, found in told.items() if found and found[0].holds]
    scale = min([model.scale, *(misfit_scale(problem, one.fitted.fit) for one in begun)])
    cost = lambda one: one.cost(scale, critical)
    fewest = min(begun, key=lambda one: len(one.names), default=None)
    # In motion, where a round of refits takes ten seconds, the end with more names is not followed down to it.
    if problem.in_motion and fewest is not None and cost(fewest) <= min(map(cost, begun)) + PROVEN:
        begun = [fewest]
    ended = [_exchanged(problem, one, fit.effects, cost) for one in begun]
    least = min(map(cost, ended), default=0.0)
    as_good = (one for one in ended if cost(one) <= least + PROVEN)  # a name asks for a proof
    return min(as_good, key=lambda one: (len(one.names), cost(one)), default=None), told


def _exchanged(
    problem: Problem, best: _Beside, all_names: tuple[str, ...], cost: Callable[[_Beside], float]
) -> _Beside:
    """The term beside those of all names that are of use, what helps most taken out or added first."""
    while True:
        fewer = [tuple(n for n in best.names if n != out) for out in best.names]
        more = [(*best.names, name) for name in all_names if name not in best.names]
        asked = each(partial(_refitted, problem, best), [*fewer, *more])
        now = min(asked, key=cost, default=best)
        if cost(now) >= cost(best):
            return best
        best = now


def _refitted(problem: Problem, now: _Beside, names: tuple[str, ...]) -> _Beside:
    """The term of `now` beside other names, begun at its parameters."""
    own = now.fitted
    values = {n: v for n, v in own.fit.values.items() if n in names or n not in now.names}
    begun = problem.fit(names, values)
    there = straightened(own.problem, begun, replace(own.fit, values=begun.values | values))
    start = there if usable(there) else begun
    return _Beside(names, fitted_inside(own.problem, start, own.term, PATIENT))


def _far_better(model: FinalModel, beside: _Beside) -> bool:
    """Whether a term beside some of the names does better than all names without it.

    Names that leave a misfit have no claim that fewer amounts which leave as little would have to beat.
    """
    fit, now = model.fit, beside.fitted.fit
    gain = (fit.chi2 - now.chi2) / model.scale
    fewer = len(fit.effects) - len(beside.names) - len(beside.fitted.term.coefficients)
    by_bic = gain + (fit.allowance - now.allowance) / model.scale + beside.each * fewer
    return (by_bic if model.disagrees else min(gain, by_bic)) > PROVEN


# Share of what a term changes in the readings that names must show by their slopes to be asked, of single ones and of pairs the best so
# many; cost alone. A refit decides: stored oil acts in another way at every amount (two ports showed 0.67 of a flow that they are).
AS_THE_TERM, MOST_ASKED = 0.5, 3


def _in_names(case: Case, model: FinalModel, beside: _Beside, critical: float) -> Fit | None:
    """The fit with one or two effects of the library that do what a term does, where they do it as well; None where none do.

    Two may be one place: volumes at both ports are a flow from A to B, and the search takes one name that resembles them before two.
    """
    problem, now = case.problem, beside.fitted.fit
    start = problem.fit(beside.names, now.values, hop_basins=True) if beside.names else model.base
    names = [n for n in problem.library.names if n not in (*beside.names, *model.fit.effects)]
    names = [n for n in names if not expensive_to_compile((*beside.names, n))]
    scores = screen(problem.with_all_columns(start), names, case.steps, level=LEVEL, freedom=case.freedom)
    shown = scores.projection((now.residual - start.residual)[start.used])
    if not (whole := float(shown @ shown)) > 0.0:
        return None
    share = lambda pair: pair_gain(pair[0], pair[-1], -shown) / whole
    ranked = scores.ranked
    of_use = lambda found: sorted((f for f in found if share(f) > AS_THE_TERM), key=share, reverse=True)[:MOST_ASKED]
    likely = [*of_use([(s,) for s in ranked]), *of_use(combinations(ranked, 2))]

    def ask(found: tuple[Signature, ...]) -> Fit:
        columns = np.stack([s.direction for s in found], axis=1)
        lengths = np.linalg.lstsq(columns, shown, rcond=None)[0]
        amounts = {s.name: float(length) / s.size for s, length in zip(found, lengths, strict=True)}
        return problem.fit((*beside.names, *amounts), {**start.values, **amounts}, hop_basins=True)

    cost = lambda fit: merit(fit) / model.scale + critical**2 * len(fit.physics)
    best = min((f for f in each(ask, likely) if believable(f)), key=cost, default=None)
    if best is None or any(best.values[n] == 0.0 or n in best.active for n in best.physics):
        return None
    as_well = merit(best) < merit(now) + PROVEN * model.scale
    return best if as_well and gains_enough(start, best, critical) else None


def _ended_with(case: Case, model: FinalModel, fit: Fit, split: Split, outdone: tuple[Suspect, ...] = ()) -> FinalModel:
    """The model that ends with a fit of other names, which have to prove themselves again; of its misfit and terms nothing is said yet."""
    problem, scale, proof = case.problem, lambda f: misfit_scale(case.problem, f), None
    suspects, doubted = outdone, model.doubted
    rivals = all_rivals(problem, fit, case.steps, scale(fit), case.freedom) if fit.effects else {}
    if fit.physics:
        fit, rivals, proof, unproven, more = proven(case, fit, rivals, split, scale)
        suspects, doubted = (*suspects, *unproven), (*doubted, *more)
    return replace(
        model,
        fit=fit,
        rivals=rivals,
        p_values=p_values(fit, rivals, proof),
        left=misfit_left(problem, fit, smooth_block(problem, len(fit.residual))),
        scale=scale(fit),
        proof=proof,
        suspects=(*model.suspects, *suspects),
        doubted=doubted,
        terms=None,
    )


def _with_fewer_names(
    case: Case, model: FinalModel, split: Split, beside: _Beside, told: _Told, say: Progress
) -> FinalModel:
    """The model with the names that are of use beside the term, and the terms beside these."""
    kept = case.problem.fit(beside.names, model.fit.values, hop_basins=True) if beside.names else model.base
    ended = _ended_with(case, model, kept, split, _suspects(model, beside.names, term_name(beside.fitted.term)))
    found = told.get(_key(ended.fit.effects))
    terms = terms_of(case.problem, ended.fit, split, say) if found is None else found
    return replace(ended, disagrees=True, terms=terms, told=told)


def _suspects(model: FinalModel, kept: tuple[str, ...], outdone: str) -> tuple[Suspect, ...]:
    """The names that a model loses beside a term, `outdone` in words."""
    fit, times, nowhere = model.fit, times_usual(model.fit), float("nan")
    return tuple(
        Suspect(
            name,
            fit.values[name],
            effect_info(name).unit,
            nowhere if model.proof is None else model.proof.each.get(name, nowhere),
            times[name],
            strength(fit, model.rivals[name].without, model.scale),
            outdone,
        )
        for name in fit.physics
        if name not in kept
    )


EARNED = 0.1  # of the gap: what a name must close, alone and as the last one in, while a misfit is left


def without_unearned(case: Case, model: FinalModel, split: Split) -> FinalModel:
    """While a misfit is left: the model without labels called wrong, be they its own or rivals, and without names that close less than a
    tenth of the gap alone or as the last one in, the weakest first. They are suspects.

    What goes with temperature or supply pressure and is missing from the library looks like an error of their labels, test by test
    (docs/diagnosis.md section 12.1).
    """
    problem, fit, base = case.problem, model.fit, model.base
    if not model.disagrees or not fit.effects:
        return model
    refitted = lambda names: problem.fit(names, fit.values, hop_basins=True) if names else base
    labels = [name for name in fit.faults if _is_label(problem.faults[name])]
    gone = [_label(model, name, problem.faults[name]) for name in labels]
    without = {name: model.rivals[name].without for name in fit.physics}
    if labels:
        fit = refitted([name for name in fit.effects if name not in labels])
        without = fits_without(problem, fit, fit.physics)
    alone = by_name(
        lambda n: problem.fit((n,), base.values | {n: model.fit.values[n]}, hop_basins=True), model.fit.physics
    )
    times = times_usual(model.fit)
    while fit.physics:
        closes = {name: (model.share(base, alone[name]), model.share(without[name], fit)) for name in fit.physics}
        weakest = min(closes, key=lambda name: min(closes[name]))
        if min(closes[weakest]) >= EARNED:
            break
        lost = strength(fit, without[weakest], model.scale)
        proof = float("nan") if model.proof is None else model.proof.each.get(weakest, float("nan"))
        unit = effect_info(weakest).unit
        gone.append(Suspect(weakest, fit.values[weakest], unit, proof, times[weakest], lost, closes=closes[weakest]))
        fit = refitted([name for name in fit.effects if name != weakest])
        without = fits_without(problem, fit, fit.physics)
    if not gone:
        other = lambda rival: rival.name not in problem.faults or not _is_label(problem.faults[rival.name])
        of_others = lambda own: replace(own, tried=tuple(filter(other, own.tried)))
        return replace(model, rivals={name: of_others(own) for name, own in model.rivals.items()})
    ended = _ended_with(case, model, fit, split, tuple(gone))
    # What proved itself beside others need not do so any more, and what it closed may be another's.
    return without_unearned(case, replace(ended, terms=model.told.get(_key(ended.fit.effects))), split)


def _is_label(fault: BenchFault) -> bool:
    """Whether it is an error of the temperature or the supply pressure that rows were read at."""
    return fault.info.moves in ("temperature", "supply_pressure")


def _label(model: FinalModel, name: str, fault: BenchFault) -> Suspect:
    """A label that the search would have called wrong."""
    fit, without = model.fit, model.rivals[name].without
    said = found_fault(fault, fit.values[name] * fault.size)
    lost, closed = strength(fit, without, model.scale), model.gap_closed(without)
    return Suspect(
        fault.kind, said.value, said.unit, float("nan"), times_usual(fit)[name], lost, closes=(float("nan"), closed), fault=said.sentence
    )  # fmt: skip
