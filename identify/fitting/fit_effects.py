"""Fit a record's static tests with effects freed that the user names, beside the parameters of the plain fit."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord

from .library import library_for
from .outcome import Fitted
from .problem import Problem
from .problem_fit import Fit
from .problem_solution import noise_settled_by, solution_of
from .readings import white_noise
from .relative import effect_plans
from .uncertainty import largest_change


Progress = Callable[[str], None]


def known_effects(record: BenchRecord, names: Iterable[str]) -> tuple[str, ...]:
    """The names, each once. Raises BenchInputError where the library has no such effect or the record cannot speak of it."""
    names = tuple(dict.fromkeys(names))
    if not names:
        return names
    library = library_for(record.static_tests.values())
    for name in names:
        if name in library.impossible:
            raise BenchInputError(f"{name} cannot be fitted: {library.impossible[name]}", file=record.folder)
        if name not in library.names:
            known = ", ".join(library.names)
            raise BenchInputError(f'there is no effect "{name}" of static tests; known: {known}', file=record.folder)
    return names


def fit_with(
    plain: Fitted, effects: tuple[str, ...], progress: Progress | None = None, *, rounds: int, enough: float
) -> Fitted:
    """The fit once more with these effects free, from where the plain one ended; the noise is settled anew (`settled`)."""
    say = progress or (lambda _: None)
    say(f"fitting {', '.join(effects)} beside the parameters")
    library = library_for(plain.tests.values())
    plans = {**plain.plans, **effect_plans(effects, plain.record)}
    problem = Problem(plain.record, plain.tests, plain.plans, library, white_noise(plain.noise))
    # Far, as the plain fit goes: of 126 records with a hidden effect three had ended 4 to 10 um of underlap off.
    fit = problem.fit(effects, _best_start(problem, plain, effects).values, hop_basins=True, far=True)
    begun = Fitted(plain.record, plain.tests, plans, fit.free, plain.noise, fit.solution, plain.starts, plain.warnings)
    return settled(problem, fit, begun, rounds=rounds, enough=enough)


def _best_start(problem: Problem, plain: Fitted, effects: tuple[str, ...]) -> Fit:
    """The lower end of two searches: from the plain fit, and from the nominal valve with its null.

    A valve that misses a large effect has bent its parameters to the misfit, and a search from there may end in a local minimum.
    """
    null = {name: plain.values[name] for name in ("null_bias",) if name in plain.values}
    amounts = {name: info.scale for name in effects if (info := effect_info(name)).lower == 0.0}
    ends = [problem.fit(effects, start) for start in (plain.values, {**null, **amounts})]
    return min(ends, key=lambda fit: fit.chi2 if np.isfinite(fit.chi2) else np.inf)


def settled(problem: Problem, fit: Fit, fitted: Fitted, *, rounds: int, enough: float) -> Fitted:
    """Rounds of re-estimating the noise that is not known, each from the last optimum, until it changes by no more than `enough`."""
    noise = fitted.noise
    seen = fit
    for _ in range(rounds):
        again = noise_settled_by(problem, fit, noise)
        change, noise = largest_change(noise, again), again
        if change == 0.0:
            break
        problem = problem.with_noise(white_noise(noise))
        if change < enough:
            seen = problem.evaluate(fit.values, fit.effects)
            break
        seen = fit = problem.fit(fit.effects, fit.values)
    return replace(fitted, noise=noise, solution=solution_of(problem, fit, seen))
