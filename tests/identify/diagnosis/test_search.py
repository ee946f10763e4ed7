"""The search over a linear model: chance names nothing, what is missing is found, and what is not needed goes again."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from helpers.linear_fit import LinearProblem, linear_library

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.diagnosis.screening import Signature
from thermohyd.identify.diagnosis.search import (
    Selection,
    implausible,
    leading,
    merit,
    needed_beside,
    pair_gain,
    prune,
    search,
)
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit


ROWS = 768  # of a small bench
LIBRARY = (
    "unequal_underlap", "land_leakage", "viscosity_shift", "temperature_offset", "pilot_leakage", "flowmeter_offset",
    "flowmeter_scale", "hysteresis",
)  # fmt: skip
ONE_SIDED = "pilot_leakage"  # a leakage is not negative


def unit(columns: np.ndarray) -> np.ndarray:
    return columns / np.linalg.norm(columns, axis=0)


def bench(rng: np.random.Generator, **missing: float) -> LinearProblem:
    """Noise of 1 and effects of these strengths, in noise units; signatures and parameters' columns look a bit alike."""
    common = rng.normal(size=(ROWS, 1))
    signatures = unit(rng.normal(size=(ROWS, len(LIBRARY))) + 0.5 * common)
    nuisance = unit(rng.normal(size=(ROWS, 6)) + 0.3 * common)
    misfit = rng.normal(size=ROWS) - sum(amount * signatures[:, LIBRARY.index(n)] for n, amount in missing.items())
    return linear_library(misfit, nuisance, dict(zip(LIBRARY, signatures.T, strict=True)))


def found_in(problem: Problem, **options) -> Selection:
    return search(problem, problem.fit(), {}, **options)


def test_chance_names_about_its_level():
    rng, level = np.random.default_rng(0), 0.2
    named = [bool(found_in(bench(rng), level=level).effects) for _ in range(60)]
    assert 0.05 < np.mean(named) < 0.35  # three standard deviations about 20 %


def test_a_record_without_effects_ends_after_one_look():
    found = found_in(bench(np.random.default_rng(1)))
    assert found.effects == ()
    assert found.final is found.base
    assert [step.added for step in found.steps] == [()]
    assert found.steps[0].p_value > 0.005


@pytest.mark.parametrize("name", LIBRARY)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_missing_effect(name, sign):
    rng = np.random.default_rng(LIBRARY.index(name))
    found = found_in(bench(rng, **{name: 9.0 * sign}))
    if sign < 0.0 and EFFECTS[name].lower == 0.0:  # what looks like it from the other side may be named, not it
        assert name not in found.effects
        return
    assert found.effects == (name,)
    assert found.final.values[name] / EFFECTS[name].scale == pytest.approx(9.0 * sign, abs=4.0)
    assert found.p_values[name] < 1e-4


@dataclass(frozen=True)
class Bent(LinearProblem):
    """One whose refits with hysteresis gain more than its slope at nothing says, as wear does where edge radius made up for it."""

    more: float = 15.0

    def fit(self, effects: Iterable[str] = (), start: Mapping[str, float] | None = None, **options: Any) -> Fit:
        fit = super().fit(effects, start, **options)
        return replace(fit, chi2=fit.chi2 - self.more) if "hysteresis" in fit.effects else fit


def test_a_refit_may_say_more_than_the_score():
    straight = bench(np.random.default_rng(14), hysteresis=4.2)
    [step] = found_in(straight).steps
    score = step.screen.best("hysteresis")
    assert score is not None
    assert step.screen.critical**2 - 6.0 < score.gain < step.screen.critical**2
    assert found_in(straight).effects == ()
    found = found_in(Bent(**vars(straight)))
    assert found.effects == ("hysteresis",)
    assert found.p_values["hysteresis"] < 0.005
    assert not found.nearly


@dataclass(frozen=True)
class Astray(LinearProblem):
    """One whose short refits with hysteresis end nowhere where they begin at parameters that were bent to what is missing."""

    def fit(
        self,
        effects: Iterable[str] = (),
        start: Mapping[str, float] | None = None,
        *,
        most_steps: int = 0,
        **options: Any,
    ) -> Fit:
        fit = super().fit(effects, start, **options)
        astray = most_steps and "hysteresis" in fit.effects and "clearance" in (start or {})
        return replace(fit, chi2=fit.chi2 + 1e4) if astray else fit


def test_a_refit_that_is_led_astray_begins_again_from_the_nominal_valve():
    problem = bench(np.random.default_rng(15), hysteresis=12.0)
    assert "clearance" in problem.order
    assert found_in(Astray(**vars(problem))).effects == ("hysteresis",)


def test_what_would_close_most_is_asked_however_little_its_noise_is_known():
    rows = np.eye(3)[0]
    known = [Signature(name, rows, 1.0, 30.0 - i, 1.0) for i, name in enumerate(LIBRARY)]
    few = replace(known[0], name="bushing_leakage", score=40.0, freedom=1.9)
    assert 1.0 < few.strength < 0.2 * known[0].strength
    assert [s.name for s in leading([*known, few])] == [*LIBRARY, few.name]
    assert [s.name for s in leading([*known, replace(few, score=20.0)])] == list(LIBRARY)


def test_what_was_nearly_found_is_told_with_what_it_fell_short_by():
    problem = bench(np.random.default_rng(14), hysteresis=4.2)
    found = found_in(problem)
    [step] = found.steps
    gain = found.base.chi2 - problem.fit(["hysteresis"]).chi2
    assert found.nearly == {"hysteresis": pytest.approx(step.screen.critical**2 - gain)}
    assert 0.0 < found.nearly["hysteresis"] < 6.0
    assert not found_in(bench(np.random.default_rng(1))).nearly


