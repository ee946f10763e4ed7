"""The whole engine on small benches with a known truth: nothing, one effect, two, rivals, and something of no known kind."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.small_bench import record_of, small_record
from helpers.small_diagnosis import (
    CASES,
    DRIFT,
    HEIGHT,
    MIDDLE,
    WAVE,
    opened,
    small_case,
    small_diagnosis,
    wound_record,
)

from thermohyd.effects.library import unregister_effect
from thermohyd.identify.diagnosis import search
from thermohyd.identify.diagnosis.case import choose
from thermohyd.identify.diagnosis.diagnose import diagnose_case
from thermohyd.identify.diagnosis.held_out import split_rows
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.diagnosis.typed_terms import terms_of
from thermohyd.identify.effect_writer import write_effect
from thermohyd.identify.model.model_file import load_model, model_json
from thermohyd.identify.model.predict import predict_test
from thermohyd.identify.model.typed_terms import TypedTerm
from thermohyd.identify.report.diagnosis_json import diagnosis_json
from thermohyd.identify.report.diagnosis_words import alike_sentences, pair_words
from thermohyd.identify.users_effects import load_effects


def effect_of(result: DiagnosisResult, name: str):
    [found] = [effect for effect in result.effects if effect.name == name]
    return found


NOTHING = [
    "nothing",
    "correlated",
    *(pytest.param(name, marks=pytest.mark.nightly) for name in ("noisy positions", "stated beside noisy positions")),
]


@pytest.mark.parametrize("name", NOTHING)
def test_nothing_is_named_where_nothing_is_missing(name):
    result = small_diagnosis(name)
    assert result.verdict == "consistent"
    assert result.effects == ()
    assert result.where == ()
    assert result.variations == ()
    if (
        name == "stated beside noisy positions"
    ):  # of 0.2 um: no change of the tests shows what is absorbed in its largest usual amount
        assert result.next_test is None or result.absorbed
    else:
        assert (result.next_test is None) == (not result.absorbed)
    assert result.left_over_p > 1e-3
    assert result.gap_before == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("name", ["pilot", "two"])
def test_what_is_missing_is_named_with_its_amount(name):
    result = small_diagnosis(name)
    truth = CASES[name]["effects"]
    assert result.verdict == "named"
    assert {effect.name for effect in result.effects} == set(truth)
    for name_of, amount in truth.items():
        found = effect_of(result, name_of)
        assert found.std is not None
        assert abs(found.value - amount) < 4.0 * found.std
        assert found.p_value < 1e-4
        assert not found.alternatives
        assert not found.at_bound
    assert result.gap_after < 1.3 < result.gap_before
    assert result.left_over_p > 1e-3


@pytest.mark.parametrize(
    ("record", "name", "places"),
    [
        ("pilot", "pilot_leakage", {("flow_into_return", "pressure_drop")}),
        ("two", "hysteresis", {("position", "direction")}),
        ("two", "flowmeter_offset", {("reading:flows", "constant")}),
        ("rivals", "viscosity_shift", {("viscosity", "constant"), ("position", "position"), ("reading:flows", "flow")}),
    ],
)
def test_the_places_at_which_the_same_would_be_read_stand_beside_a_name(record, name, places):
    result = small_diagnosis(record)
    found = effect_of(result, name).places
    assert places <= set(found)
    assert record == "rivals" or len(found) == 1
    said = [line for line in alike_sentences(result) if f"reads as {name} does" in line]
    assert len(said) == 1
    assert all(pair_words(pair) in said[0] for pair in found[:4])
    [written] = [effect for effect in diagnosis_json(result)["effects"] if effect["name"] == name]
    assert written["places"] == [list(pair) for pair in found]


@pytest.mark.parametrize("name", ["pilot", "two"])
def test_the_gap_closes_on_rows_held_out_and_a_wrong_effect_closes_less(name):
    held = small_diagnosis(name).held_out
    assert held is not None
    assert held.gap_closed > 0.9
    assert held.reduced_chi2_after < 1.5
    assert held.exchange
    assert not set(held.exchange) & set(CASES[name]["effects"])
    assert all(share < held.gap_closed - 0.1 for share in held.exchange.values())


def test_the_worst_region_lies_in_the_test_that_sees_the_effect():
    worst = small_diagnosis("pilot").where[0]
    assert worst.test == "leakage"
    assert worst.mean > 0.0
    shares = [region.share for region in small_diagnosis("pilot").where]
    assert shares == sorted(shares, reverse=True)


def test_parameters_that_the_gap_had_bent_are_put_right():
    shifts = {shift.name: shift for shift in small_diagnosis("pilot").shifts}
    bent = shifts["clearance"]  # a leakage that is not that of the lands passes for a wider gap
    assert bent.std_after is not None
    assert bent.before - bent.after > 10.0 * bent.std_after
    assert abs(bent.after - 2.4e-6) < 4.0 * bent.std_after


@pytest.mark.parametrize("name", ["pilot", "two"])
def test_evidence_adds_up_to_the_strength(name):
    result = small_diagnosis(name)
    for effect in result.effects:
        rows = [part for part in result.evidence if part.effect == effect.name]
        assert {part.test for part in rows} == {"leakage", "pressure_gain", "flow_gain"}
        total = sum(float(np.sum(part.contribution)) for part in rows)
        assert total == pytest.approx(effect.strength, rel=0.2)


def test_evidence_for_a_leakage_lies_in_the_leakage():
    sums = {part.test: float(np.sum(part.contribution)) for part in small_diagnosis("pilot").evidence}
    assert sums["leakage"] > 0.8 * sum(sums.values())


def test_every_effect_of_the_library_has_a_line():
    table = {c.name: c for c in small_diagnosis("pilot").candidates}
    assert table["pilot_leakage"].state == "testable"
    assert table["pilot_leakage"].z > 20.0
    assert table["pilot_leakage"].gap_closed > 0.9
    assert table["pilot_leakage"].estimate == pytest.approx(1e-9, rel=0.2)
    assert table["pilot_leakage"].least < 1e-9
    assert max(table.values(), key=lambda c: c.gap_closed if c.gap_closed == c.gap_closed else -1.0).name == (
        "pilot_leakage"
    )


@pytest.mark.nightly
def test_two_effects_that_do_the_same_are_both_said():
    """Scaled positions are another valve of the same family of curves; another viscosity too: only their names differ."""
    result = small_diagnosis("rivals")
    assert result.verdict == "ambiguous"
    [effect] = result.effects
    assert "viscosity_shift" in {effect.name, *(a.name for a in effect.alternatives)}
    assert effect.alternatives
    assert all(alternative.chi2_more < 6.0 for alternative in effect.alternatives)
    assert "cannot be told from" in result.headline
    assert result.next_test is not None
    evidence = [option.evidence for option in result.next_test.options]
    assert evidence == sorted(evidence, reverse=True)
    assert result.next_test.evidence == evidence[0]


@pytest.mark.nightly
def test_what_the_library_lacks_stays_unexplained_and_what_would_have_to_vary_is_said():
    result = small_diagnosis("outside")
    assert result.verdict == "unexplained"
    assert result.left_over_p < 1e-5
    assert result.where
    best = result.variations[0]
    assert (best.quantity, best.variable) == ("null_bias", "temperature")
    assert best.gap_closed > 0.9
    assert not best.learned
    np.testing.assert_allclose(best.curve - best.curve.mean(), DRIFT * (best.variable_values - MIDDLE), atol=0.3e-6)
    [place, *_] = result.terms
    assert (place.place, place.variable, place.law, place.unit) == ("position", "temperature", "proportional", "m/K")
    assert place.std is not None
    assert abs(place.value + DRIFT) < 4.0 * place.std < 0.2 * DRIFT  # the spool stands where the null has gone from
    assert place.holds
    assert place.gap_closed > 0.9
    assert "a shift of the position in proportion to the temperature, (-" in result.headline
    assert "a place, not a cause" in result.headline
    assert any("what a null that wanders does" in sentence for sentence in result.sentences)
    [written, *_] = result.to_dict()["terms"]
    assert (written["place"], written["variable"]) == ("position", "temperature")
    assert {"law", "value", "unit", "std", "p_value", "gap_closed", "alternatives", "sentence"} <= set(written)
    assert result.next_test is not None
    assert "temperatures in the opposite order" in result.next_test.sentence
    assert any("check the labels" in option.words for option in result.next_test.options)


@pytest.mark.nightly
def test_a_position_that_waves_is_a_misfit_and_a_place():
    """Of two such records of real-bench sets both had been called consistent: no smooth curve follows a wave."""
    result = diagnose_case(opened(wound_record()))
    assert result.verdict == "unexplained"
    assert result.left_over_p < 1e-5
    term = result.terms[0]
    assert (term.place, term.variable, term.law) == ("position", "position", "local")
    assert term.holds
    assert term.gap_closed > 0.6
    assert term.std is not None
    assert abs(term.value - 2.0 * HEIGHT) < 4.0 * term.std
    wave = HEIGHT * np.sin(2.0 * np.pi * term.variable_values / WAVE)
    assert np.corrcoef(term.curve, wave)[0, 1] > 0.7
    assert "alike in all runs" in term.sentence


@pytest.mark.nightly
def test_learning_closes_the_gap_and_says_that_it_learned():
    before, result = small_diagnosis("outside"), small_diagnosis("outside", learn=True)
    assert result.terms[0].learned
    assert result.gap_after < 1.3 < before.gap_after
    assert result.held_out is not None
    assert result.held_out.gap_closed > 0.9
    [term] = result.learned
    assert isinstance(term, TypedTerm)
    assert (term.place, term.variable, term.law) == ("position", "temperature", "proportional")
    assert term.coefficients[0] == pytest.approx(-DRIFT, rel=0.1)
    assert len(term.covariance) == 1
    assert set(term.with_parameters) == set(result.after.free)


@pytest.mark.nightly
def test_a_learned_term_is_read_back_and_predicts_with_its_error(tmp_path):
    result = small_diagnosis("outside", learn=True)
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model_json(result.after, result.learned)))
    model = load_model(path)
    [term], [learned] = model.learned, result.learned
    assert isinstance(term, TypedTerm)
    assert isinstance(learned, TypedTerm)
    assert (term.place, term.coefficients, term.covariance) == (learned.place, learned.coefficients, learned.covariance)
    test = result.record.tests["leakage"]
    (value, std), channel = predict_test(model, result.record, test)["leakage_flow"], test.channels[0]
    fitted = next(c for c in result.after.channels if c.channel == "leakage_flow")
    np.testing.assert_allclose(value, fitted.predicted, atol=1e-3 * float(np.max(fitted.std)))
    known = predict_test(replace(model, learned=(replace(term, covariance=()),)), result.record, test)["leakage_flow"][
        1
    ]
    assert np.sqrt(np.mean(((value - channel.value) / channel.std) ** 2)) < 1.2
    assert np.all(std > 0.0)
    assert np.max(std / known) > 1.001


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "place", "variable", "value"),
    [
        ("pilot", "flow_into_return", "pressure_drop", 1e-9),
        ("outside", "position", "temperature", -DRIFT),
        ("rivals", "viscosity", None, None),
    ],
)
def test_without_its_effect_the_place_is_found(name, place, variable, value):
    """Beside the ideal valve, as if the library were empty."""
    case = small_case(name)
    [best, *_] = terms_of(case.problem, case.base, split_rows(case.fitted.tests))
    pairs = [best.fitted.term.place, *(other for other, _ in best.alternatives)]
    assert place in pairs
    if variable is not None:
        assert (best.fitted.term.place, best.fitted.term.variable) == (place, variable)
        assert abs(best.size[0] - value) < 4.0 * best.size[1]
        assert best.holds
        assert best.gap_closed > 0.8


@pytest.mark.nightly
def test_a_record_with_nothing_wrong_has_no_term():
    case = small_case("nothing")
    assert terms_of(case.problem, case.base, split_rows(case.fitted.tests)) == ()


@pytest.mark.nightly
def test_permuted_residuals_name_nothing():
    """Negative control: the misfit of a missing effect, its rows dealt out anew, is large and means nothing.

    Signs are drawn too: a permutation keeps the mean, and a flow that is too high everywhere is a leak.
    """
    case, rng = small_case("pilot"), np.random.default_rng(0)
    record, at = small_record(), case.problem.evaluate(case.base.values)
    tests = {}
    for key, rows in case.problem.rows().items():
        test = case.fitted.tests[key[0]]
        channel, whitened = test.channels[0], at.residual[rows]
        model = channel.value + _coloured(case, key, whitened)
        mixed = rng.permutation(channel.value - model) * rng.choice([-1.0, 1.0], test.rows)
        std = np.full(test.rows, float(np.sqrt(np.mean(mixed**2))))
        tests[key[0]] = replace(test, channels=(replace(channel, value=model + mixed, std=std),))
    result = diagnose_case(opened(record_of(tests)))
    assert record.tests.keys() == tests.keys()
    assert result.verdict == "consistent"
    assert result.effects == ()


def _coloured(case, key, whitened: np.ndarray) -> np.ndarray:
    """Residuals in SI from whitened ones: the noise of this case is white."""
    assert case.problem.noise.correlation[key].share == 0.0
    return whitened * case.problem.noise.std[key]


def test_the_same_answer_twice():
    case = small_case("two")
    first, again = (choose(case)[1] for _ in range(2))
    assert first.effects == again.effects
    assert first.final.chi2 == again.final.chi2
    assert first.p_values == again.p_values


def test_bad_rows_are_left_out_and_the_rest_is_as_without_them():
    record = small_record(seed=0)
    tests = dict(record.tests)
    spoiled = ("leakage", "flow_gain")
    for name in spoiled:
        test = tests[name]
        [channel] = test.channels
        assert channel.std is not None
        value = channel.value.copy()
        value[36] += 50.0 * channel.std[36]
        tests[name] = replace(test, channels=(replace(channel, value=value),))
    result = diagnose_case(opened(replace(record, tests=tests)))
    clean = small_diagnosis("nothing")
    assert result.verdict == "consistent"
    assert [(fault.test, fault.name, len(fault.rows)) for fault in result.after.faults] == [
        (name, "outliers", 1) for name in spoiled
    ]
    assert all(fault.sentence in result.warnings for fault in result.after.faults)
    for name, estimate in clean.after.parameters.items():
        if estimate.std:
            found = result.after.parameters[name]
            assert found.std == pytest.approx(estimate.std, rel=0.1)
            assert abs(found.value - estimate.value) < 0.5 * estimate.std


@pytest.mark.nightly  # a whole diagnosis
def test_a_search_that_may_take_no_more_ends_with_what_it_has_and_says_so(monkeypatch):
    monkeypatch.setattr(search, "MOST_EVALUATIONS", small_case("pilot").problem.work.cost)
    result = diagnose_case(small_case("pilot"))
    assert result.verdict == "unexplained"
    assert result.effects == ()
    assert any("the search was ended after" in warning for warning in result.warnings)
    assert result.to_dict()["evaluations"] == result.evaluations > 0


def test_the_other_law_of_an_edge_is_not_asked_unless_somebody_asks():
    result = small_diagnosis("pilot")
    assert result.after.other_law is None
    assert result.to_dict()["fit"]["parameters"]["pilot_leakage"]["model_form"] is None
    assert "edge law" not in result.summary()


@pytest.mark.nightly
def test_where_many_rows_are_bad_nothing_is_named():
    record = small_record(**CASES["pilot"])
    test = record.tests["flow_gain"]
    [channel] = test.channels
    assert channel.std is not None
    value = channel.value.copy()
    value[6::16] += 50.0 * channel.std[6::16]
    tests = {**record.tests, "flow_gain": replace(test, channels=(replace(channel, value=value),))}
    result = diagnose_case(opened(replace(record, tests=tests)))
    assert [fault.masked for fault in result.after.faults] == [False]
    assert result.verdict == "unexplained"
    assert any("not normal" in warning for warning in result.warnings)


@pytest.mark.nightly
def test_a_term_written_as_an_effect_is_named_and_closes_the_same_gap(tmp_path):
    before = small_diagnosis("outside")
    (tmp_path / "diagnosis.json").write_text(json.dumps(before.to_dict()))
    write_effect("wandering_null", tmp_path / "diagnosis.json", tmp_path / "mine")
    assert load_effects(tmp_path / "mine") == ("wandering_null",)
    try:
        result = diagnose_case(opened(small_record(**CASES["outside"]), ("viscosity_shift", "wandering_null")))
        assert result.verdict == "named"
        found = effect_of(result, "wandering_null")
        assert found.value == pytest.approx(before.terms[0].value, rel=0.05)
        assert "the position" in found.sentence
        assert result.gap_after < 1.3
        assert result.held_out is not None
        assert result.held_out.gap_closed > before.terms[0].gap_closed - 0.03
    finally:
        unregister_effect("wandering_null")
