"""How often would the intervals of this fit hold the truth? Records simulated at the fit, with its noise, fitted as it was.

A parametric bootstrap (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6): the same rows, the fit's values as the
truth, noise of the size and memory that the fit estimated. What the model misses of the bench is not in it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter
from scipy.special import betaincinv

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.fit import StaticSearch, with_intervals
from thermohyd.identify.fitting.outcome import Fitted, Uncertainty, fit_result
from thermohyd.identify.fitting.parameters import ParameterPlan
from thermohyd.identify.fitting.problem_solution import solution_of
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.fitting.static_readings import channel_slices
from thermohyd.identify.fitting.uncertainty import Block

from .finished_fit import FinishedFit, effects_of, problem_of
from .result import CoverageOf


def coverage_of(
    around: FinishedFit, records: int, seed: int, say: Callable[[str], None] = lambda _: None
) -> tuple[dict[str, CoverageOf], int]:
    """{free parameter: how often its 95 % interval held the fit's value}, and how many fits did not converge.

    A simulated fit goes the fit's own way to its intervals, profiles where its covariance does not hold; its search begins at the
    truth. A fit that gives a parameter no interval does not count for it.
    """
    truth = around.fitted.values
    held, given, failed = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0), 0
    for k in range(records):
        say(f"simulated record {k + 1} of {records}")
        result = refitted(around, simulated(around.fitted, around.known, np.random.default_rng((seed, k))))
        if result is None:
            failed += 1
            continue
        for name, value in truth.items():
            interval = result.parameters[name].ci95
            if interval is not None:
                given[name] += 1
                held[name] += interval[0] <= value <= interval[1]
    return {
        name: CoverageOf(name, held[name], given[name], *clopper_pearson(held[name], given[name])) for name in truth
    }, failed


def clopper_pearson(held: int, records: int, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a share."""
    tail = 0.5 * (1.0 - level)
    low = 0.0 if held == 0 else float(betaincinv(held, records - held + 1, tail))
    high = 1.0 if held == records else float(betaincinv(held + 1, records - held, 1.0 - tail))
    return low, high


def simulated(fitted: Fitted, known: Uncertainty, rng: np.random.Generator) -> Fitted:
    """The fit's record as it might have been read: other noise, and other centres of the priors, as these are readings too."""
    slices = channel_slices(fitted.tests)
    tests: dict[str, TestRecord] = {}
    for name, test in fitted.tests.items():
        channels = []
        for channel in test.channels:
            key = (name, channel.name)
            used = fitted.noise[key].used
            exact = channel.value + fitted.solution.residual[slices[key]] * used
            channels.append(replace(channel, value=exact + used * noise_like(known.blocks[key], rng)))
        tests[name] = replace(test, channels=tuple(channels))
    plans: dict[str, ParameterPlan] = {}
    for name, plan in fitted.plans.items():
        plans[name] = plan
        if plan.prior is not None and name in fitted.free:
            centre = fitted.values[name] + plan.prior.std * float(rng.standard_normal())
            plans[name] = replace(plan, prior=replace(plan.prior, value=centre))
    return replace(fitted, tests=tests, plans=plans)


def noise_like(block: Block, rng: np.random.Generator) -> np.ndarray:
    """Noise of a channel's rows in units of what the fit believed: its excess, and its memory along every sweep."""
    rows = block.rows.stop - block.rows.start
    share, phi = block.correlation.share, block.correlation.phi
    white = rng.standard_normal(rows)
    if share > 0.0 and phi > 0.0:
        remembered = np.empty(rows)
        for sweep in np.unique(block.sweeps):
            own = np.flatnonzero(block.sweeps == sweep)
            pushes = rng.standard_normal(len(own)) * np.sqrt(1.0 - phi**2)
            pushes[0] /= np.sqrt(1.0 - phi**2)
            remembered[own] = lfilter([1.0], [1.0, -phi], pushes)
        white = np.sqrt(share) * remembered + np.sqrt(1.0 - share) * white
    return np.sqrt(block.variance) * white


def refitted(around: FinishedFit, there: Fitted) -> FitResult | None:
    """The fit of a simulated record; None where it did not converge."""
    if around.plain:
        search = StaticSearch(there.record, there.tests, there.plans, there.free)
        solution = search.solve(search.args(there.noise), around.fitted.solution.p)
        noise = search.settle(there.noise, solution)
        solution = search.solve(search.args(noise), solution.p)
        there = replace(there, noise=noise, solution=solution)
        return with_intervals(there, None, settle=False)[1] if solution.converged else None
    problem = problem_of(there)
    fit = problem.fit(effects_of(there), around.fitted.values, patient=True)
    return fit_result(replace(there, solution=solution_of(problem, fit))) if fit.converged else None
