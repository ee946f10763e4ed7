"""Prepare a record for diagnosis: fit the ideal valve, measure the noise, fit again by generalised least squares; then search.

A `Case` holds the plain fit, the noise and the ideal valve fitted with it. `choose` runs the forward selection of effects on the
rows that are not held out (docs/diagnosis.md sections 1 and 9).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fitting.bench_faults import faults_of
from thermohyd.identify.fitting.fit import run_fit
from thermohyd.identify.fitting.library import library_for
from thermohyd.identify.fitting.outcome import Fitted, Key
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.trimmed import FAR

from .held_out import Split, split_rows
from .max_t import NoiseFreedom
from .record_noise import NoiseEstimate, Repeats, estimated_noise, first_noise, noise_of, repeats_of
from .screening import finite_steps
from .search import LEVEL, Selection, prune, search


Progress = Callable[[str], None]


@dataclass(frozen=True)
class Case:
    """A record with its plain fit, its noise, and the ideal valve fitted to all its rows."""

    fitted: Fitted
    problem: Problem
    repeats: dict[Key, Repeats | None]
    noise: dict[Key, NoiseEstimate]
    base: Fit
    steps: dict[str, np.ndarray]  # finite-step signatures of every effect beside `base`

    @property
    def freedom(self) -> NoiseFreedom:
        """Of every channel's noise; priors, which come last, are stated."""
        rows = self.problem.rows()
        channel = np.full(len(self.base.residual), len(rows))
        for number, place in enumerate(rows.values()):
            channel[place] = number
        return NoiseFreedom(channel, np.array([*(self.noise[key].degrees_of_freedom for key in rows), np.inf]))


def open_case(record: BenchRecord, say: Progress = lambda _: None, without: tuple[str, ...] = ()) -> Case:
    """Fit the ideal valve as `fit` does, measure the noise, and fit it again by generalised least squares.

    without: names of effects that are not looked for.
    """
    fitted = run_fit(record, progress=say, by_blocks=True)
    say("measuring the noise")
    # Where so many readings are no readings that they stay in, an amount fitted to them would be theirs.
    spoiled = any(not fault.masked for test in fitted.tests.values() for fault in test.faults)
    problem = Problem(
        record,
        fitted.tests,
        fitted.plans,
        library_for(fitted.tests.values()).without(without),
        first_noise(fitted.noise),
        faults={} if spoiled else faults_of(fitted.tests),
    )
    repeats = {
        (test.name, c.name): repeats_of(test, c, fitted.noise[test.name, c.name].std)
        for test in fitted.tests.values()
        for c in test.channels
    }
    start = fitted.values
    base = problem.fit(start=start)
    if base.chi2 > FAR * len(base.residual):
        # A valve bent by what it misses: the plain fit's valley need not be the deepest one.
        other = problem.fit(start={"null_bias": start.get("null_bias", base.values["null_bias"])}, hop_basins=True)
        base = problem.unbent(min(base, other, key=lambda fit: fit.chi2))
    return with_noise_around(Case(fitted, problem, repeats, {}, base, {}), base)


def with_noise_around(case: Case, fit: Fit) -> Case:
    """The case with its noise measured beside `fit`, and the ideal valve fitted with it."""
    noise = estimated_noise(case.problem, fit, case.fitted.noise, case.repeats)
    problem = case.problem.with_noise(noise_of(noise))
    base = problem.fit(start=case.base.values, hop_basins=True)
    steps = finite_steps(problem, problem.with_all_columns(base), problem.library.names)
    return replace(case, problem=problem, noise=noise, base=base, steps=steps)


# The choice is made on the rows that are not held out; where those show nothing, all rows are asked, at what is left.
# Chi-square that an effect of the first search must be worth once the noise was measured again: odds of 400 to 1.
STILL_THERE = 12.0
# Two looks share the level of one (Bonferroni), the first the larger part because what it names is proven on rows apart.
LEVEL_OF_CHOICE, LEVEL_OF_ALL_ROWS = 0.6 * LEVEL, 0.4 * LEVEL


def choose(case: Case, say: Progress = lambda _: None) -> tuple[Case, Selection, Split]:
    """Choose the missing effects by forward selection on the rows that are not held out.

    Twice: noise that no repeats measured is measured again beside the model that the first search found. Noise in motion was
    taken for white so far: it is measured where nothing was found, too.
    """
    split = split_rows(case.fitted.tests)
    before, p_values = None, {}
    for last in (False, True):
        say("searching for missing effects")
        chosen = case.problem.with_rows(~split.held)
        base = chosen.fit(start=case.base.values)
        begin = None
        if before is not None:
            begin = prune(chosen, chosen.fit(before.effects, before.values), before.effects, STILL_THERE)[0]
        selection = search(
            chosen,
            base,
            case.steps,
            begin=begin,
            level=LEVEL_OF_CHOICE,
            freedom=case.freedom,
            say=say,
        )
        selection = replace(
            selection, p_values={n: {**p_values, **selection.p_values}.get(n, 1.0) for n in selection.effects}
        )
        measured = not selection.effects and not case.problem.in_motion
        if last or measured or all(r is not None for r in case.repeats.values()):
            return case, selection, split
        if selection.effects:
            before = case.problem.fit(selection.effects, selection.final.values)
            p_values = selection.p_values
        case = with_noise_around(case, before or case.base)
    raise AssertionError
