"""A fit, and what is known of each of its parameters beyond the covariance: profiles, posterior, coverage, as far as they are asked."""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fitting.fit import STARTS, fit_and_fitted
from thermohyd.identify.fitting.outcome import Fitted, uncertainty_of
from thermohyd.identify.fitting.result import FitResult

from .coverage import coverage_of
from .finished_fit import FinishedFit
from .posterior import Sampling, posterior_of
from .predictions import predictions_of
from .profiles import profiles_of
from .remedy import remedies
from .result import Knowledge, KnownParameter
from .rows import known_parameter


SEED = 20110913

Progress = Callable[[str], None]


def fit_in_depth(
    record: BenchRecord,
    *,
    effects: Iterable[str] = (),
    model_form: bool = False,
    starts: int = STARTS,
    profile: bool = True,
    posterior: Sampling | bool = False,
    coverage: int = 0,
    seed: int = SEED,
    progress: Progress | None = None,
) -> FitResult:
    """`fit`, whose result says in `knowledge` what is known of each free parameter (docs/uncertainty.md).

    profile: likelihood profiles of all free parameters and amounts, and intervals of figures of the valve. posterior: draws by the
    no-U-turn sampler, of records of static tests; a `Sampling` says how many. coverage: so many records simulated at the fit, and
    fitted. seed: of draws and simulations.
    Raises as `fit` does, and BenchInputError where the posterior cannot be asked for.
    """
    began = time.perf_counter()
    say = progress or (lambda _: None)
    result, fitted = fit_and_fitted(record, effects=effects, model_form=model_form, starts=starts, progress=progress)
    sampling = (Sampling(seed=seed) if posterior else None) if isinstance(posterior, bool) else posterior
    if result.converged and result.free:
        knowledge = knowledge_of(result, fitted, say, profile=profile, sampling=sampling, coverage=coverage, seed=seed)
        result = replace(result, knowledge=knowledge)
    return replace(result, seconds=time.perf_counter() - began)


def knowledge_of(
    result: FitResult,
    fitted: Fitted,
    say: Progress = lambda _: None,
    *,
    profile: bool = True,
    sampling: Sampling | None = None,
    coverage: int = 0,
    seed: int = SEED,
) -> Knowledge:
    """What is known of each free parameter of a converged fit."""
    around = FinishedFit(fitted, uncertainty_of(fitted))
    drawn = None if sampling is None else posterior_of(fitted, around.known, sampling, say)
    profiles, notes = profiles_of(around, say) if profile else ({}, ())
    predictions, without_end = predictions_of(around, say) if profile else ((), ())
    notes = (*notes, *without_end)
    rows = {name: known_parameter(result, fitted, name, profiles.get(name)) for name in fitted.free}
    covered, failed = coverage_of(around, coverage, seed, say) if coverage else ({}, 0)
    moving = any(test.in_motion for test in fitted.tests.values())
    fixes = {}
    if not moving:
        fixes = remedies(
            around, (name for name, row in rows.items() if row.verdict != "identified" or _loose(row)), say
        )
    for name, row in rows.items():
        of = drawn.parameters.get(name) if drawn is not None else None
        rows[name] = replace(row, posterior=of, coverage=covered.get(name), remedy=fixes.get(name))
    if drawn is not None:
        notes = (*notes, *((drawn.trouble,) if drawn.trouble else ()), *drawn.notes)
    return Knowledge(rows, profile, drawn, coverage, failed, seed, notes, predictions)


WIDE = 0.1  # standard error over value, from which on a better test is looked for even where a parameter is identified
TIED = 0.9  # correlation from which on it is


def _loose(row: KnownParameter) -> bool:
    wide = row.std is not None and row.std > WIDE * abs(row.value)
    return wide or (row.trades_with is not None and abs(row.trades_with[1]) > TIED)
