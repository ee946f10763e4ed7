"""What does the other law of an edge say? The same tests, noise and effects fitted with it, and what that adds to the error bars.

Two laws of an edge are defensible (docs/physics.md sections 3 and 3.1), and no error bar of one of them knows of the other.
Statistics: docs/diagnosis.md section 6.1.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from thermohyd.effects.library import factor_on, find_effect
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord

from .library import Library, asks_for_more
from .outcome import Fitted
from .parameters import ParameterPlan, effect_plan, heat_retention, identified_by_default, plan_parameters, readings_of
from .problem import Problem
from .problem_fit import Fit
from .problem_solution import solution_of
from .result import DISAGREES, FitResult, ModelForm, OtherLaw, ParameterEstimate
from .sensed import sensed_channels


OTHER = {"orifice": "lubrication", "lubrication": "orifice"}
# Difference of Akaike's criterion from which on the worse law has essentially no support (Burnham and Anderson, *Model
# Selection and Multimodel Inference*, 2002, section 2.6). Chance reaches it for a wrong law in one record of a thousand at most.
PREFERRED = 10.0
# A move is far beyond the error bar from so many standard errors on, and worth a sentence from these shares of the larger value
# and of the parameter's natural step on: a discharge coefficient that moves by 1 % is determined well enough.
FAR, WORTH_SAYING, OF_A_STEP = 5.0, 0.25, 0.1


def with_other_law(record: BenchRecord) -> BenchRecord:
    """The record as if its `[valve]` named the other law."""
    return replace(record, valve=replace(record.valve, edge_law=OTHER[record.valve.edge_law]))


def plans_with_other_law(fitted: Fitted) -> tuple[BenchRecord, dict[str, ParameterPlan], tuple[str, ...]]:
    """(record, plans, names of the free parameters) of the same static tests with the other law.

    Nothing is free where the record frees nothing that this law has, or has too few readings for one parameter more.
    """
    record, plans = _with_plans(fitted.record, fitted.plans, fitted.tests)
    free = tuple(name for name, plan in plans.items() if not plan.fixed)
    return record, plans, free if readings_of(fitted.tests) >= len(free) else ()


def _with_plans(
    record: BenchRecord, plans: Mapping[str, ParameterPlan], tests: Mapping[str, TestRecord]
) -> tuple[BenchRecord, dict[str, ParameterPlan]]:
    """The record with the other law and its plans; what sensors add to a fit or hold in it stays as `plans` have it."""
    there = with_other_law(record)
    planned = plan_parameters(record.valve, record.start)
    found = plan_parameters(there.valve, there.start)
    for name, plan in found.items():
        if name in planned and (was := plans.get(name)) is not None:
            held = was.fixed if was.fixed != planned[name].fixed else plan.fixed
            found[name] = replace(plan, fixed=held, relative=was.relative, prior=was.prior)
            if was.prior is not None and was.prior.why:
                found[name] = replace(found[name], start=was.start)
    behind = (name for sensor in sensed_channels(tests).values() for name in sensor.names)
    return there, found | {name: plans[name] for name in behind if name in plans}


def refit(problem: Problem, effects: Iterable[str], values: Mapping[str, float]) -> tuple[Problem, Fit]:
    """A problem of static tests with the other law, and its fit with the same effects free: from `values` and from the nominal
    edges, over the kinks of the underlap. Noise, priors, rows and learned terms stay as they are.

    The programs are those of any effects, which other records and the cache on disk share; where they take long to compile, one
    of these effects alone, since nobody searches here.
    """
    effects = tuple(effects)
    library = problem.library
    if asks_for_more(effects):
        present = {*effects, str(factor_on("viscosity"))}
        library = Library(tuple(name for name in library.names if name in present), {})
    record, plans = _with_plans(problem.record, problem.plans, problem.tests)
    there = replace(problem, record=record, plans=plans, library=library)
    kept = {name: value for name, value in values.items() if name == "null_bias" or name not in there.plans}
    ends = [there.fit(effects, start) for start in (dict(values), kept)]
    best = min(ends, key=lambda end: end.chi2 if np.isfinite(end.chi2) else np.inf)
    return there, there.fit(effects, best.values, hop_basins=True)


def fitted_with(problem: Problem, fit: Fit, fitted: Fitted) -> Fitted:
    """A fit of `refit` as a fit hands it over, with the noise of `fitted`."""
    plans = {**problem.plans, **{name: effect_plan(name) for name in fit.effects}}
    solution = solution_of(problem, fit)
    return Fitted(problem.record, fitted.tests, plans, fit.free, fitted.noise, solution, (), ())


def evidence(own_chi2: float, other_chi2: float, own_free: int, other_free: int, readings: float) -> float:
    """By how much Akaike's criterion, corrected for few readings, is lower with the other law. Chi-squares of independent readings."""

    def criterion(chi2: float, free: int) -> float:
        return chi2 + 2.0 * free + 2.0 * free * (free + 1.0) / max(readings - free - 1.0, 1.0)

    return criterion(own_chi2, own_free) - criterion(other_chi2, other_free)


