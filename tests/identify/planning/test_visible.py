"""Least visible amounts and confusions of a made-up linear model, beside the same by hand: nothing is simulated."""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.linear_fit import LinearProblem, linear_library
from helpers.small_bench import REACH
from scipy.special import ndtri

from thermohyd.effects.library import effect_info
from thermohyd.identify.diagnosis.confirmation import NEAR_CHANCE
from thermohyd.identify.diagnosis.screening import Projection
from thermohyd.identify.fitting.parameters import PARAMETERS
from thermohyd.identify.planning.planned_problem import Prospect
from thermohyd.identify.planning.visible import (
    POWER,
    View,
    amount_told_apart,
    chance_of_finding,
    chance_of_naming,
    chance_of_rival,
    confused_with,
    groups,
    view_of,
    with_more,
)


ROWS = 256 * len(REACH)
RANDOM = np.random.default_rng(3)
NUISANCE = RANDOM.standard_normal((ROWS, 6))
ALONE, TWIN = RANDOM.standard_normal((2, ROWS))
# What one natural step of each effect does, in noise units: a twin and its mirror image, one alone, one that the parameters do, too.
SIGNATURES = {
    "pilot_leakage": TWIN,
    "bushing_leakage": 0.99 * TWIN + np.sqrt(1.0 - 0.99**2) * RANDOM.standard_normal(ROWS),
    "hysteresis": -TWIN + 0.02 * RANDOM.standard_normal(ROWS),
    "flowmeter_offset": 0.3 * ALONE,
    "position_scale": NUISANCE @ np.arange(1.0, 7.0),
    "thermal_clearance": 1e-4 * RANDOM.standard_normal(ROWS),
}


@dataclass(frozen=True)
class Planned(LinearProblem):
    """The readings of a plan are the model's own: nothing is amiss."""

    @property
    def free_parameters(self) -> tuple[str, ...]:
        return PARAMETERS[:6]


@pytest.fixture(scope="module")
def prospect() -> Prospect:
    plain = linear_library(np.zeros(ROWS), NUISANCE, SIGNATURES)
    problem = Planned(
        plain.record, plain.tests, plain.plans, plain.library, plain.noise, misfit=plain.misfit, nuisance=plain.nuisance,
        signatures=plain.signatures,
    )  # fmt: skip
    values = dict.fromkeys(problem.order, 0.0)
    found = Prospect(problem.record, problem, problem.evaluate(values), {}, ())
    return Prospect(found.record, problem, found.seen(found.fit), {}, ())


@pytest.fixture(scope="module")
def view(prospect: Prospect) -> View:
    return view_of(prospect)


def left(name: str) -> float:
    """Length per SI unit of what the parameters leave."""
    return float(np.linalg.norm(Projection.beside(NUISANCE)(SIGNATURES[name]))) / effect_info(name).scale


def test_the_least_amount_scores_as_the_search_asks(view: View):
    for name in ("pilot_leakage", "flowmeter_offset"):
        sight = view.sights[view.place(name)]
        assert sight.visible
        assert sight.amount == pytest.approx(view.wanted / left(name), rel=0.02)
        assert chance_of_finding(sight, sight.amount, view.critical) == pytest.approx(POWER, abs=0.02)
        assert chance_of_finding(sight, 0.5 * sight.amount, view.critical) < 0.2
    assert 3.0 < view.critical < 4.0
    assert view.critical + float(ndtri(POWER)) < view.wanted < 6.0  # near chance the rows held out have a say
    assert chance_of_naming(view.wanted, view.critical) == pytest.approx(POWER)
    assert chance_of_naming(8.0, view.critical) > 0.999


def test_the_share_of_records_in_which_an_effect_is_found():
    """As drawn: the score by three quarters of the rows, by the others, and by all."""
    rng, critical = np.random.default_rng(11), 3.9
    for expected in (3.0, 4.5, 5.5, 7.0):
        z = np.sqrt(0.75) * expected + rng.standard_normal(400_000)
        h = 0.5 * expected + rng.standard_normal(400_000)
        score, amount = np.sqrt(0.75) * z + 0.5 * h, z / np.sqrt(3.0)
        found = (score > critical) & ((score >= NEAR_CHANCE) | (2.0 * amount * h > amount**2))
        assert chance_of_naming(expected, critical) == pytest.approx(np.mean(found), abs=4e-3)


def test_what_the_parameters_do_and_what_is_too_small(view: View):
    assert view.blind["position_scale"] == "the free parameters do exactly the same"
    small = view.sights[view.place("thermal_clearance")]
    assert not small.visible
    assert small.amount == effect_info("thermal_clearance").typical[1]
    assert confused_with(view, "thermal_clearance") == ()


def test_a_twin_falls_behind_from_an_amount_on(view: View):
    """A rival of another sign is none where neither can have it."""
    amount = amount_told_apart(view, "pilot_leakage", "bushing_leakage")
    i, j = view.place("pilot_leakage"), view.place("bushing_leakage")
    # By draws: the true effect's score, the rival's beside it, and how far that falls behind.
    random, cosine = np.random.default_rng(1), float(view.correlation[i, j])
    score = amount * left("pilot_leakage") + random.standard_normal(200_000)
    other = cosine * score + np.sqrt(1.0 - cosine**2) * random.standard_normal(len(score))
    assert np.mean(score**2 - other**2 < 6.0) == pytest.approx(1.0 - POWER, abs=0.03)
    assert chance_of_rival(view, "pilot_leakage", "bushing_leakage", 0.02 * amount) > 0.9
    assert chance_of_rival(view, "pilot_leakage", "bushing_leakage", 3.0 * amount) < 1e-3
    least = view.sights[i].amount
    assert view.correlation[i, view.place("hysteresis")] < -0.99
    assert chance_of_rival(view, "pilot_leakage", "hysteresis", least) < 0.05


def test_groups_are_what_no_usual_amount_tells_apart(view: View, prospect: Prospect):
    names = [sight.name for sight in view.sights]
    assert groups(view, names) == ()  # the twins come apart in their largest usual amounts
    closer = {**SIGNATURES, "bushing_leakage": TWIN + 1e-3 * RANDOM.standard_normal(ROWS)}
    changes = {s.name: closer[s.name] * s.amount / effect_info(s.name).scale for s in view.sights}
    alike = with_more(view, changes, Projection.beside(NUISANCE))
    assert groups(alike, names) == (("pilot_leakage", "bushing_leakage"),)
    assert confused_with(alike, "pilot_leakage") == ("bushing_leakage",)


def test_more_rows_show_more(view: View):
    changes = {s.name: SIGNATURES[s.name] * s.amount / effect_info(s.name).scale for s in view.sights}
    twice = {name: np.concatenate([change, change]) for name, change in changes.items()}
    more = with_more(view, twice, Projection.beside(np.concatenate([NUISANCE, NUISANCE])))
    for before, after in zip(view.sights, more.sights, strict=True):
        assert after.strength == pytest.approx(np.sqrt(2.0) * before.strength, rel=1e-6)