def test_three_missing_effects():
    missing = {"viscosity_shift": 15.0, "hysteresis": 10.0, "flowmeter_offset": -12.0}
    found = found_in(bench(np.random.default_rng(5), **missing))
    assert set(found.effects) == set(missing)
    assert set(found.p_values) == set(missing)
    assert found.final.chi2 < 1.15 * ROWS


def test_no_more_than_it_was_told():
    missing = {"viscosity_shift": 15.0, "hysteresis": 10.0, "flowmeter_offset": -12.0}
    found = found_in(bench(np.random.default_rng(5), **missing), most=2)
    assert len(found.effects) == 2


def test_two_that_hide_each_other_are_found_together():
    """Signatures that nearly cancel: neither alone closes anything to speak of, and both together do."""
    rng = np.random.default_rng(6)
    u, a, b, other = unit(rng.normal(size=(ROWS, 4))).T
    signatures = {"hysteresis": u + 0.2 * a, "flowmeter_offset": -u + 0.2 * b, "viscosity_shift": other}
    misfit = rng.normal(size=ROWS) - 60.0 * (signatures["hysteresis"] + signatures["flowmeter_offset"])
    problem = linear_library(misfit, unit(rng.normal(size=(ROWS, 6))), signatures)
    found = found_in(problem)
    assert set(found.effects) == {"hysteresis", "flowmeter_offset"}
    alone = problem.fit().chi2 - problem.fit(["hysteresis"]).chi2
    assert alone < 0.1 * (problem.fit().chi2 - found.final.chi2)


def test_of_two_that_fit_alike_the_plausible_one():
    rng = np.random.default_rng(7)
    u, v = unit(rng.normal(size=(ROWS, 2))).T
    # The record is exactly that of a flowmeter which reads five times the flow; an underlap does nearly the same.
    signatures = {"flowmeter_scale": 0.1 * u, "unequal_underlap": 10.0 * unit(u + 0.03 * v)}
    misfit = rng.normal(size=ROWS) - 20.0 * u
    problem = linear_library(misfit, unit(rng.normal(size=(ROWS, 6))), signatures)
    wild, usual = problem.fit(["flowmeter_scale"]), problem.fit(["unequal_underlap"])
    assert wild.chi2 < usual.chi2
    assert merit(usual) < merit(wild)
    assert found_in(problem).effects == ("unequal_underlap",)


def test_an_amount_costs_from_the_largest_usual_one_on():
    problem = bench(np.random.default_rng(8))
    largest = EFFECTS["hysteresis"].typical[1]
    for amount, cost in ((0.9 * largest, 0.0), (np.e * largest, 4.0), (np.e**2 * largest, 16.0)):
        fit = problem.fit(["hysteresis"])
        fit.values["hysteresis"] = amount
        assert implausible(fit) == pytest.approx(cost)


def test_what_is_not_needed_is_dropped():
    problem = bench(np.random.default_rng(9), hysteresis=12.0)
    chosen = ("flowmeter_offset", "hysteresis", "viscosity_shift")
    fit, left = prune(problem, problem.fit(chosen), chosen, 12.0)
    assert left == ("hysteresis",)
    assert fit.effects == left
    assert prune(problem, problem.fit(), (), 12.0)[1] == ()


def test_a_second_search_begins_where_the_first_ended():
    problem = bench(np.random.default_rng(10), hysteresis=12.0, viscosity_shift=14.0)
    begin = problem.fit(["hysteresis"])
    found = found_in(problem, begin=begin)
    assert set(found.effects) == {"hysteresis", "viscosity_shift"}
    assert found.base.effects == ()
    assert found.steps[0].added == ("viscosity_shift",)


def test_rows_left_out_have_no_say():
    problem = bench(np.random.default_rng(11), hysteresis=12.0)
    used = np.ones(ROWS, dtype=bool)
    used[::3] = False
    problem.misfit[~used] += 50.0 * problem.signatures["viscosity_shift"][~used]
    assert "viscosity_shift" in found_in(problem).effects
    assert found_in(problem.with_rows(used)).effects == ("hysteresis",)


def test_beside_a_misfit_an_effect_must_bring_more():
    problem = bench(np.random.default_rng(12))
    fit = problem.fit()
    freedom = int(fit.used.sum()) - len(fit.free)
    assert needed_beside(fit) == pytest.approx(2.0 * (fit.chi2 / freedom - 1.0))
    assert abs(needed_beside(fit)) < 0.3
    problem.misfit[:] *= 3.0
    assert needed_beside(problem.fit()) > 10.0


def test_the_gain_of_a_pair_keeps_to_the_signs():
    problem = bench(np.random.default_rng(13), hysteresis=8.0, flowmeter_offset=-7.0)
    scores = found_in(problem, most=0).steps[0].screen
    lag, offset, pilot = (scores.best(name) for name in ("hysteresis", "flowmeter_offset", ONE_SIDED))
    assert lag is not None
    assert offset is not None
    assert pilot is not None
    both = np.stack([lag.direction, offset.direction], axis=1)
    free = float(np.sum((both @ np.linalg.lstsq(both, scores.residual, rcond=None)[0]) ** 2))
    assert pair_gain(lag, offset, scores.residual) == pytest.approx(free)
    assert pair_gain(lag, pilot, -scores.residual) == pytest.approx(max(-pilot.score, 0.0) ** 2, abs=1e-9)
