"""Records made by either law of an edge and fitted with either: the interval that knows both laws holds the truth."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.fake_diagnosis import fake_diagnosis
from helpers.fake_fit import fake_fit, fake_parameters
from helpers.html_page import Tags
from helpers.records import random_valve, synthetic_record

from thermohyd.identify.bench.record import StartValue
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.model_form import PREFERRED, evidence, evidence_of_fits, other_law, with_model_form
from thermohyd.identify.fitting.result import FitResult, OtherLaw
from thermohyd.identify.report.diagnosis_page import diagnosis_page
from thermohyd.identify.report.fit_json import fit_json
from thermohyd.identify.report.model_form_words import preference
from thermohyd.identify.report.page import html_report


LAWS = ("orifice", "lubrication")
EITHER = [(truth, law) for truth in LAWS for law in LAWS]
NOISE = 8.0  # times that of a good bench


def valve_of(number: int, truth: str) -> Any:
    return replace(random_valve(np.random.default_rng([5, number])), edge_law=truth)


def fitted(number: int, truth: str, law: str, **start: Any) -> FitResult:
    random = np.random.default_rng([6, number])
    record = synthetic_record(valve_of(number, truth), random, points=31, noise=NOISE, **start)
    return fit(replace(record, valve=replace(record.valve, edge_law=law)), model_form=True)


@pytest.fixture(scope="module")
def results():
    return {(number, *laws): fitted(number, *laws) for number in range(2) for laws in EITHER}


@pytest.mark.nightly  # a recovery
@pytest.mark.parametrize(("truth", "law"), EITHER)
def test_the_interval_with_both_laws_holds_the_truth(results, truth, law):
    missed_by_the_noise_alone = 0
    for number in range(2):
        result, valve = results[number, truth, law], valve_of(number, truth)
        assert result.other_law is not None
        assert result.other_law.converged
        for name, estimate in result.parameters.items():
            form, true = estimate.model_form, getattr(valve, name)
            assert form is not None
            if name == "transition_number":
                assert (form.value, form.std, form.ci95) == (None, None, None)
                continue
            assert estimate.ci95 is not None
            assert form.ci95 is not None
            assert form.ci95[0] <= estimate.ci95[0] < estimate.ci95[1] <= form.ci95[1]
            assert form.ci95[0] <= true <= form.ci95[1], (number, name)
            missed_by_the_noise_alone += not estimate.ci95[0] <= true <= estimate.ci95[1]
    # The test means something: the error bars of the wrong law alone are false.
    assert (missed_by_the_noise_alone > 2) == (truth != law)


@pytest.mark.parametrize(("truth", "law"), EITHER)
def test_the_data_prefer_the_law_that_made_them(results, truth, law):
    for number in range(2):
        asked = results[number, truth, law].other_law
        assert (asked.own, asked.law) == (law, LAWS[1 - LAWS.index(law)])
        assert asked.preferred == truth
        assert (asked.evidence > PREFERRED) == (law != truth)
        assert (asked.chi2 < asked.own_chi2) == (law != truth)


def test_what_the_noise_alone_says_stays_as_it_was(results):
    result = results[0, "orifice", "orifice"]
    plain = fit(result.record)
    assert plain.other_law is None
    for name, estimate in plain.parameters.items():
        assert estimate.model_form is None
        assert replace(result.parameters[name], model_form=None) == estimate
    content = fit_json(plain)
    assert content["other_law"] is None
    assert {parameter["model_form"] for parameter in content["parameters"].values()} == {None}
    assert "law of the edge" not in plain.summary()


def test_json_table_and_report_hold_it(results):
    result = results[1, "lubrication", "orifice"]
    content, form = fit_json(result), result.parameters["edge_radius"].model_form
    found = content["parameters"]["edge_radius"]["model_form"]
    assert {key: found[key] for key in ("law", "value", "chi2")} == {
        "law": "lubrication",
        "value": form.value,
        "chi2": result.other_law.chi2,
    }
    assert found["ci95"] == list(form.ci95)
    assert found["std"] == pytest.approx(
        np.hypot(result.parameters["edge_radius"].std, (form.value - result.parameters["edge_radius"].value) / 3**0.5)
    )
    assert content["other_law"]["preferred"] == "lubrication"
    assert content["chi2"] == content["other_law"]["own_chi2"]
    assert content["other_law"]["parameters"]["edge_radius"]["value"] == form.value
    table = result.to_dataframe()
    assert table.loc["edge_radius", "model_form_value"] == form.value
    assert np.isnan(table.loc["transition_number", "model_form_value"])
    shown = result.summary()
    assert "With the lubrication law of the edge" in shown
    assert "The data prefer the lubrication law of the edge" in shown
    assert 'edge_law = "lubrication" in [valve]' in " ".join(shown.split())


def test_held_parameters_are_held_with_the_other_law_too():
    held = StartValue(12e-6, fixed=True)
    result = fitted(0, "orifice", "orifice", edge_radius=held)
    assert result.parameters["edge_radius"].model_form is None
    assert result.other_law is not None
    assert result.other_law.parameters["edge_radius"].value == 12e-6
    assert "transition_number" not in result.other_law.parameters


def asked(evidence: float = 0.0, reduced_chi2: float = 1.0, **values: float) -> OtherLaw:
    """What another law would say of `fake_fit`, with these values."""
    own = fake_fit()
    estimates = {n: e for n, e in fake_parameters().items() if n != "transition_number"}
    for name, value in values.items():
        std = estimates[name].std or 0.0
        estimates[name] = replace(estimates[name], value=value, ci95=(value - 2.0 * std, value + 2.0 * std))
    channels = tuple(replace(c, reduced_chi2=reduced_chi2) for c in own.channels)
    own = replace(own, channels=channels)
    valve = replace(own.record.valve, edge_law="lubrication")
    return other_law(own, replace(own, record=replace(own.record, valve=valve), parameters=estimates), evidence)


def test_a_parameter_that_only_the_law_settles_is_said_not_to_be_determined():
    result = with_model_form(fake_fit(), asked(edge_radius=4.1e-6, clearance=2.3e-6))
    form = {name: estimate.model_form for name, estimate in result.parameters.items()}
    assert result.other_law is not None
    assert result.other_law.preferred is None
    # Seven standard errors are not far where they are a tenth of the value.
    assert {name for name, f in form.items() if f is not None and f.undetermined} == {"edge_radius"}
    assert form["heat_retention"] is None
    assert form["edge_radius"] is not None
    assert form["edge_radius"].ci95 == pytest.approx((4.1e-6 - 2 * 0.118e-6, 14.93e-6 + 1.96 * 0.118e-6))
    words = "edge_radius: 14.93 +/- 0.12 um; 4.1 with the lubrication law: this record does not determine it."
    assert words in fit_json(result)["other_law"]["sentences"]
    shown = " ".join(result.summary().replace("*", "").split())
    assert words in shown
    assert "the data do not say which is right" in shown


def words_of(page: str) -> str:
    """What a reader sees."""
    return " ".join(" ".join(Tags(page).words).split())


def test_both_pages_show_it():
    result = with_model_form(fake_fit(), asked(edge_radius=4.1e-6))
    pages = [
        html_report(result, {}, "0"),
        diagnosis_page(replace(fake_diagnosis("named", points=4), after=result), {}, "0"),
    ]
    for html in pages:
        text = words_of(html)
        assert "With the lubrication law of the edge" in text
        assert "edge_radius 14.93 +/- 0.12 4.10 um -91.8 3.9 to 15.2 NOT DETERMINED" in text
        assert "this record does not determine it" in text
    assert "law of the edge" not in words_of(html_report(fake_fit(), {}, "0"))


@pytest.mark.parametrize("width", [80, 120])
def test_the_table_fits_into_a_terminal(monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    result = with_model_form(fake_fit(), asked(edge_radius=4.1e-6))
    lines = result.summary().splitlines()
    start = next(i for i, line in enumerate(lines) if "With the lubrication law" in line)
    assert "…" not in "".join(lines[start : start + 12])


def test_where_the_data_prefer_a_law_nothing_is_said_to_be_open():
    for speaks, law in ((40.0, "lubrication"), (-40.0, "orifice")):
        result = with_model_form(fake_fit(), asked(speaks, edge_radius=4.1e-6))
        assert result.other_law is not None
        assert result.other_law.preferred == law
        form = result.parameters["edge_radius"].model_form
        assert form is not None
        assert not form.undetermined


def test_beside_a_misfit_no_law_is_preferred():
    found = asked(40.0, reduced_chi2=3.0)
    assert found.misfit
    assert found.preferred is None
    assert "Neither law of the edge explains the record" in " ".join(
        fit_json(with_model_form(fake_fit(), found))["other_law"]["sentences"]
    )


def test_a_fit_that_did_not_converge_says_nothing_of_the_parameters():
    found = replace(asked(edge_radius=4.1e-6), converged=False, message="100 steps were not enough")
    result = with_model_form(fake_fit(), found)
    assert {estimate.model_form for estimate in result.parameters.values()} == {None}
    assert "did not converge (100 steps were not enough)" in fit_json(result)["other_law"]["sentences"][0]


def test_the_evidence_counts_parameters_and_independent_readings():
    assert evidence(100.0, 100.0, 6, 5, 1e9) == pytest.approx(2.0)
    assert evidence(100.0, 80.0, 5, 6, 1e9) == pytest.approx(18.0)
    own = fake_fit()
    worse = replace(
        own, chi2=2.0 * own.chi2, channels=tuple(replace(c, reduced_chi2=c.reduced_chi2 * 2.0) for c in own.channels)
    )
    better = min(own, worse, key=lambda fit: fit.chi2)
    independent = sum(c.effective_size * c.reduced_chi2 / max(c.reduced_chi2, 1.0) for c in better.channels)
    assert evidence_of_fits(worse, own) == pytest.approx(independent)
    assert evidence_of_fits(own, worse) == pytest.approx(-independent)


def test_a_law_that_did_not_converge_is_not_said_not_to_explain_the_record():
    own, other = fake_fit(converged=False, chi2=540.0, reduced_chi2=0.9), fake_fit(chi2=560.0)
    fine = lambda fit: replace(fit, channels=tuple(replace(c, reduced_chi2=0.9) for c in fit.channels))
    found = other_law(fine(own), fine(other), -20.0)
    assert not found.misfit
    assert found.preferred is None
    assert "did not converge: the two laws cannot be compared" in preference(found)
    assert "Neither law" in preference(replace(found, misfit=True, own_converged=True))
