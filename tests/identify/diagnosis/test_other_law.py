"""What the other law of an edge does to a diagnosis: an effect that only the wrong law asks for is not named, a real one is."""

from functools import cache

import pytest
from helpers.small_bench import small_record
from helpers.small_diagnosis import opened, small_case

from thermohyd.identify.diagnosis.diagnose import diagnose_case
from thermohyd.identify.diagnosis.other_law import ANOTHER_LAW
from thermohyd.identify.diagnosis.result import DiagnosisResult


pytestmark = pytest.mark.nightly  # whole diagnoses


@cache
def of_the_other_law(noise: float, leakage: float = 0.0) -> DiagnosisResult:
    """A record that the lubrication law made, diagnosed with the orifice law."""
    effects = {"pilot_leakage": leakage} if leakage else {}
    record = small_record(effects, valve={"edge_law": "lubrication"}, noise=noise, seed=3)
    return diagnose_case(opened(record), model_form=True)


def test_effects_that_only_the_wrong_law_asks_for_are_not_named():
    result = of_the_other_law(10.0)
    assert result.effects
    assert result.verdict == "ambiguous"
    for effect in result.effects:
        assert ANOTHER_LAW in {rival.name for rival in effect.alternatives}
    assert "cannot be told from another law of the edge" in result.headline
    names = {effect.name for effect in result.effects}
    [words] = [sentence for sentence in result.sentences if sentence.startswith("With the lubrication law")]
    assert all(name in words for name in names)
    assert "only the orifice law asks for" in words
    # More data of the right kind would show which law it is.
    assert result.next_test is not None
    assert ANOTHER_LAW in result.next_test.sentence
    assert result.next_test.evidence > 12.0
    content = result.to_dict()
    assert ANOTHER_LAW in content["effects"][0]["alternatives"]
    assert [fit["value"] for fit in content["effects"][0]["alternative_fits"] if fit["name"] == ANOTHER_LAW] == [None]
    assert content["fit"]["other_law"]["preferred"] == "lubrication"
    assert "edge law" in result.summary()


def test_a_real_effect_stands_beside_the_wrong_law():
    result = of_the_other_law(10.0, 1e-8)
    effects = {effect.name: effect for effect in result.effects}
    assert ANOTHER_LAW not in {rival.name for rival in effects["pilot_leakage"].alternatives}
    for name in effects.keys() - {"pilot_leakage"}:
        assert ANOTHER_LAW in {rival.name for rival in effects[name].alternatives}
    form = result.after.parameters["pilot_leakage"].model_form
    assert form is not None
    assert form.ci95 is not None
    assert form.ci95[0] < 1e-8 < form.ci95[1]
    assert result.to_dict()["fit"]["parameters"]["pilot_leakage"]["model_form"]["ci95"] == list(form.ci95)


def test_what_the_right_law_names_stays_named():
    result = diagnose_case(small_case("pilot"), model_form=True)
    assert result.verdict == "named"
    assert [effect.name for effect in result.effects] == ["pilot_leakage"]
    assert not result.effects[0].alternatives
    assert result.after.other_law is not None
    assert result.after.other_law.preferred == "orifice"
