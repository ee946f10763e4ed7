"""The first sentence of every report: what is wrong where, what explains it and how much of the gap that closes."""

from dataclasses import replace

import pytest
from helpers.fake_diagnosis import fake_diagnosis, hysteresis, pilot, regions, variation
from helpers.fake_fit import fake_channel, fake_fit

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.diagnosis.result import Alternative, HeldOut, NamedEffect, ParameterShift, Region, Suspect
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.report.diagnosis_report import further_sentences, headline
from thermohyd.identify.report.diagnosis_words import left_over, shift_rows, where_rows


LPM = 1.0 / 6e4  # m3/s
RIVAL = Alternative("bushing_leakage", 3.1e-13, "m3/(s Pa)", 1.7)
OTHER = Alternative("flowmeter_offset", 6.2e-6, "m3/s", 4.9)
HELD = HeldOut(480, "2 of 6 conditions", 5.0, 0.1, 6.0, 1.1, 0.98)
WHERE = regions()[:1]


def said(
    verdict, effects=(), *, where=WHERE, held: HeldOut | None = HELD, shifts=(), smooth=(), gap=(12.4, 1.02), **more
) -> str:
    return headline(verdict, effects, where, held, gap, shifts, smooth, **more)


def test_consistent():
    text = said("consistent", where=())
    assert "within its noise" in text
    assert "no effect of the library is needed" in text


@pytest.mark.parametrize("judged", [True, False])
def test_what_was_found_and_not_proven_is_a_hint(judged):
    hint = Suspect("temperature_offset", -8.0, "K", 4.0, 0.7, 6.1)
    text = said("consistent", where=(), judged=judged, suspects=(hint,))
    assert "temperature_offset (-8.000 K) is a hint that no rows left out confirm" in text
    assert "no effect of the library is needed" not in text
    assert ("within its noise, but " in text) == judged
    both = said("consistent", where=(), judged=judged, suspects=(hint, replace(hint, name="viscosity_shift", unit="")))
    assert "are hints that" in both
    assert "Nothing in the library is proven to do better" in said("consistent", where=(), judged=False)


def test_no_agreement_where_more_than_chance_is_left():
    loud = replace(fake_channel("flow_gain", "flow", 0.05 * LPM, 1), reduced_chi2=1.8)
    text = said("consistent", where=(), beyond=(loud,))
    assert "within its noise" not in text
    assert "misses flow_gain (flow) by up to 1.34 times the noise, more than chance makes of it" in text
    assert text.endswith("State that noise (noise in bench.toml) or repeat more of the sweeps.")


def test_one_effect_with_its_amount_where_it_shows_and_what_it_closes():
    text = said("named", (pilot(),))
    assert text.startswith(
        "The leakage flow deviates by 0.64 l/min RMS (above the model) at -203 to 203 um in leakage: "
    )
    assert "pilot_leakage (0.04510 +/- 0.00061 l/min/sqrt(bar)) is missing from the model" in text
    assert "with it 98 % of the gap closes on rows held out" in text
    assert text.endswith(".")


def test_two_effects():
    text = said("named", (pilot(), hysteresis()))
    assert "pilot_leakage (" in text
    assert " and hysteresis (1.400 +/- 0.050 um) are missing" in text
    assert "with them 98 %" in text


@pytest.mark.parametrize("held", [None, replace(HELD, before=0.0)])
def test_without_a_gap_on_rows_held_out_the_chi_squares_are_said(held):
    assert "reduced chi-square falls from 12.4 to 1.02" in said("named", (pilot(),), held=held)


def test_a_model_that_got_worse_on_rows_held_out_closes_nothing():
    assert "with it 0 % of the gap" in said("named", (pilot(),), held=replace(HELD, gap_closed=-0.4))


def test_rivals_are_named_and_not_told_from_it():
    text = said("ambiguous", (pilot(alternatives=(RIVAL, OTHER)),))
    assert "pilot_leakage (0.0451" in text
    assert "but pilot_leakage cannot be told from bushing_leakage or flowmeter_offset by these data" in text
    assert "is missing" not in text


def test_only_what_has_rivals_is_called_open():
    text = said("ambiguous", (pilot(), replace(hysteresis(), alternatives=(OTHER,))))
    assert "hysteresis cannot be told from flowmeter_offset" in text
    assert "pilot_leakage cannot" not in text


def test_unexplained_without_any_name():
    text = said("unexplained")
    assert "0.64 l/min RMS (above the model)" in text
    assert "nothing in the library explains it" in text
    assert "reduced chi-square 12.4" in text
    assert "varying" not in text


def test_unexplained_beside_a_name_keeps_its_rivals():
    text = said("unexplained", (pilot(alternatives=(RIVAL,)),), held=replace(HELD, gap_closed=0.61))
    assert "pilot_leakage (0.04510 +/- 0.00061 l/min/sqrt(bar), or bushing_leakage) closes 61 % of the gap" in text
    assert "nothing in the library explains the rest" in text
    assert "12.4 to 1.02" in text


def test_unexplained_without_rows_held_out():
    assert "pilot_leakage (0.04510 +/- 0.00061 l/min/sqrt(bar)) helps" in said("unexplained", (pilot(),), held=None)
    assert " help, " in said("unexplained", (pilot(), hysteresis()), held=None)


def test_unexplained_everywhere_alike():
    assert said("unexplained", where=()).startswith("Model and bench disagree beyond noise, and nothing in the library")


