"""From the final model to a `DiagnosisResult`: verdict, figures on rows held out, and words."""

from dataclasses import replace

import numpy as np

from thermohyd.effects.registry import effect_info

from ..fit_result import FitResult
from ..misfit import doubts
from .candidates import candidates
from .case import Case, Progress
from .confirmation import exchange_fits, held_out_result
from .final_model import FinalModel
from .fit_results import result_of
from .headline import further_sentences, headline
from .held_out import Split
from .learning import learn as learn_term
from .library_fit import LibraryFit, LibraryProblem
from .next_test import next_test
from .result import (
    Alternative,
    ChannelNoiseFound,
    DiagnosisResult,
    Evidence,
    HeldOut,
    NamedEffect,
    ParameterShift,
    Variation,
    Verdict,
)
from .rivals import Rivals
from .screening import Screen, screen
from .search import LEVEL, Found
from .smooth_basis import lack_of_fit, smooth_block
from .variation_terms import LearnedTerm
from .variations import variations_of
from .where import regions


def conclude(
    case: Case, found: Found, split: Split, model: FinalModel, *, learn: bool, say: Progress = lambda _: None
) -> DiagnosisResult:
    """Confirm on the rows held out, and put everything into figures and words."""
    case = replace(case, base=model.base)
    problem, base = case.problem, case.base
    first = screen(problem.with_all_columns(base), problem.library.names, case.steps, level=LEVEL)
    smooth = variations_of(problem, model.fit) if model.disagrees and not problem.in_motion else ()
    fit, term, left = model.fit, None, model.left
    if learn and smooth:
        say(f"learning how {smooth[0].quantity} varies with {smooth[0].variable}")
        problem, fit, term = learn_term(problem, fit, smooth[0])
        left = lack_of_fit(problem, fit, smooth_block(problem, len(fit.residual)))
        smooth = (_learned(smooth[0], term), *smooth[1:])
    held = _held_out(case, split, model, fit, term, smooth, first, say)
    before = result_of(case.problem, base, case.fitted, case.noise, scale=max(base.chi2 / len(base.residual), 1.0))
    after = result_of(problem, fit, case.fitted, case.noise, scale=max(fit.chi2 / len(fit.residual), 1.0))
    effects = tuple(_named(name, after, model) for name in fit.effects)
    verdict: Verdict = "consistent"
    if model.disagrees:
        verdict = "unexplained"
    elif effects:
        verdict = "ambiguous" if any(e.alternatives for e in effects) else "named"
    where = regions(before.channels, case.fitted.tests) if verdict != "consistent" else ()
    shifts = _shifts(before, after) if effects or term else ()
    # A search that began from effects of an earlier one refitted its candidates beside them: not what one does alone.
    singles = {name: single for name, single in found.steps[0].singles.items() if single.effects == (name,)}
    table = candidates(case.problem.library, first, found.base, singles, found.base.chi2 - int(found.base.used.sum()))
    gaps = (before.reduced_chi2, after.reduced_chi2)
    return DiagnosisResult(
        record=case.fitted.record,
        verdict=verdict,
        headline=headline(verdict, effects, where, held, gaps, shifts, smooth, judged=after.judged),
        sentences=(*further_sentences(effects, before, smooth), *doubts(after.channels, after.parameters)),
        where=where,
        where_after=regions(after.channels, case.fitted.tests) if model.disagrees else (),
        effects=effects,
        candidates=table,
        absorbed=tuple(c.name for c in table if c.state == "absorbed"),
        gap_before=gaps[0],
        gap_after=gaps[1],
        held_out=held,
        next_test=next_test(case.problem, fit, model.rivals, model.scale, say) if verdict == "ambiguous" else None,
        before=before,
        after=after,
        shifts=shifts,
        variations=smooth,
        evidence=_evidence(case, model.rivals),
        noise=_noise(case),
        left_over_p=left.p_value,
        critical_level=first.critical,
        seconds=0.0,
        notes=after.notes,
        warnings=(
            *_unconverged(after),
            *after.warnings,
            *(f"{k[0]}, {k[1]}: {n.warning}" for k, n in case.noise.items() if n.warning),
        ),
        learned=(term,) if term else (),
    )


def _unconverged(after: FitResult) -> tuple[str, ...]:
    return () if after.converged else (f"the final fit did not converge: {after.message}",)


def _held_out(
    case: Case,
    split: Split,
    model: FinalModel,
    fit: LibraryFit,
    term: LearnedTerm | None,
    smooth: tuple[Variation, ...],
    first: Screen,
    say: Progress,
) -> HeldOut:
    """The ideal and the final model fitted to the other rows, on the rows held out."""
    chosen = case.problem.with_rows(~split.held)
    base = chosen.fit(start=case.base.values)
    final = chosen.fit(fit.effects, fit.values) if fit.effects else base
    spared = set(fit.effects) | {r.name for rival in model.rivals.values() for r in rival.alike}
    exchanged = exchange_fits(chosen, final, [s.name for s in first.ranked], spared, say)
    judge: LibraryProblem = case.problem
    if term is not None:
        chosen, final, own = learn_term(chosen, final, smooth[0])
        judge = case.problem.with_terms(own)
    words = f"{split.what} (the choice needed all rows, the values did not)"
    return held_out_result(
        case.problem, judge, split, base, final, exchanged, split.what if model.seen_apart else words
    )


def _learned(variation: Variation, term: LearnedTerm) -> Variation:
    """The variation with the coefficients that the model now holds."""
    return replace(variation, coefficients=term.coefficients, learned=True)


def _named(name: str, after: FitResult, model: FinalModel) -> NamedEffect:
    estimate, rivals, info = after.parameters[name], model.rivals[name], effect_info(name)
    alike = tuple(
        Alternative(r.name, r.fit.values[r.name], effect_info(r.name).unit, r.chi2_more) for r in rivals.alike
    )
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
    )


def _shifts(before: FitResult, after: FitResult) -> tuple[ParameterShift, ...]:
    return tuple(
        ParameterShift(name, p.unit, p.value, after.parameters[name].value, after.parameters[name].std)
        for name, p in before.parameters.items()
        if not p.fixed
    )


def _evidence(case: Case, rivals: dict[str, Rivals]) -> tuple[Evidence, ...]:
    """z of each named effect as a sum over rows, beside the model without it."""
    found = []
    for name, rival in rivals.items():
        at = case.problem.with_all_columns(rival.without)
        own = screen(at, [name], case.steps, level=LEVEL).best(name)
        if own is None:
            continue
        share = -own.direction * at.residual[at.used]
        for key, rows in case.problem.rows().items():
            test = case.fitted.tests[key[0]]
            found.append(Evidence(name, *key, test.place, test.direction, test.temperature, share[rows]))
    return tuple(found)


def _noise(case: Case) -> tuple[ChannelNoiseFound, ...]:
    found = []
    for key, n in case.noise.items():
        rows = case.fitted.tests[key[0]].rows
        found.append(
            ChannelNoiseFound(
                *key, float(np.sqrt(np.mean(n.std**2))), n.source, n.correlation.share * n.correlation.phi,
                n.correlation_source, rows / n.correlation.inflation, rows,
            )
        )  # fmt: skip
    return tuple(found)
