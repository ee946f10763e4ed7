"""The verdict: what can be judged, what cannot, and what casts doubt on the values whatever the misfit."""

from dataclasses import replace

import numpy as np
from helpers.fake_fit import fake_channel, fake_fit

from thermohyd.identify.fitting.misfit import verdict, verdict_of_motion
from thermohyd.identify.fitting.result import beyond_chance
from thermohyd.identify.report.fit_report import chi2_band, parameter_remarks


GOOD = fake_channel("leakage", "leakage_flow", 0.004 / 6e4, 1)
FLOW = fake_channel("flow_gain", "flow", 0.05 / 6e4, 3)
UNKNOWN = replace(GOOD, noise_known=False, noise_source="taken from the fit's residuals")


def test_a_known_noise_is_a_yardstick():
    assert verdict((GOOD, FLOW), True, "", {})[0] == "The ideal valve explains the record within its noise."
    missed = replace(GOOD, reduced_chi2=9.0)
    assert verdict((missed, FLOW), True, "", {})[0].startswith(
        "The ideal valve does not explain leakage: the misfit is up"
    )


def test_between_chance_and_disagreement_no_agreement_is_claimed():
    """Twice the variance is more than chance, and no disagreement to speak of; of a noise known from few rows much more is."""
    known = replace(GOOD, reduced_chi2=1.6)
    assert beyond_chance((known, FLOW)) == (known,)
    first = verdict((known, FLOW), True, "", {})[0]
    assert first.startswith(
        "The ideal valve misses leakage (leakage_flow) by up to 1.26 times the noise, more than chance"
    )
    assert "explains" not in first
    assert verdict_of_motion((known,), True, "")[0].startswith(
        "The actuator's model misses leakage (leakage_flow) by up"
    )
    for chance in (
        replace(known, noise_freedom=20.0),
        replace(known, effective_size=10.0),
        replace(known, noise_known=False),
        replace(known, reduced_chi2=1.19),  # stated a tenth too small
    ):
        assert not beyond_chance((chance, FLOW))


def test_noise_from_the_residuals_judges_nothing():
    first, sentence = verdict((UNKNOWN,), True, "", {})
    assert first.startswith(
        "Whether the ideal valve explains the record cannot be judged, as the noise was taken from the"
    )
    assert "State it (noise in bench.toml) or run each sweep twice (column run)." in first
    assert "this record alone cannot show a misfit there" in sentence
    both = verdict((UNKNOWN, FLOW), True, "", {})[0]
    assert both.startswith(
        "The ideal valve explains flow_gain within the noise. Whether it explains leakage cannot be judged"
    )


def test_quiet_neighbours_betray_a_misfit():
    loud = replace(UNKNOWN, neighbours=UNKNOWN.residual_rms / 5.0)
    assert "about a smooth curve, so there probably is one" in verdict((loud,), True, "", {})[1]
    assert "probably" not in verdict((replace(UNKNOWN, neighbours=UNKNOWN.residual_rms),), True, "", {})[1]


def test_limits_and_readings_that_follow_nothing_stand_in_the_verdict():
    words = verdict((GOOD,), True, "", fake_fit().parameters)
    assert words[1].startswith("At the limit of what is sensible: transition_number (lower limit, 1).")
    rng = np.random.default_rng(0)
    random = replace(UNKNOWN, measured=rng.normal(size=len(UNKNOWN.measured)), residual_rms=0.98)
    assert "it hardly follows the model at all. Is it the right column" in verdict((random,), True, "", {})[1]
    constant = replace(UNKNOWN, measured=np.ones(len(UNKNOWN.measured)), residual_rms=1e-9)
    assert verdict((constant,), True, "", {})[1].startswith(
        "leakage: leakage_flow never changes. Is it the right column"
    )


def test_noise_stated_far_too_large_is_said():
    words = verdict((replace(GOOD, reduced_chi2=0.1),), True, "", {})
    assert "the noise is stated larger than it is" in words[1]


def test_how_a_fit_stands():
    free = {n: p for n, p in fake_fit().parameters.items() if not p.at_bound}
    assert fake_fit(parameters=free, channels=(GOOD,)).standing == "good"
    assert fake_fit(parameters=free, channels=(replace(GOOD, reduced_chi2=1.6),)).standing == "open"
    assert fake_fit().standing == "open"  # a parameter ends at its limit
    assert fake_fit(parameters=free, channels=(UNKNOWN, FLOW)).standing == "open"
    assert fake_fit(parameters=free, channels=(replace(GOOD, reduced_chi2=3.0),)).standing == "bad"
    assert fake_fit(parameters=free, converged=False).standing == "bad"


def test_the_band_allows_for_noise_that_was_estimated():
    low, high = chi2_band(500.0)
    wider = chi2_band(500.0, 300.0)
    assert wider[0] < low < 1.0 < high < wider[1]
    rng = np.random.default_rng(5)
    ratios = rng.chisquare(500.0, 20000) / 500.0 / (rng.chisquare(300.0, 20000) / 300.0)
    assert abs(np.mean((ratios > wider[0]) & (ratios < wider[1])) - 0.95) < 0.01


def test_remarks_say_where_an_interval_comes_from():
    parameters = dict(fake_fit().parameters)
    radius = parameters["edge_radius"]
    parameters["edge_radius"] = replace(radius, by_profile=True, ci95=(0.0, 20e-6))
    parameters["clearance"] = replace(parameters["clearance"], conditional_on=("transition_number",))
    words = " | ".join(parameter_remarks(fake_fit(parameters=parameters)))
    assert "95 % intervals by profiles of chi-square" in words
    assert "the interval of edge_radius ends at a limit of the program's, not of the data's" in words
    assert "errors and intervals are conditional on transition_number staying at the bound" in words
