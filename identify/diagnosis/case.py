"""A record opened for diagnosis: its plain fit, its noise, and the ideal valve fitted with that noise."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..fit import run_fit
from ..fitted import Fitted, Key
from ..record import BenchRecord
from .library import library_for
from .library_fit import LibraryFit, LibraryProblem
from .record_noise import NoiseFound, Repeats, first_noise, found_noise, noise_of, repeats_of
from .screening import finite_steps
from .search import FAR


Progress = Callable[[str], None]


@dataclass(frozen=True)
class Case:
    """A record with its plain fit, its noise, and the ideal valve fitted to all its rows."""

    fitted: Fitted
    problem: LibraryProblem
    repeats: dict[Key, Repeats | None]
    noise: dict[Key, NoiseFound]
    base: LibraryFit
    steps: dict[str, np.ndarray]  # finite-step signatures of every effect beside `base`


def open_case(record: BenchRecord, say: Progress = lambda _: None) -> Case:
    """Fit the ideal valve as `fit` does, measure the noise, and fit it again by generalised least squares."""
    fitted = run_fit(record, progress=say)
    say("measuring the noise")
    problem = LibraryProblem(
        record, fitted.tests, fitted.plans, library_for(fitted.tests.values()), first_noise(fitted.noise)
    )
    repeats = {
        (test.name, c.name): repeats_of(test, c, fitted.noise[test.name, c.name].std)
        for test in fitted.tests.values()
        for c in test.channels
    }
    start = dict(zip(fitted.free, (float(v) for v in fitted.solution.p), strict=True))
    base = problem.fit(start=start)
    if base.chi2 > FAR * len(base.residual):
        # A valve bent by what it misses: the plain fit's valley need not be the deepest one.
        other = problem.fit(start={"null_bias": start.get("null_bias", base.values["null_bias"])}, hops=True)
        base = min(base, other, key=lambda fit: fit.chi2)
    return with_noise_around(Case(fitted, problem, repeats, {}, base, {}), base)


def with_noise_around(case: Case, fit: LibraryFit) -> Case:
    """The case with its noise measured beside `fit`, and the ideal valve fitted with it."""
    noise = found_noise(case.problem, fit, case.fitted.noise, case.repeats)
    problem = case.problem.with_noise(noise_of(noise))
    base = problem.fit(start=case.base.values, hops=True)
    steps = finite_steps(problem, problem.with_all_columns(base), problem.library.names)
    return replace(case, problem=problem, noise=noise, base=base, steps=steps)
