"""Turn the final model of a diagnosis into a `DiagnosisResult`: verdict, figures on held-out rows, parameter shifts, next test.

Before and after are each reported as a plain fit is (`result_of`), with the amounts of effects among the parameters and error
bars by generalised least squares.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.effects.library import effect_info, find_effect
from thermohyd.identify.bench.test_record import Fault
from thermohyd.identify.fitting.bench_faults import BenchFault, is_fault
from thermohyd.identify.fitting.misfit import doubts
from thermohyd.identify.fitting.model_form import evidence, other_law, with_model_form
from thermohyd.identify.fitting.outcome import Fitted, Key, fit_result
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import gls_covariance, solution_of
from thermohyd.identify.fitting.relative import effect_plans
from thermohyd.identify.fitting.result import FitResult, beyond_chance
from thermohyd.identify.fitting.uncertainty import Covariance
from thermohyd.identify.noise.level import ChannelNoise
from thermohyd.identify.report.diagnosis_report import further_sentences, headline, suspect_sentences
from thermohyd.identify.report.diagnosis_words import fault_sentence
from thermohyd.identify.report.term_words import term_lines

from .case import Case, Progress
from .credit import held_out_figures, not_to_be_handed_over
from .final_model import FinalModel, scattered
from .found_faults import alternative, with_evidence, with_faults_apart
from .held_out import Split
from .learned import with_learned
from .left_over import variations_of
from .model_average import of_either_sign, with_rivals
from .next_test import check_of, next_test, what_settles, what_shows
from .other_law import ANOTHER_LAW, OtherLawSays, better_law, of_the_other_law, what_the_other_law_says
from .record_noise import NoiseEstimate, first_noise
from .remaining_misfit import Remaining, remaining_misfit
from .result import (
    Alternative,
    ChannelNoiseFound,
    DiagnosisResult,
    Evidence,
    NamedEffect,
    ParameterShift,
    Verdict,
)
from .rivals import Rival, Rivals, mirrors
from .rivals_beside_misfit import rivals_beside_misfit, weighed_again
from .screening import candidates, screen
from .screening_faults import screen_of_faults
from .search import LEVEL, Selection
from .term_table import acting_like
from .typed_terms import terms_of
from .where import regions


def _without_last(found: Covariance, count: int) -> Covariance:
    """The covariance of all but the last `count` entries."""
    kept = len(found.matrix) - count
    why = {i: words for i, words in found.why.items() if i < kept}
    return replace(found, matrix=found.matrix[:kept, :kept], why=why, alive=found.alive[found.alive < kept])


def result_of(
    problem: Problem,
    fit: Fit,
    fitted: Fitted,
    noise: dict[Key, NoiseEstimate],
    scale: float,
    remaining: Remaining | None = None,
    beside: np.ndarray | None = None,
) -> FitResult:
    """Everything that a plain fit reports, for `fit`; error bars by generalised least squares with the noise estimated, and with
    what the model misses.

    beside: see `gls_covariance`.
    """
    whole = as_fitted(problem, fit, fitted, noise)
    covariance = _covariance(problem, fit, scale, remaining, beside)
    return with_faults_apart(fit_result(whole, covariance), problem.faults)


def as_fitted(problem: Problem, fit: Fit, fitted: Fitted, noise: dict[Key, NoiseEstimate]) -> Fitted:
    """A fit of a diagnosis as a plain fit hands itself over, its rows in units of white noise."""
    white = problem.with_noise(first_noise(as_channel_noise(noise)))
    solution = solution_of(problem, fit, white.evaluate(fit.values, fit.effects))
    plans = fitted.plans | effect_plans(fit.effects, problem.record)
    return replace(fitted, plans=plans, free=fit.free, noise=as_channel_noise(noise), solution=solution)


def _covariance(
    problem: Problem, fit: Fit, scale: float, remaining: Remaining | None, beside: np.ndarray | None = None
) -> Covariance:
    priors = len(problem.parameters)
    if remaining is not None:
        return remaining.covariance(fit, priors)
    found = gls_covariance(fit, scale, priors, beside)
    return found if beside is None else _without_last(found, beside.shape[1])


def _spread(
    problem: Problem, tried: Sequence[Rival], scale: float, remaining: Remaining | None
) -> dict[int, dict[str, float]]:
    """{id of a rival's fit: {entry: standard error}} of all rivals that the data allow."""
    found = {}
    for rival in tried:
        known = _covariance(problem, rival.fit, scale, remaining)
        std = np.sqrt(np.maximum(np.diag(known.matrix), 0.0))
        found[id(rival.fit)] = {n: float(std[i]) for i, n in enumerate(rival.fit.free) if i not in known.why}
    return found


def as_channel_noise(noise: dict[Key, NoiseEstimate]) -> dict[Key, ChannelNoise]:
    return {
        key: ChannelNoise(n.std, n.source, n.known, False, n.std, n.degrees_of_freedom, parts=n.parts)
        for key, n in noise.items()
    }


@dataclass(frozen=True)
class Believed:
    """The likelihood that the error bars of an answer stand for, of who draws from it: readings known to the noise, and to a
    discrepancy where something remains; the fit beside these; the variance of its whitened residuals where that exceeds 1."""

    problem: Problem
    fit: Fit
    scale: float


def conclude(
    case: Case,
    selection: Selection,
    split: Split,
    model: FinalModel,
    *,
    learn: bool,
    model_form: bool = False,
    say: Progress = lambda _: None,
) -> DiagnosisResult:
    """Confirm on the rows held out, ask the other law of an edge (`model_form`), and put everything into figures and words."""
    return concluded(case, selection, split, model, learn=learn, model_form=model_form, say=say)[0]


def concluded(
    case: Case,
    selection: Selection,
    split: Split,
    model: FinalModel,
    *,
    learn: bool,
    model_form: bool = False,
    say: Progress = lambda _: None,
) -> tuple[DiagnosisResult, Believed]:
    """What `conclude` gives, and the likelihood behind it."""
    case = replace(case, base=model.base)
    problem, base = case.problem, case.base
    first = screen(problem.with_all_columns(base), problem.library.names, case.steps, level=LEVEL, freedom=case.freedom)
    smooth = variations_of(problem, model.fit) if model.disagrees and not problem.in_motion else ()
    found = model.terms or ()
    if model.disagrees and model.terms is None:
        # A fault for each of several runs is a patch over what is missing, which is to be found.
        patched = scattered(case, model.fit)
        asked = problem.fit(model.fit.physics, model.fit.values, hop_basins=True) if patched else model.fit
        found = terms_of(problem, asked, split, say)
    end = with_learned(problem, model, found, smooth, learn, say)
    problem, fit, term, terms, smooth = end.problem, end.fit, end.term, end.terms, end.smooth
    # Error bars know a misfit that remains; a learned term is one.
    remaining = remaining_misfit(problem, fit, say) if model.disagrees and term is None else None
    if remaining is not None:
        say("which rivals the data allow beside the misfit")
        model = replace(model, rivals=rivals_beside_misfit(problem, fit, model.rivals, remaining))
    held = held_out_figures(case, split, model, fit, term, smooth, first, remaining, say)
    if remaining is not None and remaining.weighed.discrepancy is not None and held.after > held.before:
        # Weights under which runs of some tests are met better may meet the rows held out worse than the ideal valve does.
        by_noise = remaining.by_noise(problem, fit)
        again = held_out_figures(case, split, model, fit, term, smooth, first, by_noise, say)
        remaining, held = (by_noise, again) if again.after < held.after else (remaining, held)
    before = result_of(case.problem, base, case.fitted, case.noise, scale=max(base.chi2 / len(base.residual), 1.0))
    kept = fit if remaining is None else remaining.fit
    after = result_of(
        problem, kept, case.fitted, case.noise, max(fit.chi2 / len(fit.residual), 1.0), remaining, end.beside
    )
    if term is None:
        tried = (*(r for own in model.rivals.values() for r in own.alike), *model.doubted)
        tried = tried if remaining is None else weighed_again(problem, tried, remaining)
        weighing = problem if remaining is None else remaining.weighing(problem)
        tried = (*tried, *mirrors(weighing, kept, model.scale))
        after = with_rivals(after, tried, _spread(problem, tried, model.scale, remaining))
    says = None
    if model_form and not problem.in_motion:
        say("the final model with the other law of the edge")
        says = what_the_other_law_says(problem, fit, first.critical)
        after = _with_both_laws(after, fit, says, case, remaining)
    after = with_evidence(after, model, problem.faults)
    seen = _evidence(case, model.rivals)
    named = (_named(name, after, model, says, problem.faults) for name in fit.physics)
    places = acting_like(case.problem, model.fit, model.scale)
    effects = tuple(
        replace(effect, top_rows=_in_top_rows(effect.name, seen), places=places.get(effect.name, ()))
        for effect in named
    )
    crowded = [fault.sentence for fault in after.faults if fault.rows and not fault.masked]
    at_fault = [fault for fault in after.faults if not fault.rows]
    verdict = _verdict(model, effects, crowded, at_fault)
    where = regions(before.channels, case.fitted.tests) if verdict != "consistent" else ()
    where_after = regions(after.channels, case.fitted.tests) if model.disagrees else ()
    # A search that began from effects of an earlier one refitted its candidates beside them: not what one does alone.
    singles = {name: single for name, single in selection.steps[0].singles.items() if single.effects == (name,)}
    excess = selection.base.chi2 - int(selection.base.used.sum())
    table = candidates(case.problem.library, first, selection.base, singles, excess)
    further = None
    if verdict == "ambiguous":
        further = next_test(case.problem, fit, model.rivals, model.scale, say, says)
    elif verdict == "unexplained":
        further = check_of(problem, fit, where_after, smooth, model.rivals, model.scale)
    elif not problem.in_motion:
        further = what_settles(problem, fit, model.suspects, model.scale, say)
        further = further or what_shows(
            problem, fit, (c.name for c in table if c.state == "absorbed"), first.critical, say
        )
    shifts = parameter_shifts(before, after) if effects or term else ()
    gaps = (before.reduced_chi2, after.reduced_chi2)
    instead = None
    if not_to_be_handed_over(held, believed=not model.disagrees):
        instead = ideal_valve(case.problem, base, case.fitted, case.noise, say)
    believed = Believed(problem, fit, max(fit.chi2 / len(fit.residual), 1.0))
    if remaining is not None:
        believed = Believed(remaining.believing(problem), remaining.believed.fit, remaining.believed.scale)
    result = DiagnosisResult(
        record=case.fitted.record,
        verdict=verdict,
        headline=headline(
            verdict,
            effects,
            where,
            held,
            gaps,
            shifts,
            smooth,
            judged=after.judged,
            beyond=beyond_chance(after.channels),
            law=better_law(after),
            faults=tuple(at_fault),
            terms=terms,
            suspects=model.suspects,
        ),
        sentences=(
            *_of_faults(crowded, at_fault, effects, model),
            *suspect_sentences(model.suspects),
            *further_sentences(effects, before, smooth),
            *term_lines(terms),
            *of_the_other_law(says),
            *doubts(after.channels, after.parameters),
        ),
        where=where,
        where_after=where_after,
        effects=effects,
        candidates=table,
        absorbed=tuple(c.name for c in table if c.state == "absorbed"),
        gap_before=gaps[0],
        gap_after=gaps[1],
        held_out=held,
        next_test=further,
        before=before,
        after=after,
        shifts=shifts,
        variations=smooth,
        evidence=seen,
        noise=_noise(case),
        left_over_p=end.left.p_value,
        critical_level=first.critical,
        seconds=0.0,
        evaluations=problem.work.evaluations,
        notes=after.notes,
        warnings=_warnings(case, model, after, problem.work.evaluations),
        learned=(term,) if term else (),
        suspects=model.suspects,
        terms=terms,
        proof=None if model.proof is None else model.proof.together,
        discrepancy=() if remaining is None else remaining.channels,
        instead=instead,
    )
    return result, believed


def ideal_valve(
    problem: Problem, base: Fit, fitted: Fitted, noise: dict[Key, NoiseEstimate], say: Progress = lambda _: None
) -> FitResult:
    """The ideal valve, as it is handed over where the final model predicts worse: its errors hold what it misses."""
    remaining = remaining_misfit(problem, base, say).by_noise(problem, base)
    return result_of(problem, base, fitted, noise, max(base.chi2 / len(base.residual), 1.0), remaining)


def _verdict(model: FinalModel, effects: tuple[NamedEffect, ...], crowded: list[str], at_fault: list[Fault]) -> Verdict:
    """docs/diagnosis.md section 15; crowded: sentences of bad rows that were too many to leave out."""
    if model.disagrees or (crowded and effects):
        return "unexplained"
    if effects:
        return "ambiguous" if any(effect.alternatives for effect in effects) else "named"
    could_be_an_effect = any(find_effect(rival) is not None for fault in at_fault for rival in fault.alternatives)
    return "ambiguous" if could_be_an_effect else "consistent"


def _of_faults(
    crowded: list[str], at_fault: list[Fault], effects: tuple[NamedEffect, ...], model: FinalModel
) -> list[str]:
    """What the bench's faults mean for the names; where they are the whole answer the headline says them."""
    nothing = [f"Nothing is named: {sentence}." for sentence in crowded if effects]
    beside = [fault_sentence(fault) for fault in at_fault]
    return nothing + (beside if effects or model.disagrees else [])


def _warnings(case: Case, model: FinalModel, after: FitResult, evaluations: int) -> tuple[str, ...]:
    return (
        *unconverged(after),
        *(() if model.complete else (stopped(evaluations),)),
        *after.warnings,
        *(f"{k[0]}, {k[1]}: {n.warning}" for k, n in case.noise.items() if n.warning),
    )


def unconverged(after: FitResult) -> tuple[str, ...]:
    """The warning that a diagnosis gives of a final fit that did not converge."""
    return () if after.converged else (f"the final fit did not converge: {after.message}",)


def stopped(evaluations: int) -> str:
    """The warning that a diagnosis gives of a search that had taken all its evaluations."""
    return (
        f"the search was ended after {evaluations:,} evaluations of the model, with something left to find: it names what it "
        "had found by then, and the record counts as unexplained"
    )


def _with_both_laws(
    after: FitResult, fit: Fit, says: OtherLawSays, case: Case, remaining: Remaining | None
) -> FitResult:
    """The final model's result with what the other law makes of its parameters. The whitened rows are independent readings.

    fit: the final model before anything that remained was allowed for.
    """
    there = replace(case.fitted, record=says.problem.record, plans=dict(says.problem.plans))
    rows = len(fit.residual) - len(says.problem.parameters)
    scale = max(min(fit.chi2, says.fit.chi2) / rows, 1.0)
    beside = says.fit
    if remaining is not None:
        beside = remaining.weighing(says.problem).fit(beside.effects, beside.values)
    other = result_of(says.problem, beside, there, case.noise, max(says.fit.chi2 / rows, 1.0), remaining)
    speaks = evidence(fit.chi2 / scale, says.fit.chi2 / scale, len(fit.free), len(says.fit.free), rows)
    return with_model_form(after, other_law(after, other, speaks))


def _named(
    name: str, after: FitResult, model: FinalModel, says: OtherLawSays | None, faults: Mapping[str, BenchFault]
) -> NamedEffect:
    estimate, rivals, info = after.parameters[name], model.rivals[name], effect_info(name)
    alike = tuple(alternative(r, faults) for r in rivals.alike)
    if says is not None and name in says.in_place_of:
        alike = (*alike, Alternative(ANOTHER_LAW, np.nan, "", says.chi2_more))
    return NamedEffect(
        name=name,
        value=estimate.value,
        unit=info.unit,
        std=estimate.std,
        ci95=estimate.ci95,
        p_value=model.p_values[name],
        strength=float(np.sqrt(max(rivals.without.chi2 - model.fit.chi2, 0.0))),
        gap_closed=model.gap_closed(rivals.without),
        sentence=info.sentence,
        alternatives=alike,
        at_bound=estimate.at_bound,
        either_sign=of_either_sign(estimate),
    )


def parameter_shifts(before: FitResult, after: FitResult) -> tuple[ParameterShift, ...]:
    """What the missing effects had done to the parameters of the model without them."""
    now = {name: estimate.reported for name, estimate in after.parameters.items()}
    return tuple(
        ParameterShift(name, p.reported.unit, p.reported.value, now[name].value, now[name].std)
        for name, p in before.parameters.items()
        if not p.fixed
    )


def _evidence(case: Case, rivals: dict[str, Rivals]) -> tuple[Evidence, ...]:
    """z of each named effect as a sum over rows, beside the model without it."""
    evidence = []
    for name, rival in rivals.items():
        without, found, words = rival.without, None, name
        if is_fault(name):
            found = screen_of_faults(case.problem, without, level=LEVEL)
            words = re.sub(r"\W+", "_", name).strip("_")  # also the name of a file
        else:
            without = case.problem.with_all_columns(without)
            found = screen(without, [name], case.steps, level=LEVEL)
        signature = None if found is None else found.best(name)
        if signature is None:
            continue
        share = -signature.direction * without.residual[without.used]
        for key, rows in case.problem.rows().items():
            test = case.fitted.tests[key[0]]
            evidence.append(Evidence(words, *key, test.place, test.direction, test.temperature, share[rows]))
    return tuple(evidence)


TOP = 0.01  # of the rows


def _in_top_rows(effect: str, evidence: tuple[Evidence, ...]) -> float:
    """Share of an effect's score that its strongest rows hold."""
    own = [part.contribution for part in evidence if part.effect == effect]
    rows = np.sort(np.concatenate(own)) if own else np.zeros(0)
    total = float(np.sum(rows))
    return float(np.sum(rows[-max(1, round(TOP * len(rows))) :]) / total) if total > 0.0 else float("nan")


def _noise(case: Case) -> tuple[ChannelNoiseFound, ...]:
    channels = []
    for key, n in case.noise.items():
        rows = case.fitted.tests[key[0]].rows
        channels.append(
            ChannelNoiseFound(
                *key, float(np.sqrt(np.mean(n.std**2))), n.source, n.correlation.share * n.correlation.phi,
                n.correlation_source, rows / n.correlation.inflation, rows, n.parts,
            )
        )  # fmt: skip
    return tuple(channels)
