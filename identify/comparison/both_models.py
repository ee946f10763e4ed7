"""One model for two records: each is diagnosed, and what either asks for stands in both, with an amount of its own.

A record whose model lacks an effect that the other one has bends its parameters to it, and differences of bent parameters are
false. Two names for one thing must not stand beside each other either: what neither record loses without the other goes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.effects.effect_info import EffectInfo
from thermohyd.effects.library import effect_info, find_effect
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.diagnosis.case import Case, open_case
from thermohyd.identify.diagnosis.diagnose import Stage, diagnose_stage, in_one, in_words_of_motion, open_motion
from thermohyd.identify.diagnosis.max_t import NoiseFreedom
from thermohyd.identify.diagnosis.record_noise import noise_of
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.bench_faults import info_of, is_fault
from thermohyd.identify.fitting.library import Library, asks_for_more
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import misfit_scale

from .joint_fit import Part


Progress = Callable[[str], None]
# Chi-square that an effect must be worth in one of the records, where no search says what chance gives the whole library.
LEAST_LOSS = 12.0
FAR_FROM_DROPPED = 10.0  # times that by the linear estimate: then no refit is asked
ALIKE = 6.0  # chi-square within which a rival, put into both records, explains them as well
MOST_RIVALS = 4
MUCH_NEARER = 0.5  # of the squared distance: from here on another optimum is taken for the nearer one


@dataclass(frozen=True)
class Diagnosed:
    """One record with its diagnosis, and the model in which that ended, fitted to all tests."""

    name: str
    record: BenchRecord
    diagnosis: DiagnosisResult
    problem: Problem
    fit: Fit
    freedom: NoiseFreedom

    @property
    def scale(self) -> float:
        """Variance of the whitened residuals, at least 1."""
        return misfit_scale(self.problem, self.fit)

    def fitted_with(self, effects: Iterable[str], *, stays: bool = False) -> "Diagnosed":
        """The same with these effects of its library freed, and its own faults of the bench."""
        chosen = (*(n for n in effects if n in self.problem.library.names), *self.fit.faults)
        if set(chosen) == set(self.fit.effects):
            return self
        return replace(self, fit=self.problem.fit(chosen, self.fit.values, hop_basins=stays))

    @property
    def part(self) -> Part:
        return Part(self.name, self.problem, self.fit.effects, self.fit.values, self.scale, self.freedom)


def diagnosed(name: str, record: BenchRecord, say: Progress = lambda _: None) -> Diagnosed:
    """Diagnose a record of static tests, of dynamic ones, or of both. Raises what `diagnose` raises."""
    static = motion = None
    if record.static_tests:
        static = diagnose_stage(open_case(replace(record, tests=record.static_tests, actuator=None), say), say=say)
    if record.dynamic_tests:
        amounts = {} if static is None else {effect.name: effect.value for effect in static.result.effects}
        after = None if static is None else static.result.after
        motion = diagnose_stage(open_motion(record, say, after, amounts), say=say)
        motion = replace(motion, result=in_words_of_motion(motion.result))
    if static is not None and motion is not None:
        return _of_both_kinds(name, record, static, motion, say)
    stage = static or motion
    assert stage is not None
    return Diagnosed(name, record, stage.result, stage.case.problem, stage.model.fit, stage.case.freedom)


def _of_both_kinds(name: str, record: BenchRecord, static: Stage, motion: Stage, say: Progress) -> Diagnosed:
    """As `fitted_together` does, with the problem kept."""
    # Here, not above: static tests do not wait for the solvers of motion.
    from thermohyd.identify.fitting.fit_motion import joint_problem

    s, m = static.case, motion.case
    noise = {**s.noise, **m.noise}
    names = tuple(dict.fromkeys((*s.problem.library.names, *m.problem.library.names)))
    problem = joint_problem(record, s.fitted, m.fitted, noise_of(noise), Library(names, {}))
    problem = replace(problem, faults=s.problem.faults)
    effects = (*static.model.fit.effects, *motion.model.fit.effects)
    fit = problem.fit(effects, {**motion.model.fit.values, **static.model.fit.values}, patient=True)
    freedom = Case(s.fitted, problem, {}, noise, fit, {}).freedom
    return Diagnosed(name, record, in_one(record, static, motion, say).result, problem, fit, freedom)


def with_one_model(a: Diagnosed, b: Diagnosed, say: Progress = lambda _: None) -> tuple[Diagnosed, Diagnosed]:
    """Both with every effect that either diagnosis named, less what neither loses anything without."""
    names = tuple(dict.fromkeys((*a.fit.physics, *b.fit.physics)))
    if not names:
        return a, b
    say("the effects of either record in both")
    a, b = a.fitted_with(names, stays=True), b.fitted_with(names, stays=True)
    needed = max((d.diagnosis.critical_level or 0.0) ** 2 for d in (a, b)) or LEAST_LOSS
    while names:
        linear = [d.fit.linear_losses() for d in (a, b)]
        doubt = [n for n in names if not any(own.get(n, 0.0) > FAR_FROM_DROPPED * needed for own in linear)]
        without = {n: tuple(d.fitted_with(m for m in names if m != n) for d in (a, b)) for n in doubt}
        losses = {n: max(_loss(d, w) for d, w in zip((a, b), pair, strict=True)) for n, pair in without.items()}
        weakest = min(losses, key=lambda n: losses[n], default=None)
        if weakest is None or losses[weakest] > needed:
            break
        names = tuple(n for n in names if n != weakest)
        a, b = without[weakest]
    b = nearer(b, a)
    return nearer(a, b), b


def nearer(d: Diagnosed, other: Diagnosed) -> Diagnosed:
    """The same record in the optimum that lies nearest to the other record's among those that explain it alike (chi-square 6).

    An amount of either sign may have a mirror image with other parameters, and one record alone does not say which it is.
    """
    signed = [name for name in d.fit.physics if info_of(name).lower < 0.0]
    if not signed:
        return d
    own = {name: d.fit.values[name] for name in d.fit.effects}
    base = {name: value for name, value in other.fit.values.items() if name in d.problem.free_parameters}
    starts = [{**base, **own}, *({**base, **own, name: -own[name]} for name in signed)]
    ends = [d.fit, *(d.problem.fit(d.fit.effects, start, hop_basins=True) for start in starts)]
    lowest = min(end.chi2 for end in ends if np.isfinite(end.chi2))
    alike = [end for end in ends if end.converged and (end.chi2 - lowest) / d.scale < ALIKE]
    best = min(alike, key=lambda end: _apart(d, end, other), default=d.fit)
    return d if _apart(d, best, other) > MUCH_NEARER * _apart(d, d.fit, other) else replace(d, fit=best)


def _apart(d: Diagnosed, end: Fit, other: Diagnosed) -> float:
    """Squared distance of the parameters of two records, in natural steps."""
    names = [name for name in d.problem.free_parameters if name in other.problem.free_parameters]
    return sum(((end.values[n] - other.fit.values[n]) / d.problem.scale_of(n)) ** 2 for n in names)


def _loss(full: Diagnosed, without: Diagnosed) -> float:
    """Chi-square, in units of the misfit left, that a record loses."""
    return (without.fit.chi2 - full.fit.chi2) / full.scale


@dataclass(frozen=True)
class Swap:
    """Both records with `rival` in the place of `instead_of`, and the chi-square that they need more."""

    instead_of: str
    rival: str
    a: Diagnosed
    b: Diagnosed
    chi2_more: float


def rivals_in_both(a: Diagnosed, b: Diagnosed, say: Progress = lambda _: None) -> tuple[Swap, ...]:
    """What the diagnoses could not tell from an effect of the model, put in its place in both records: what still does as well."""
    found: list[Swap] = []
    names = tuple(dict.fromkeys((*a.fit.physics, *b.fit.physics)))
    asked = {
        (effect.name, rival.name)
        for d in (a, b)
        for effect in d.diagnosis.effects
        for rival in effect.alternatives
        if effect.name in names and rival.name not in names and find_effect(rival.name) is not None
    }
    of_both = {*a.problem.library.names} & {*b.problem.library.names}
    for name, rival in sorted(asked)[:MOST_RIVALS]:
        others = tuple(n for n in names if n != name)
        if rival not in of_both or (asks_for_more((*others, rival)) and not asks_for_more(names)):
            continue
        say(f"{rival} in the place of {name}")
        pair = [d.fitted_with((*others, rival)) for d in (a, b)]
        more = sum(_loss(d, other) for d, other in zip((a, b), pair, strict=True))
        if more < ALIKE:
            found.append(Swap(name, rival, pair[0], pair[1], more))
    return tuple(found)


def of_the_bench(name: str) -> bool:
    """Whether an effect is the oil's or an instrument's, so that two records of one bench have the same amount of it.

    A loop or a lag of the position may lie in the valve.
    """
    if is_fault(name):
        return False
    info: EffectInfo = effect_info(name)
    instrument = "conditions" in info.stages and not info.of_sweeps
    return "oil" in info.stages or instrument or bool(getattr(info.effect_class, "instrument", False))


def same_oil(a: BenchRecord, b: BenchRecord) -> bool:
    return replace(a.oil, name="") == replace(b.oil, name="")
