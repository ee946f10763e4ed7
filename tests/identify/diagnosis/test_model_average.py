"""Error bars of an ambiguous record hold what each rival says; of one without rivals they are the model's own."""

import numpy as np
import pytest
from helpers.small_bench import VALVE
from helpers.small_diagnosis import small_case, small_diagnosis

from thermohyd.identify.diagnosis.case import choose
from thermohyd.identify.diagnosis.final_model import final_model
from thermohyd.identify.fitting.problem_solution import gls_covariance


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


def test_without_rivals_nothing_is_widened():
    assert not any("span what the data allow" in note for note in small_diagnosis("pilot").after.notes)
