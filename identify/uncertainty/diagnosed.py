"""A diagnosis, and draws of the posterior of the model that it ends with: parameters, amounts of effects, faults of the bench, beside
what the model misses where something remains."""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.diagnosis.conclusion import as_fitted
from thermohyd.identify.diagnosis.diagnose import Answer, diagnose
from thermohyd.identify.diagnosis.found_faults import unit_of, where
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.bench_faults import BenchFault, is_fault
from thermohyd.identify.fitting.result import FitResult

from .posterior import Sampling, posterior_of_a_problem
from .result import Knowledge, Posterior
from .rows import known_parameter
from .sampler import sampler_or_sentence
from .study import SEED, Progress


def diagnose_in_depth(
    record: BenchRecord,
    *,
    learn: bool = False,
    model_form: bool = True,
    without: Iterable[str] = (),
    posterior: Sampling | None = None,
    seed: int = SEED,
    progress: Progress | None = None,
) -> DiagnosisResult:
    """`diagnose`, and draws of the posterior of the model that it ends with, in `after.knowledge` (docs/uncertainty.md).

    The likelihood is the one that its error bars stand for: noise with its memory, faults of the bench, and where a misfit remains the
    discrepancy beside it. posterior: how many draws; seed: theirs. Rivals are no part of the model that is drawn from.
    Raises as `diagnose` does, and BenchInputError, before it begins, where a term is to be learned (its coefficients are not drawn) or
    where the sampler is not installed.
    """
    if learn:
        raise BenchInputError("--posterior and --learn do not go together: a learned term's coefficients are not drawn")
    sampler_or_sentence()
    began = time.perf_counter()
    say = progress or (lambda _: None)
    sampling = posterior or Sampling(seed=seed)
    result = diagnose(
        record,
        model_form=model_form,
        without=without,
        progress=progress,
        and_then=lambda answer: with_posterior(answer, sampling, say),
    )
    return replace(result, seconds=time.perf_counter() - began)


def with_posterior(
    answer: Answer, sampling: Sampling | None = None, say: Callable[[str], None] = lambda _: None
) -> DiagnosisResult:
    """The answer of a diagnosis with draws of its final model in `after.knowledge`."""
    result, believed = answer.result, answer.believed
    problem, fit, after = believed.problem, believed.fit, result.after
    sampling = sampling or Sampling()
    faults = {name: problem.faults[name] for name in fit.free if is_fault(name)}
    names = [in_words(faults[name]) if name in faults else name for name in fit.free]
    sizes = [faults[name].size if name in faults else 1.0 for name in fit.free]
    drawn = posterior_of_a_problem(problem, fit, believed.scale, names, sizes, sampling, say)
    whole = as_fitted(problem.with_discrepancy(None), fit, answer.fitted, answer.noise)
    rows = {name: known_parameter(after, whole, name) for name in after.free}
    rows = {name: replace(row, posterior=drawn.parameters.get(name)) for name, row in rows.items()}
    notes = (
        *((drawn.trouble,) if drawn.trouble else drawn.notes),
        *_faults(drawn, list(faults.values())),
        *_what_is_drawn(result, after),
    )
    knowledge = Knowledge(rows, posterior=drawn, seed=sampling.seed, notes=notes)
    return replace(result, after=replace(after, knowledge=knowledge))


def in_words(fault: BenchFault) -> str:
    """What the draws of a fault's amount are called."""
    return f"{fault.kind} ({where(fault)})"


def _faults(drawn: Posterior, faults: list[BenchFault]) -> list[str]:
    """A sentence for each fault of the bench, which has no row among the parameters."""
    said = []
    for fault in faults:
        found = drawn.parameters.get(in_words(fault))
        if found is not None:
            unit, ends = unit_of(fault), found.at(0.95)
            low, high = (f"{end * unit.factor:.3g}" for end in (ends.low, ends.high))
            said.append(f"{in_words(fault)}: posterior 95 % {low} to {high} {unit.label}")
    return said


def _what_is_drawn(result: DiagnosisResult, after: FitResult) -> list[str]:
    """What the draws know, and what they do not."""
    said = []
    if result.discrepancy:
        said.append(
            "the posterior knows the readings to their noise and to what the model misses, as the error bars do, whatever the fit that is "
            "reported weighs them by"
        )
    if any(after.parameters[name].averaged_over for name in after.free):
        said.append(
            "the posterior is of the model that is named; what rivals make of a parameter is in its error bar only"
        )
    return said