@pytest.mark.parametrize(
    ("share", "learned", "words"),
    [(0.95, False, "would close 95 %"), (0.95, True, "closes 95 %"), (0.3, False, None), (float("nan"), False, None)],
)
def test_a_curve_is_told_where_it_closes_most_and_is_no_cause(share, learned, words):
    text = said("unexplained", smooth=(replace(variation(learned), gap_closed=share),))
    if words is None:
        assert "varying" not in text
    else:
        assert f"clearance varying smoothly with temperature {words}, a fitted curve, not a cause" in text


@pytest.mark.parametrize(
    ("mean", "rms", "words"),
    [
        (0.64, 0.7, "0.70 l/min RMS (above the model)"),
        (-0.64, 0.7, "0.70 l/min RMS (below the model)"),
        (0.01, 0.5, "0.50 l/min RMS"),
        (-0.2, float("nan"), "0.20 l/min RMS (below the model)"),
    ],
)
def test_a_misfit_is_an_rms_and_no_mean_that_cancels(mean, rms, words):
    where = (Region("leakage", "leakage_flow", {}, 900.0, 0.9, 100, mean * LPM, rms * LPM),)
    assert f"The leakage flow deviates by {words} everywhere in leakage" in said("unexplained", where=where)


def test_a_port_is_called_by_its_letter():
    where = (Region("pressure_gain", "pressure_b", {}, 900.0, 0.9, 100, 0.0, 10e5),)
    assert "The pressure at port B deviates by 10 bar RMS everywhere" in said("unexplained", where=where)


def shift(name: str, before: float, after: float, std: float | None) -> ParameterShift:
    return ParameterShift(name, "m", before, after, std)


def test_the_parameter_that_would_have_been_spoiled_most():
    shifts = (
        shift("edge_radius", 15.2e-6, 14.9e-6, 0.1e-6),
        shift("clearance", 2.6e-6, 2.0e-6, 0.05e-6),
        shift("underlap", 9e-6, 1e-6, None),  # no honest error bar to judge by
    )
    assert said("named", (pilot(),), shifts=shifts).endswith("; ignoring it would have inflated clearance by 0.600 um.")
    lowered = (shift("clearance", 1.4e-6, 2.0e-6, 0.05e-6),)
    assert "lowered clearance by 0.600 um" in said("named", (pilot(),), shifts=lowered)


@pytest.mark.parametrize("shifts", [(), (shift("clearance", 2.05e-6, 2.0e-6, 0.05e-6),)])
def test_what_lies_within_its_error_bar_was_not_spoiled(shifts):
    assert "ignoring" not in said("named", (pilot(),), shifts=shifts)


def test_every_effect_of_the_library_can_be_said():
    for name, info in EFFECTS.items():
        effect = NamedEffect(name, info.typical[1], info.unit, None, None, 1e-9, 9.0, 0.9, info.sentence)
        assert f"{name} (" in said("named", (effect,))
        [line] = further_sentences((effect,), fit_of(), ())
        assert line.startswith(f"{name}: {info.sentence}")
        assert line.endswith(".")
        assert not line.endswith("..")


def test_unequal_laps_have_a_mirror_image_unless_both_ports_are_measured():
    info = EFFECTS["unequal_underlap"]
    effect = NamedEffect("unequal_underlap", 2e-6, info.unit, None, None, 1e-9, 9.0, 0.9, info.sentence)
    [line] = further_sentences((effect,), fit_of("load_pressure"), ())
    assert "the same with the other sign fits as well" in line
    [line] = further_sentences((effect,), fit_of("pressure_a", "pressure_b"), ())
    assert "other sign" not in line


def test_an_error_bar_that_spans_the_mirror_is_no_range_about_the_amount():
    info = EFFECTS["unequal_underlap"]
    effect = NamedEffect("unequal_underlap", 4.1e-6, info.unit, 5.8e-6, None, 1e-9, 9.0, 0.9, info.sentence)
    assert "(4.1 +/- 5.8 um)" in said("named", (effect,))
    mirrored = replace(effect, either_sign=True)
    for verdict in ("named", "unexplained"):
        words = said(verdict, (mirrored,))
        assert "(4.1 um or about as much of the other sign)" in words
        assert "5.8" not in words


def fit_of(*pressures: str) -> FitResult:
    channels = [fake_channel("pressure_gain", name, 0.35e5, 2, 20) for name in pressures or ("load_pressure",)]
    return fake_fit(channels=tuple(channels))


def test_headline_and_tables_show_the_same_figures():
    """The misfit, its excess, and what a parameter moves by: as a reader would subtract two cells of the table."""
    both = Region("leakage", "leakage_flow", {}, 900.0, 0.9, 100, 0.01 * LPM, 0.5 * LPM)
    moved = shift("clearance", 2.63461e-6, 2.03149e-6, 0.042e-6)
    words = said("named", (pilot(),), where=(both,), shifts=(moved,))
    result = fake_diagnosis("named", where=(both,), shifts=(moved,))
    (row,), (parameter,) = where_rows(result, result.where), shift_rows(result)
    assert row.miss == "0.50 l/min RMS, changes sign"
    assert "The leakage flow deviates by 0.50 l/min RMS" in words
    left = fake_diagnosis("unexplained", where_after=(both,), left_over_p=1e-9)
    assert "most in leakage, everywhere: 0.50 l/min RMS, changes sign along the sweep (90 %" in left_over(left)
    assert (parameter.before, parameter.after) == ("2.635", "2.031")
    assert words.endswith("inflated clearance by 0.604 um.")
    assert "reduced chi-square 12,345)" in said("unexplained", gap=(12345.0, 1.0))
    assert "99.6 % of the gap closes" in said(
        "named", (pilot(),), held=HeldOut(9, "sweeps", 3.0, 0.012, 4.0, 1.0, 0.996)
    )