def evidence_of_fits(own: FitResult, other: FitResult) -> float:
    """`evidence` of two plain fits, whose rows were weighed as independent.

    A channel's difference of chi-square counts for the independent readings that its points are worth beside the better law
    (the two curves differ smoothly, and so weigh the noise at its slowest), in units of what that law leaves there.
    """
    better = min(own, other, key=lambda fit: fit.chi2)
    count = [c.effective_size / len(c.measured) / max(c.reduced_chi2, 1.0) for c in better.channels]

    def worth(fit: FitResult) -> float:
        readings = sum(s * c.reduced_chi2 * len(c.measured) for s, c in zip(count, fit.channels, strict=True))
        priors = sum(((e.value - e.start) / e.prior_std) ** 2 for e in fit.parameters.values() if e.prior_std)
        return readings + priors

    readings = sum(c.effective_size for c in better.channels)
    return evidence(worth(own), worth(other), len(own.free), len(other.free), readings)


def other_law(own: FitResult, other: FitResult, evidence: float) -> OtherLaw:
    """What the record says of the two laws, both fitted to it at one noise. evidence: positive where it speaks for `other`."""
    better = other if evidence > 0.0 else own
    misfit = any(c.noise_known and c.reduced_chi2 >= DISAGREES for c in better.channels)
    sure = abs(evidence) > PREFERRED and better.converged and not misfit
    return OtherLaw(
        law=other.record.valve.edge_law,
        own=own.record.valve.edge_law,
        chi2=other.chi2,
        own_chi2=own.chi2,
        evidence=evidence,
        preferred=better.record.valve.edge_law if sure else None,
        misfit=misfit,
        converged=other.converged,
        message=other.message,
        parameters=other.parameters,
        own_converged=own.converged,
    )


def with_model_form(result: FitResult, asked: OtherLaw | None) -> FitResult:
    """The result with what the other law makes of every free parameter of the valve and every effect that it has."""
    if asked is None:
        return result
    if not (asked.converged and result.converged):
        return replace(result, other_law=asked)
    steps = {name: info.scale for name, info in identified_by_default(result.record.valve).items()}
    steps[heat_retention().name] = heat_retention().scale
    steps |= {name: info.scale for name in asked.parameters if (info := find_effect(name)) is not None}
    seen = {name for name in result.parameters if name in steps}
    parameters = {
        name: replace(estimate, model_form=_model_form(estimate, asked, steps[name]))
        if name in seen and not estimate.fixed
        else estimate
        for name, estimate in result.parameters.items()
    }
    return replace(result, parameters=parameters, other_law=asked)


def _model_form(own: ParameterEstimate, asked: OtherLaw, step: float) -> ModelForm:
    """A parameter with both laws.

    The truth may lie anywhere between the two laws' values, none of them likelier: about this law's value such a parameter has
    the standard deviation |move|/sqrt(3), which adds to the noise in squares (GUM, JCGM 100:2008, 4.3.7 and 5.1.2). The
    interval is not computed from that: it holds the 95 % intervals of both laws, so that it holds the truth as often
    as the interval of the right one does.
    """
    other = asked.parameters.get(own.name)
    if other is None:
        return ModelForm(asked.law, None, asked.chi2, None, None)
    move = other.value - own.value
    std = None if own.std is None else float(np.hypot(own.std, move / np.sqrt(3.0)))
    ends = [(e.value, e.value) if e.ci95 is None and e.at_bound else e.ci95 for e in (own, other)]
    interval = None if None in ends else (min(e[0] for e in ends if e), max(e[1] for e in ends if e))
    size = max(abs(own.value), abs(other.value))
    far = own.std is not None and abs(move) > max(FAR * own.std, WORTH_SAYING * size, OF_A_STEP * step)
    return ModelForm(asked.law, other.value, asked.chi2, std, interval, far and asked.preferred is None)
