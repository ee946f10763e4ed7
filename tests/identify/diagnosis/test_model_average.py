"""Error bars of an ambiguous record hold what each rival says, and what a suspect says; of one without either they are the model's own."""

from unittest.mock import patch

import numpy as np
import pytest
from helpers.small_bench import VALVE
from helpers.small_diagnosis import small_case, small_diagnosis

from thermohyd.identify.diagnosis import final_model as final_model_module, search as search_module
from thermohyd.identify.diagnosis.case import choose
from thermohyd.identify.diagnosis.diagnose import diagnose_case
from thermohyd.identify.diagnosis.final_model import final_model
from thermohyd.identify.diagnosis.model_average import without_rivals
from thermohyd.identify.fitting.problem_solution import gls_covariance


@pytest.mark.nightly  # a whole diagnosis
def test_error_bars_span_the_rivals():
    result = small_diagnosis("rivals")
    case, selection, split = choose(small_case("rivals"))
    model = final_model(case, selection, split)
    own = gls_covariance(model.fit, model.scale, len(case.problem.parameters))
    [rivals] = model.rivals.values()
    assert rivals.alike
    moved = 0
    for i, name in enumerate(model.fit.free):
        estimate = result.after.parameters[name]
        alone = float(np.sqrt(own.matrix[i, i]))
        if name in model.fit.effects or not estimate.std or not alone:
            continue
        assert estimate.std >= alone * (1.0 - 1e-9)
        assert estimate.ci95 is not None
        for rival in rivals.alike:
            if rival.chi2_more < 1.0 and abs(rival.fit.values[name] - estimate.value) > 5.0 * alone:
                moved += 1
                assert estimate.ci95[0] < rival.fit.values[name] < estimate.ci95[1]
    assert moved > 0  # or the record is no test of it
    at = result.after.free.index("clearance")
    std = result.after.parameters["clearance"].std
    assert std is not None
    assert result.after.covariance[at, at] == pytest.approx(std**2, rel=1e-6)
    assert any("span what the data allow" in note for note in result.after.notes)


@pytest.mark.nightly  # a whole diagnosis
def test_error_bars_span_the_same_effect_with_the_other_sign():
    result = small_diagnosis("mirrored")
    [effect] = result.effects
    assert effect.name == "unequal_underlap"
    assert effect.ci95 is not None
    underlap = result.after.parameters["underlap"]
    assert underlap.ci95 is not None
    for amount, own in ((4e-6, VALVE.underlap), (-4e-6, VALVE.underlap + 4e-6)):
        assert effect.ci95[0] < amount < effect.ci95[1]
        assert underlap.ci95[0] < own < underlap.ci95[1]
    assert any("unequal_underlap of the other sign in its place" in note for note in result.after.notes)
    assert effect.either_sign
    assert "or about as much of the other sign" in result.headline


@pytest.mark.nightly  # a whole diagnosis
def test_error_bars_span_a_suspect():
    """What was found and not proven is not in the model; what it moves is not known, and that is said."""
    named = small_diagnosis("pilot")
    with patch.object(final_model_module, "unproven", lambda found, names, *_: next(iter(names), None)):
        result = diagnose_case(small_case("pilot"))
    assert not result.effects
    assert [suspect.name for suspect in result.suspects] == ["pilot_leakage"]
    moved = 0
    for name, there in named.after.parameters.items():
        if (here := result.after.parameters.get(name)) is None or not there.std or here.ci95 is None:
            continue
        if abs(there.value - here.value) > 5.0 * there.std:
            moved += 1
            assert here.ci95[0] < there.value < here.ci95[1]
            assert "pilot_leakage" in here.averaged_over
    assert moved > 0
    [note] = [note for note in result.after.notes if "span what the data allow" in note]
    assert without_rivals((note, "another")) == ("another",)
    assert "neither proven nor excluded" in note
    assert "pilot_leakage" in note


@pytest.mark.nightly  # a whole diagnosis
def test_a_suspect_that_nobody_would_believe_is_not_spanned():
    result = small_diagnosis("too much")
    assert result.suspects
    assert not any("span what the data allow" in note for note in result.after.notes)


@pytest.mark.nightly  # a whole diagnosis
def test_error_bars_span_what_was_nearly_found():
    """Chance is no proof that an effect is not there: just below what names it, it is as likely as not."""
    plain = small_diagnosis("nothing")
    with patch.object(search_module, "NEARLY", 100.0):
        result = diagnose_case(small_case("nothing"))
    assert result.verdict == plain.verdict == "consistent"
    assert not result.effects
    wider = [name for name, here in result.after.parameters.items() if here.averaged_over]
    assert wider
    for name in wider:
        here, there = result.after.parameters[name], plain.after.parameters[name]
        assert here.value == pytest.approx(there.value, abs=0.01 * (there.std or 0.0))
        assert (here.std or 0.0) >= (there.std or 0.0)
    assert any("neither proven nor excluded" in note for note in result.after.notes)


def test_without_rivals_nothing_is_widened():
    assert not any("span what the data allow" in note for note in small_diagnosis("pilot").after.notes)
