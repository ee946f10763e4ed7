"""A name must predict conditions it was not fitted to: one that only one condition asks for does not."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_fit, linear_library, linear_problem
from helpers.small_bench import REACH, conditions_only
from helpers.small_diagnosis import small_diagnosis

from thermohyd.identify.diagnosis.confirmation import (
    FEWEST,
    NEAR_CHANCE,
    PROVEN,
    Confirmation,
    confirmation,
    parts_left_out,
    predicted_apart,
    strength,
    unproven,
)
from thermohyd.identify.diagnosis.result import Suspect
from thermohyd.identify.fitting.bench_faults import info_of
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.report.diagnosis_report import suspect_sentences


PROBLEM = linear_problem(NoiseCorrelation())
PARTS = parts_left_out(PROBLEM.tests)


def test_every_condition_is_left_out_in_all_tests_at_once():
    first = 0
    seen: dict[tuple[float, float], int] = {}
    for (test, _), rows in PROBLEM.rows().items():
        own = PROBLEM.tests[test]
        assert rows.start == first
        for t, p, part in zip(own.temperature, own.supply_pressure, PARTS[rows], strict=True):
            assert seen.setdefault((float(t), float(p)), int(part)) == part
        first = rows.stop
    assert len(set(seen.values())) >= FEWEST


def test_a_condition_is_one_part_in_tests_that_share_few():
    """A condition that one test lacks must not shift the numbers of the others there."""
    tests = {
        "leakage": conditions_only("leakage", (0, 1, 2, 3, 4, 5)),
        "flow_gain": conditions_only("flow_gain", (3, 4, 5)),
    }
    parts = parts_left_out(tests)
    seen: dict[tuple[float, float], int] = {}
    rows = np.split(parts, [tests["leakage"].rows])
    for test, own in zip(tests.values(), rows, strict=True):
        for t, p, part in zip(test.temperature, test.supply_pressure, own, strict=True):
            assert seen.setdefault((float(t), float(p)), int(part)) == part
    assert len(set(seen.values())) == 6


@pytest.mark.parametrize("runs", [(0,), (0, 1), (0, 0, 1, 1), (0, 0, 0, 0, 0)])
def test_few_conditions_are_cut_further(runs):
    tests = {name: conditions_only(name, runs) for name in REACH}
    parts = parts_left_out(tests)
    assert len(parts) == sum(test.rows for test in tests.values())
    assert len(np.unique(parts)) >= min(FEWEST, 2)
    for part in np.unique(parts):
        assert 0 < np.sum(parts == part) < len(parts)


def signature(of_one_condition: bool) -> np.ndarray:
    tests = [PROBLEM.tests[test] for test, _ in PROBLEM.rows()]
    wave = np.concatenate([np.cos(t.spool_position / 40e-6) for t in tests])
    return wave * (PARTS == 2) if of_one_condition else wave


@pytest.mark.parametrize("one", [False, True])
def test_what_one_condition_alone_asks_for_is_not_proven(one):
    """The same column fitted to a misfit of all conditions, or to one that a single condition has."""
    rng = np.random.default_rng(3)
    everywhere, here = signature(False), signature(one)
    misfit = here * (12.0 / np.linalg.norm(here)) + rng.standard_normal(len(here))
    problem = linear_library(misfit, np.zeros((len(here), 1)), {"viscosity_shift": everywhere * 1e-1})
    base, fit = problem.fit(), problem.fit(["viscosity_shift"])
    found = confirmation(problem, fit, base, {"viscosity_shift": base}, 1.0, PARTS == 1)
    # Of a strong effect nothing is asked on the rows held out.
    assert bool(found.held_out) == (strength(fit, base, 1.0) < NEAR_CHANCE)
    if one:
        assert base.chi2 - fit.chi2 > PROVEN  # the rows that it is fitted to ask for it
        assert found.together < PROVEN
        assert unproven(found, fit.physics) == "viscosity_shift"
    else:
        assert found.together > 100.0
        assert unproven(found, fit.physics) is None
    assert found.p_value("viscosity_shift") == pytest.approx(np.exp(-0.5 * max(found.each["viscosity_shift"], 0.0)))


@pytest.mark.parametrize("everywhere", [True, False])
def test_a_weak_effect_must_do_better_on_the_rows_held_out(everywhere):
    """Five standard errors of it in all rows, or in all but those held out, which have a little of the contrary."""
    held = PARTS == 1
    rng = np.random.default_rng(5)
    column = signature(False) / np.linalg.norm(signature(False))
    misfit = 5.0 * np.where(held & (not everywhere), -0.3 * column, column)
    misfit = misfit + rng.standard_normal(len(column)) * 0.3
    problem = linear_library(misfit, np.zeros((len(column), 1)), {"viscosity_shift": column})
    base, fit = problem.fit(), problem.fit(["viscosity_shift"])
    found = confirmation(problem, fit, base, {"viscosity_shift": base}, 1.0, held)
    assert 3.0 < strength(fit, base, 1.0) < NEAR_CHANCE
    assert found.together > PROVEN
    assert (found.held_out["viscosity_shift"] > 0.0) == everywhere
    assert unproven(found, fit.physics) == (None if everywhere else "viscosity_shift")


def test_a_fault_of_one_condition_takes_the_amount_that_its_rows_show():
    """Left out with its condition, a fault is no claim about other rows: at 0 its misfit drowned what an effect did there."""
    rng = np.random.default_rng(7)
    fault, effect = signature(True), signature(False)
    misfit = 60.0 * fault + 12.0 * effect / np.linalg.norm(effect) + rng.standard_normal(len(effect))
    name = "wrong_supply|||70 bar"
    columns = {n: column / info_of(n).scale for n, column in (("viscosity_shift", effect), (name, fault))}

    def fitted(*names):
        free = np.stack([columns[n] for n in names], axis=1)
        amounts = np.linalg.lstsq(free, -misfit, rcond=None)[0]
        fit = linear_fit(misfit + free @ amounts, free, names)
        return replace(fit, effects=names, values=dict(zip(names, amounts.tolist(), strict=True)))

    both, alone = fitted("viscosity_shift", name), fitted(name)
    square = lambda fit: float(np.sum(predicted_apart(fit, PARTS) ** 2))
    gain = alone.chi2 - both.chi2
    assert gain > 50.0
    assert square(alone) - square(both) > 0.5 * gain
    assert square(both) < 2.0 * len(misfit)


@pytest.mark.parametrize(("strength", "times", "hint"), [(4.0, 0.5, True), (9.0, 0.5, False), (4.0, 8.0, False)])
def test_a_weak_suspect_is_a_hint(strength, times, hint):
    suspect = Suspect("pilot_leakage", 1e-9, "m^3/(s sqrt(Pa))", 3.0, times, strength)
    assert suspect.hint == hint
    assert ("it is a hint, no misfit" in " ".join(suspect_sentences((suspect,)))) == hint


@pytest.mark.parametrize("held_out", [None, 2.0, -1.3])
def test_a_suspect_says_why_it_is_not_named(held_out):
    """A weak effect that proves itself over all conditions goes all the same where rows that took no part in its choice speak against."""
    suspect = Suspect("pilot_leakage", 1e-9, "m^3/(s sqrt(Pa))", 43.9, 0.5, 6.1, held_out=held_out)
    [words] = suspect_sentences((suspect,))
    worse = held_out is not None and held_out < 0.0
    assert ("makes the rows worse that took no part in its choice (2 ln E = -1.3 there)" in words) == worse
    assert ("does not predict rows that are left out" in words) == (not worse)


def test_left_out_rows_are_predicted_as_by_a_refit():
    """One step of a linear model is its refit; the amount has a little knowledge beside it."""
    rng = np.random.default_rng(1)
    column = signature(False)
    problem = linear_library(
        column * 0.3 + rng.standard_normal(len(column)), np.zeros((len(column), 1)), {"viscosity_shift": column}
    )
    fit = problem.fit(["viscosity_shift"])
    apart = predicted_apart(fit, PARTS)
    for part in np.unique(PARTS):
        refit = problem.with_rows(part != PARTS).fit(["viscosity_shift"])
        there = problem.evaluate(refit.values, refit.effects).residual[: len(PARTS)]
        np.testing.assert_allclose(apart[part == PARTS], there[part == PARTS], atol=0.02)


def test_many_must_each_prove_themselves():
    each = {"a": 20.0, "b": 30.0, "c": 5.0}
    assert unproven(Confirmation(60.0, each), each) is None
    assert unproven(Confirmation(60.0, each | {"d": 40.0}), (*each, "d")) == "c"
    assert unproven(Confirmation(60.0, each | {"c": -1.0}), each) == "c"
    assert unproven(Confirmation(9.0, {"a": 9.0}), ("a",)) == "a"
    assert unproven(Confirmation(0.0, {}), ()) is None


@pytest.mark.nightly  # a whole diagnosis
def test_what_is_named_says_how_it_did():
    result = small_diagnosis("pilot")
    assert result.proof is not None
    assert result.proof > PROVEN
    assert result.suspects == ()
    assert result.to_dict()["proof"] == pytest.approx(result.proof)
    assert result.to_dict()["suspects"] == []


@pytest.mark.nightly  # a whole diagnosis
def test_an_amount_that_no_valve_has_is_no_name():
    """The record is explained to its noise by eight times the largest usual pilot leakage: that is said, and it stays a suspicion."""
    result = small_diagnosis("too much")
    assert result.verdict == "unexplained"
    assert result.effects == ()
    [suspect] = result.suspects
    assert suspect.name == "pilot_leakage"
    assert suspect.value == pytest.approx(4e-8, rel=0.05)
    assert suspect.times_usual == pytest.approx(8.0, rel=0.05)
    assert suspect.evidence > PROVEN
    assert "takes 8 times its largest usual amount" in " ".join(suspect_sentences(result.suspects))
