"""The word on a parameter, the rows of a report, and shares that are counted: no fit is run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.fake_diagnosis import fake_diagnosis
from helpers.fake_fit import fake_fit, fake_parameters
from scipy.stats import binomtest

from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.fitting.uncertainty import Block
from thermohyd.identify.noise.correlation import NoiseCorrelation, noise_correlation
from thermohyd.identify.report.diagnosis_page import diagnosis_files
from thermohyd.identify.report.fit_json import fit_files, fit_json
from thermohyd.identify.uncertainty.coverage import clopper_pearson, noise_like
from thermohyd.identify.uncertainty.predictions import figures_among
from thermohyd.identify.uncertainty.result import (
    LEVELS,
    CoverageOf,
    Knowledge,
    KnownParameter,
    Nested,
    Posterior,
    PosteriorOf,
    PredictedFigure,
    ProfileOf,
    ProfilePoint,
    Remedy,
)
from thermohyd.identify.uncertainty.rows import judged, trades_with


RISES = (1.0, 4.0, 7.0)
UM = 1e-6


def profile_of(name, value, std, *, open_low=False, open_high=False, seen=20.0, pressed=()):
    shape = ("bounded", "one-sided", "flat")[open_low + open_high]
    x = value + std * np.linspace(-3.0, 3.0, 13)
    points = tuple(ProfilePoint(float(v), float(((v - value) / std) ** 2), pressed if v > value else ()) for v in x)
    nested = tuple(
        Nested(level, value - std * rise**0.5, value + std * rise**0.5, open_low, open_high)
        for level, rise in zip(LEVELS, RISES, strict=True)
    )
    return ProfileOf(name, points, nested, RISES, shape, seen)


def known(**changes):
    fit = fake_fit()
    rows = {}
    for name in fit.free:
        e = fit.parameters[name]
        own = profile_of(name, e.value, e.std)
        rows[name] = KnownParameter(
            name, e.value, e.unit, e.std, e.ci95, "identified", "", 0.1, "", ("underlap", -0.71), own
        )  # fmt: skip
    radius = rows["edge_radius"]
    own = profile_of("edge_radius", radius.value, radius.std, open_low=True, pressed=("underlap",))
    draws = np.random.default_rng(1).normal(radius.value, radius.std, (4, 100, 1))
    nested = tuple(Nested(level, radius.value - UM, radius.value + UM) for level in LEVELS)
    rows["edge_radius"] = replace(
        radius, profile=own, verdict="practically not", why="the data give an upper limit only", averaged=("hysteresis",),
        posterior=PosteriorOf("edge_radius", radius.value, radius.std, nested, 1.001, 900.0, 800.0),
        coverage=CoverageOf("edge_radius", 93, 100, 0.86, 0.97), remedy=Remedy("repeat the tests at 95 degC", 0.4),
    )  # fmt: skip
    posterior = Posterior(
        ("edge_radius",), draws, np.zeros((4, 100), bool), np.zeros((4, 100)), 200, 7, 0.85, (0.85,),
        {"edge_radius": rows["edge_radius"].posterior}, "flat", "", b"draws",
    )  # fmt: skip
    figure = PredictedFigure(
        "null leakage",
        "leakage",
        343.15,
        210e5,
        1e-5,
        "m3/s",
        1e-7,
        (9.8e-6, 1.02e-5),
        Nested(0.95, 9.7e-6, 1.03e-5, False, True),
    )
    of = Knowledge(rows, True, posterior, 100, 2, 7, ("a note <of> the user's",), (figure,))
    return replace(fit, knowledge=replace(of, **changes))


@pytest.mark.parametrize(
    ("profile", "share", "word", "why"),
    [
        (profile_of("p", 1.0, 0.1), 0.0, "identified", ""),
        (profile_of("p", 1.0, 0.1, open_low=True), 0.0, "practically not", "an upper limit only"),
        (profile_of("p", 1.0, 0.1, open_high=True), 0.0, "practically not", "a lower limit only"),
        (profile_of("p", 1.0, 0.1, open_low=True, open_high=True), 0.0, "practically not", "every value"),
        (profile_of("p", 1.0, 0.1, open_low=True, open_high=True, seen=1e-4), 0.0, "structurally not", "the same whatever"),
        (profile_of("p", 1.0, 0.1), 0.8, "practically not", "80 % of what is known of it is its prior"),
    ],
)  # fmt: skip
def test_the_shape_of_a_profile_decides_the_word(profile, share, word, why):
    found = judged(fake_parameters()["edge_radius"], profile, share)
    assert found[0] == word
    assert why in found[1]


def test_without_a_profile_the_error_bar_decides_the_word():
    radius = fake_parameters()["edge_radius"]
    assert judged(radius, None, 0.0) == ("identified", "")
    assert judged(replace(radius, ci95=(0.0, radius.value)), None, 0.0)[0] == "practically not"
    blind = replace(radius, std=None, ci95=None, why_no_error_bar="no reading depends on edge_radius")
    assert judged(blind, None, 0.0)[0] == "structurally not"
    assert judged(fake_parameters()["transition_number"], None, 0.0)[0] == "practically not"


def test_what_a_parameter_trades_with_is_its_strongest_correlation():
    fit = fake_fit()
    assert trades_with(fit, "clearance") == ("edge_radius", -0.71)
    assert trades_with(fit, "null_bias") is None


def test_the_interval_of_a_share_is_the_exact_one():
    for held, records in ((0, 20), (19, 20), (20, 20), (90, 100)):
        exact = binomtest(held, records).proportion_ci(0.95, "exact")
        assert clopper_pearson(held, records) == pytest.approx((exact.low, exact.high), abs=1e-9)


def test_figures_are_asked_at_the_ends_of_what_was_read_and_beyond():
    rows, run = 12, np.zeros(12, dtype=int)
    test = TestRecord(
        "flow_gain", Path("flow_gain.csv"), np.linspace(-2e-4, 1e-4, rows), np.repeat([70e5, 140e5], 6), np.zeros(rows),
        np.repeat([243.15, 313.15], 6), (Channel("flow", np.zeros(rows)),), run, ("1",), np.ones(rows),
    )  # fmt: skip
    made, wanted = figures_among({"flow_gain": test}, 1e-6)
    # -55 degC is no oil's; both ends of the sweep, about the null, at the highest supply pressure
    assert [w.temperature for w in wanted] == [243.15, 313.15, 338.15]
    assert {(w.name, w.unit, w.supply_pressure) for w in wanted} == {("flow gain over the sweep", "m2/s", 140e5)}
    there = made["flow_gain"]
    assert there.rows == rows
    for figure in wanted:
        (_, low), (_, high) = sorted(figure.weights)
        assert there.temperature[[low, high]] == pytest.approx([figure.temperature] * 2)
        assert there.spool_position[[low, high]] == pytest.approx([1e-6 - 2e-4, 1e-6 + 2e-4])
        assert [figure.weights["flow", row] for row in (low, high)] == pytest.approx([-2500.0, 2500.0])
    assert np.all(there.supply_pressure == 140e5)


def test_simulated_noise_has_the_size_and_the_memory_that_the_fit_found():
    sweeps = np.repeat(np.arange(40), 100)
    block = Block(slice(0, 4000), sweeps, NoiseCorrelation(0.6, 0.8), 2.0)
    noise = noise_like(block, np.random.default_rng(1))
    assert np.var(noise) == pytest.approx(2.0, rel=0.1)
    found = noise_correlation(noise, sweeps, 0.0)
    assert found.share == pytest.approx(0.6, abs=0.12)
    assert found.phi == pytest.approx(0.8, abs=0.08)


def test_the_terminal_says_the_whole_row():
    said = " ".join(known().summary().split())
    for words in (
        "What is known of each parameter",
        "practically not identified: the data give an upper limit only",
        "93 of 100",
        "ringed in the picture",
        "also span what it is with hysteresis",
        "an end in brackets",
        "2 of which did not converge",
        "4 chains of 100 draws (seed 7)",
        "edge_radius: repeat the tests at 95 degC: error x 0.4",
        "a note <of> the user's",
        "What that says of the valve",
        "null leakage 70 degC, 210 bar 0.6000 0.0060 l/min 0.5880 to 0.6120 0.5820 to [0.6180]",
    ):
        assert words in said
    assert "What is known" not in fake_fit().summary()


def test_json_has_the_keys_that_the_format_promises():
    found = fit_json(known())["knowledge"]
    row = found["parameters"]["edge_radius"]
    assert set(row) == {
        "value", "std", "ci95", "verdict", "why", "prior_share", "bound", "trades_with", "profile", "posterior", "coverage",
        "remedy", "averaged_over",
    }  # fmt: skip
    assert row["profile"]["shape"] == "one-sided"
    assert [n["level"] for n in row["profile"]["intervals"]] == list(LEVELS)
    assert row["profile"]["points"][-1]["at_limit"] == ["underlap"]
    assert row["coverage"] == {"held": 93, "records": 100, "share": 0.93, "ci95": [0.86, 0.97]}
    assert found["predictions"] == [
        {
            "name": "null leakage", "test": "leakage", "temperature": 343.15, "supply_pressure": 210e5, "value": 1e-5, "unit": "m3/s",
            "std": 1e-7, "ci95": [9.8e-6, 1.02e-5],
            "profile95": {"low": 9.7e-6, "high": 1.03e-5, "open_low": False, "open_high": True},
        }
    ]  # fmt: skip
    assert found["posterior"]["file"] == "posterior.nc"
    assert fit_json(fake_fit())["knowledge"] is None


def test_files_hold_a_picture_per_parameter_and_the_draws_and_the_page_escapes_words():
    result = known()
    files = fit_files(result)
    assert files["posterior.nc"] == b"draws"
    assert {f"profile_{name}.png" for name in result.free} <= set(files)
    page = str(files["report.html"])
    assert "a note &lt;of&gt; the user&#39;s" in page
    assert "practically not identified" in page
    assert page.count('<img alt="profile ') == len(result.free)
    assert "0.5820 to [0.6180]" in page


def test_a_posterior_that_is_not_reported_leaves_one_sentence_and_no_file():
    trouble = "3 of 2000 trajectories diverged"
    of = known().knowledge
    assert of is not None
    drawn = of.posterior
    assert drawn is not None
    result = known(posterior=replace(drawn, parameters={}, trouble=trouble, file=b""), notes=(trouble,))
    assert trouble in result.summary(200)
    assert "posterior.nc" not in fit_files(result)
    assert fit_json(result)["knowledge"]["posterior"]["trouble"] == trouble


def test_a_diagnosis_shows_the_same_rows_in_all_its_faces():
    result = fake_diagnosis("named")
    knowledge = known().knowledge
    assert knowledge is not None
    assert knowledge.posterior is not None
    of_fault = PosteriorOf(
        "reading_zero (leakage)", 1e-8, 1e-9, knowledge.posterior.parameters["edge_radius"].intervals, 1.0, 500.0, 500.0
    )
    drawn = replace(knowledge.posterior, parameters={**knowledge.posterior.parameters, of_fault.name: of_fault})
    result = replace(result, after=replace(result.after, knowledge=replace(knowledge, posterior=drawn)))
    assert "What is known of each parameter" in result.summary(120)
    assert "What is known of each parameter" not in fake_diagnosis("named").summary(120)
    content = result.to_dict()["fit"]["knowledge"]
    assert list(content["faults"]) == ["reading_zero (leakage)"]
    assert content["faults"]["reading_zero (leakage)"]["mean"] == 1e-8
    assert "profile_clearance" in result.figures()
    files = diagnosis_files(result)
    assert files["posterior.nc"] == b"draws"
    assert "profile_clearance.svg" in files
    page = str(files["report.html"])
    assert "a note &lt;of&gt; the user&#39;s" in page
    assert page.count('<img alt="profile ') == len(knowledge.rows)
