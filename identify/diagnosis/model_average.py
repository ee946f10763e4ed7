"""Error bars over all models that the data allow: where rivals explain a record alike, each of them has parameters of its own; so
has a model with what the search found and no rows left out proved, or with what it nearly found.

Weights are likelihoods, exp(-chi-square/2) (Burnham and Anderson, Model Selection and Multimodel Inference, 2002, ch. 4); values stay
those of the model that is named first, so that what it predicts is one model's.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from thermohyd.identify.fitting.bench_faults import kind_of
from thermohyd.identify.fitting.result import FitResult, ParameterEstimate

from .rivals import Rival


SPANS = "error bars span what the data allow"


def without_rivals(notes: Iterable[str]) -> tuple[str, ...]:
    """The notes of a result whose error bars are one model's."""
    return tuple(note for note in notes if not note.startswith(SPANS))


def of_either_sign(estimate: ParameterEstimate) -> bool:
    """Whether the interval of an effect's amount spans its mirror, too."""
    return _of_the_other_sign(estimate.name) in estimate.averaged_over


def _of_the_other_sign(name: str) -> str:
    return f"{name} of the other sign"


def with_rivals(result: FitResult, tried: Sequence[Rival], spread_of: Mapping[int, Mapping[str, float]]) -> FitResult:
    """The result of a final model with error bars that span its rivals, and models with more that are not proven.

    spread_of {id of a rival's fit: {entry: standard error}}. A parameter that a rival does not have, or not free, is not moved by it. A
    model that fits better than the final one weighs as much as that.
    """
    if not tried:
        return result
    weights = np.exp(-0.5 * np.array([max(r.chi2_more, 0.0) for r in tried]))
    wider, parameters = {}, {}
    words = lambda r: _of_the_other_sign(r.name) if r.name == r.instead_of else kind_of(r.name)
    for name, estimate in result.parameters.items():
        parameters[name] = estimate
        if not estimate.std:
            continue
        total, square, others = 1.0, estimate.std**2, []
        for r, weight in zip(tried, weights, strict=True):
            std = spread_of[id(r.fit)].get(name)
            if std is not None:
                others.append(words(r))
                total += weight
                square += weight * (std**2 + (r.fit.values[name] - estimate.value) ** 2)
        wider[name] = max(float(np.sqrt(square / total)) / estimate.std, 1.0)
        parameters[name] = replace(_widened(estimate, wider[name]), averaged_over=tuple(dict.fromkeys(others)))
    factor = np.array([wider.get(name, 1.0) for name in result.free])
    in_place, beside = ([words(r) for r in tried if bool(r.instead_of) is named] for named in (True, False))
    parts = [
        f"{', '.join(dict.fromkeys(names))} {where}"
        for names, where in ((in_place, "in its place"), (beside, "beside it, neither proven nor excluded"))
        if names
    ]
    note = (
        f"{SPANS} beside the {'named' if in_place else 'final'} model: {'; '.join(parts)}, weighed by their likelihood"
    )
    return replace(
        result,
        parameters=parameters,
        covariance=result.covariance * np.outer(factor, factor),
        notes=(*result.notes, note),
    )


def _widened(estimate: ParameterEstimate, factor: float) -> ParameterEstimate:
    assert estimate.std is not None
    interval = estimate.ci95
    if interval is not None:
        low, high = (estimate.value + factor * (end - estimate.value) for end in interval)
        interval = (max(low, estimate.lower), min(high, estimate.upper))
    return replace(estimate, std=factor * estimate.std, ci95=interval)
