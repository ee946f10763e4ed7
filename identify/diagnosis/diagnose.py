"""Diagnose one record: fit, find where it misses, name missing effects, confirm on held-out rows, say what remains.

Static tests are searched first, then the dynamic ones with what the static ones gave held: a search over both libraries at
once would integrate every run with the columns of effects that no run can show. What both searches found is then fitted to
all tests together, so that every value and error bar is that of the whole record.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import dynamic_among
from thermohyd.identify.fitting.library import Library, motion_library
from thermohyd.identify.fitting.model_form import with_model_form
from thermohyd.identify.fitting.outcome import Fitted, Key
from thermohyd.identify.fitting.parameters import IN_MOTION, ParameterPlan, Prior
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.model.typed_terms import TypedTerm
from thermohyd.identify.noise.level import repeat_differences
from thermohyd.identify.users_effects import known_effects
from thermohyd.kept_programs import begin_work
from thermohyd.numerics import require_float64

from .case import Case, Progress, choose, open_case
from .conclusion import (
    Believed,
    as_channel_noise,
    concluded,
    ideal_valve,
    parameter_shifts,
    result_of,
    unconverged,
)
from .final_model import FinalModel, final_model
from .found_faults import with_evidence
from .model_average import without_rivals
from .record_noise import NoiseEstimate, first_noise, noise_of, repeats_in
from .remaining_misfit import Remaining, remaining_misfit
from .result import DiagnosisResult, NamedEffect, Verdict
from .screening import finite_steps
from .stand_ins import without_stand_ins, without_unearned
from .term_table import opened


def open_motion(
    record: BenchRecord,
    say: Progress = lambda _: None,
    static: FitResult | None = None,
    effects: Mapping[str, float] | None = None,
    without: tuple[str, ...] = (),
) -> Case:
    """Fit the parameters of motion as `fit` does, then the same with the null bias free: a null may move.

    static: what the record's static tests gave, held here but for the null bias, which keeps to its error bar. effects: found there.
    without: effects that are not looked for. The noise is taken as stated and white until a first search has found what is
    missing: a misfit of motion looks like noise with a memory.
    """
    # Here, not above: the diagnosis of static tests does not wait for the solvers of motion.
    from thermohyd.identify.fitting.fit_motion import run_fit_motion

    assert record.actuator is not None
    moving = record.dynamic_tests
    known = None if static is None else {name: estimate.value for name, estimate in static.parameters.items()}
    known = None if known is None else {name: v for name, v in known.items() if name not in (effects or {})}
    null_shows = any(test.time is not None for test in moving.values())
    # With the null in its vector from the start the plain fit runs the program of all that follow.
    also = (*(() if static is None else static.free), *(("null_bias",) if null_shows else ()))
    fitted = run_fit_motion(record, say, known, also)
    own = {name: fitted.plans[name] for name in (*IN_MOTION, *(n for n in fitted.free if n not in IN_MOTION))}
    if null_shows and "null_bias" not in own:
        own |= _null(record, fitted.plans["null_bias"], static)
    fitted = replace(fitted, plans={**fitted.plans, **own})
    tests = fitted.tests
    library = motion_library(dynamic_among(tests), record.actuator.heat).without(without)
    problem = Problem(
        record, tests, fitted.plans, library, first_noise(fitted.noise), known_effects=dict(effects or {}), also=also
    )
    repeats = {}
    for name, test in fitted.tests.items():
        for channel in test.channels:
            pieces = repeat_differences(test, channel)
            size = float(np.sqrt(np.mean(fitted.noise[name, channel.name].std ** 2)))
            repeats[name, channel.name] = repeats_in([piece / size for piece in pieces])
    noise = {
        key: NoiseEstimate(
            n.std,
            problem.noise.correlation[key],
            n.source,
            "taken for white",
            n.known,
            degrees_of_freedom=n.degrees_of_freedom,
            parts=n.parts,
        )
        for key, n in fitted.noise.items()
    }
    correlation = {key: r.correlation for key, r in repeats.items() if r is not None}
    problem = problem.with_noise(replace(problem.noise, correlation={**problem.noise.correlation, **correlation}))
    say("the plain model with its null free")
    base = problem.fit(start=fitted.values, hop_basins=True)
    say("what each effect would do")
    steps = finite_steps(problem, problem.with_all_columns(base), problem.library.names)  # pyright: ignore
    return Case(fitted, problem, repeats, noise, base, steps)


def _null(record: BenchRecord, plan: ParameterPlan, static: FitResult | None) -> dict[str, ParameterPlan]:
    """The null bias as one more free parameter, unless the user holds it."""
    chosen = record.start.get("null_bias")
    if chosen is not None and chosen.fixed:
        return {}
    estimate = None if static is None else static.parameters.get("null_bias")
    prior = Prior(plan.start, estimate.std) if estimate is not None and estimate.std else plan.prior
    return {"null_bias": replace(plan, fixed=False, prior=prior)}


ORDER: tuple[Verdict, ...] = ("consistent", "named", "ambiguous", "unexplained")


@dataclass(frozen=True)
class Stage:
    """A search over tests of one kind: what it began from, the model that it ended with, the answer in words, and the likelihood behind
    its error bars."""

    case: Case
    model: FinalModel
    result: DiagnosisResult
    believed: Believed

    @property
    def answer(self) -> "Answer":
        return Answer(self.result, self.believed, self.case.fitted, self.case.noise)


@dataclass(frozen=True)
class Answer:
    """A whole answer, the likelihood behind its error bars, the plain fit of the same tests, and the noise that was estimated."""

    result: DiagnosisResult
    believed: Believed
    fitted: Fitted
    noise: dict[Key, NoiseEstimate]


@dataclass(frozen=True)
class _Joint:
    """The plain model and the one with everything that both stages named, each fitted to all tests at once. remaining: what remains as
    a part of the error, where a stage ended with a misfit and nothing was learned of it. instead: the plain model with widened errors,
    where a stage hands that over."""

    before: FitResult
    after: FitResult
    instead: FitResult | None
    remaining: Remaining | None
    believed: Believed
    fitted: Fitted
    noise: dict[Key, NoiseEstimate]


def in_words_of_motion(result: DiagnosisResult) -> DiagnosisResult:
    """The answer of a search over dynamic tests, with a headline that speaks of the actuator."""
    return replace(
        result, headline=result.headline.replace("The ideal valve explains", "The actuator's model explains")
    )


def fitted_together(record: BenchRecord, static: Stage, motion: Stage, say: Progress = lambda _: None) -> _Joint:
    """What both stages ended with, fitted to all tests of the record."""
    # Here, not above: the diagnosis of static tests does not wait for the solvers of motion.
    from thermohyd.identify.fitting.fit_motion import joint_problem, jointly_fitted

    say("fitting static and dynamic tests together")
    s, m = static.case, motion.case
    noise = {**s.noise, **m.noise}
    names = tuple(dict.fromkeys((*s.problem.library.names, *m.problem.library.names)))
    problem = joint_problem(record, s.fitted, m.fitted, noise_of(noise), Library(names, {}))
    problem = replace(problem, faults=s.problem.faults)
    plain = problem.fit(start={**motion.model.base.values, **static.model.base.values}, patient=True)
    effects = [*static.model.fit.effects, *motion.model.fit.effects]
    full, final = problem, plain
    learned = (*static.result.learned, *motion.result.learned)
    if effects or learned:
        counted = any(isinstance(term, TypedTerm) and not term.moving for term in learned)
        full = (opened(problem, plain) if counted else problem).with_terms(*learned)
        final = full.fit(effects, {**motion.model.fit.values, **static.model.fit.values}, patient=True)
    fitted = jointly_fitted(problem, plain, as_channel_noise(noise), s.fitted, m.fitted)
    scale = lambda fit: max(fit.chi2 / len(fit.residual), 1.0)
    of = lambda p, fit, remaining=None: result_of(p, fit, fitted, noise, scale(fit), remaining)
    before = after = of(problem, plain)
    misses = (static.model.disagrees or motion.model.disagrees) and not learned
    remaining = remaining_misfit(full, final, say) if misses else None
    if remaining is not None:
        after = of(full, remaining.fit, remaining)
    elif final is not plain:
        after = of(full, final)
    # The other law of an edge was asked of the static tests alone.
    after = with_model_form(after, static.result.after.other_law)
    after = with_evidence(after, static.model, problem.faults)
    believed = Believed(full, final, scale(final))
    if remaining is not None:
        believed = Believed(remaining.believing(full), remaining.believed.fit, remaining.believed.scale)
    worse = static.result.instead is not None or motion.result.instead is not None
    instead = ideal_valve(problem, plain, fitted, noise, say) if worse else None
    return _Joint(before, after, instead, remaining, believed, fitted, noise)


def in_one(record: BenchRecord, static: Stage, motion: Stage, say: Progress = lambda _: None) -> Answer:
    """One answer of both stages: words of each, values and error bars of the fit to all tests."""
    s, m = static.result, motion.result
    verdict = max(s.verdict, m.verdict, key=ORDER.index)
    agreed = s.verdict == m.verdict == "consistent"
    lead = s.headline if agreed else f"Static tests: {s.headline}"
    end = m.headline if agreed else f"Dynamic tests: {m.headline}"
    seen = {c.name for c in m.candidates}
    stages = {*unconverged(s.after), *unconverged(m.after)}
    joint = fitted_together(record, static, motion, say)
    before, after, remaining = joint.before, joint.after, joint.remaining
    result = replace(
        s,
        record=record,
        verdict=verdict,
        headline=f"{lead} {end}",
        sentences=(*s.sentences, *m.sentences),
        where=(*s.where, *m.where),
        where_after=(*s.where_after, *m.where_after),
        effects=tuple(_as_fitted(effect, after) for effect in (*s.effects, *m.effects)),
        candidates=(*(c for c in s.candidates if c.name not in seen), *m.candidates),
        absorbed=tuple(dict.fromkeys((*s.absorbed, *m.absorbed))),
        gap_before=before.reduced_chi2,
        gap_after=after.reduced_chi2,
        held_out=m.held_out if m.effects or not s.effects else s.held_out,
        next_test=s.next_test or m.next_test,
        before=before,
        after=after,
        shifts=parameter_shifts(before, after) if s.shifts or m.shifts else (),
        variations=(*s.variations, *m.variations),
        terms=(*s.terms, *m.terms),
        learned=(*s.learned, *m.learned),
        evidence=(*s.evidence, *m.evidence),
        noise=(*s.noise, *m.noise),
        left_over_p=min(s.left_over_p, m.left_over_p),
        evaluations=s.evaluations + m.evaluations,
        suspects=(*s.suspects, *m.suspects),
        proof=min((p for p in (s.proof, m.proof) if p is not None), default=None),
        notes=without_rivals(dict.fromkeys((*s.notes, *m.notes))),  # the joint fit's error bars are its model's
        discrepancy=() if remaining is None else remaining.channels,
        instead=joint.instead,
        # Whether a stage's own last fit converged is of no matter: the joint one began from it.
        warnings=tuple(
            dict.fromkeys((*unconverged(after), *(w for w in (*s.warnings, *m.warnings) if w not in stages)))
        ),
    )
    return Answer(result, joint.believed, joint.fitted, joint.noise)


def _as_fitted(effect: NamedEffect, after: FitResult) -> NamedEffect:
    joint = after.parameters[effect.name]
    return replace(effect, value=joint.value, std=joint.std, ci95=joint.ci95, at_bound=joint.at_bound)


def diagnose(
    record: BenchRecord,
    *,
    learn: bool = False,
    model_form: bool = True,
    without: Iterable[str] = (),
    progress: Progress | None = None,
    and_then: Callable[[Answer], DiagnosisResult] = lambda answer: answer.result,
) -> DiagnosisResult:
    """Find where a record disagrees with the ideal valve, name the missing effects, add them and show the gap close.

    learn: where no effect explains the rest, add to the model the leading typed term, or the leading smooth variation where no
    term holds (both marked as empirical). without: names of effects that are taken out of the library for this diagnosis; a name
    that it does not have raises BenchInputError, with the nearest one.
    model_form: fit the final model of the static tests with the other law of an edge too: an effect that only one law asks
    for is not named, and each estimate says how far the other law moves it.
    Raises what `fit` raises: BenchInputError where the record determines nothing, RuntimeError in single precision.
    Each step can be called alone: `open_case`, `choose`, `final_model`, `conclude`.
    """
    require_float64("diagnose")
    out = known_effects(without)
    begin_work()
    began = time.perf_counter()
    say = progress or (lambda _: None)
    stage = lambda case: diagnose_stage(case, learn=learn, model_form=model_form, say=say)
    if not record.dynamic_tests:
        answer = stage(open_case(record, say, out)).answer
    elif not record.static_tests:
        answer = stage(open_motion(record, say, without=out)).answer
        answer = replace(answer, result=in_words_of_motion(answer.result))
    else:
        static = stage(open_case(replace(record, tests=record.static_tests, actuator=None), say, out))
        amounts = {effect.name: effect.value for effect in static.result.effects}
        motion = stage(open_motion(record, say, static.result.after, amounts, out))
        motion = replace(motion, result=in_words_of_motion(motion.result))
        answer = in_one(record, static, motion, say)
    result = and_then(answer)
    if out:
        result = replace(
            result, notes=(*result.notes, f"taken out of the library for this diagnosis: {', '.join(out)}")
        )
    return replace(result, seconds=time.perf_counter() - began)


def diagnose_stage(
    case: Case, *, learn: bool = False, model_form: bool = False, say: Progress = lambda _: None
) -> Stage:
    """What follows `open_case`; `seconds` of the result is left at 0."""
    case, selection, split = choose(case, say)
    critical = selection.steps[0].screen.critical
    model = without_stand_ins(case, final_model(case, selection, split, say), split, critical, say)
    model = without_unearned(case, model, split)
    ended = concluded(case, selection, split, model, learn=learn, model_form=model_form, say=say)
    return Stage(case, model, *ended)


def diagnose_case(
    case: Case, *, learn: bool = False, model_form: bool = False, say: Progress = lambda _: None
) -> DiagnosisResult:
    """The answer of an opened case."""
    return diagnose_stage(case, learn=learn, model_form=model_form, say=say).result
