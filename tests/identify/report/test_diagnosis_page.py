"""The page and the figures of a diagnosis: drawn for every verdict, no network, escaped, reproducible."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.fake_diagnosis import KINDS, SUPPLY, fake_diagnosis, shared_diagnosis
from helpers.fake_fit import fake_channel
from helpers.html_page import Tags
from helpers.pictures import is_drawn
from helpers.report_page import check_text

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.report import style as plot_style
from thermohyd.identify.report.diagnosis_figures import diagnosis_figures
from thermohyd.identify.report.diagnosis_page import diagnosis_files, diagnosis_page


SVG = b"<svg xmlns='http://www.w3.org/2000/svg'/>"


def page(result, figures: dict[str, bytes] | None = None) -> str:
    return diagnosis_page(result, {} if figures is None else figures, "0.1.0")


def text(result) -> str:
    return re.sub(r"\s+", " ", " ".join(Tags(page(result)).words))


FIGURES = {"leakage", "pressure_gain", "flow_gain", "residual_map", "candidates"}
MORE = {
    "consistent": set(),
    "named": {"evidence_pilot_leakage", "exchange"},
    "two": {"evidence_pilot_leakage", "evidence_hysteresis", "exchange"},
    "ambiguous": {"evidence_pilot_leakage", "exchange"},
    "unexplained": {"variations"},
    "helped": {"evidence_pilot_leakage", "exchange", "variations"},
    "learned": {"variations"},
}


@pytest.mark.parametrize("kind", KINDS)
def test_figures_of_every_verdict(kind):
    figures = diagnosis_figures(fake_diagnosis(kind, points=12))
    assert set(figures) == FIGURES | MORE[kind]
    for figure in figures.values():
        with plot_style.style():
            assert is_drawn(plot_style.png(figure))


def test_files(tmp_path: Path):
    files = diagnosis_files(fake_diagnosis("named", points=12), {"schema": "x", "value": float("nan")})
    figures = FIGURES | MORE["named"]
    pictures = {f"{name}.{kind}" for name in figures for kind in ("png", "svg")}
    assert set(files) == pictures | {"diagnosis.json", "model.json", "report.html"}
    assert '"value": null' in str(files["model.json"])
    shown = str(files["report.html"])
    assert shown.count("data:image/svg+xml,") == len(figures)
    check_text(shown)
    for name in figures:
        assert ElementTree.fromstring(files[f"{name}.svg"]).tag.endswith("svg")
    assert "model.json" not in diagnosis_files(fake_diagnosis("consistent", points=12))


def test_same_data_same_svg():
    def draw() -> dict[str, bytes]:
        with plot_style.style():
            figures = diagnosis_figures(fake_diagnosis("helped", points=8))
            return {name: plot_style.svg(figure) for name, figure in figures.items()}

    assert draw() == draw()


def test_a_model_that_stayed_is_drawn_once():
    figures = diagnosis_figures(fake_diagnosis("unexplained", points=12))
    assert [axes.get_title(loc="left") for axes in figures["residual_map"].axes[:3]] == [
        "Leakage, ideal valve",
        "Pressure gain, ideal valve",
        "Flow gain, ideal valve",
    ]


def test_both_residual_panels_share_a_scale():
    figure = diagnosis_figures(fake_diagnosis("named", points=12))["leakage"]
    assert figure.axes[2].get_ylim() == figure.axes[3].get_ylim()
    assert figure.axes[1].get_ylabel() == "leakage - ideal valve [l/min]"


def test_port_pressures_get_a_figure_each():
    ports = tuple(fake_channel("pressure_gain", port, 1e4, 5, 8) for port in ("pressure_a", "pressure_b"))
    result = fake_diagnosis("named", points=8)
    fits = {which: replace(getattr(result, which), channels=ports) for which in ("before", "after")}
    figures = diagnosis_figures(replace(result, **fits))
    assert {"pressure_gain_pressure_a", "pressure_gain_pressure_b"} <= set(figures)


def test_runs_are_called_by_their_names():
    result = fake_diagnosis("named", points=12)
    channel = replace(result.before.channels[0], run=np.arange(96) % 12 // 6)  # two runs of every condition
    where = (channel.position, channel.supply_pressure, channel.supply_pressure, channel.temperature)
    names = TestRecord("leakage", Path("x"), *where, (), channel.run, ("slow", "fast"), channel.direction)
    record = replace(result.record, tests={"leakage": names})
    fit = replace(result.before, channels=(channel,))
    figure = diagnosis_figures(replace(result, record=record, before=fit, after=fit))["residual_map"]
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert "20 degC, 70 bar, run slow, rising" in labels
    assert "70 degC, 70 bar, run fast, falling" in labels


def test_a_large_record_stays_small():
    files = diagnosis_files(fake_diagnosis("named", points=1500))
    assert sum(len(content) for content in files.values()) < 12_000_000


def test_hardly_any_rows():
    result = fake_diagnosis("two", points=2)
    assert set(diagnosis_figures(result)) >= FIGURES


def test_says_what_the_terminal_says():
    shown = text(fake_diagnosis("ambiguous"))
    for expected in (
        "One of pilot_leakage, bushing_leakage or flowmeter_offset is missing",
        "ambiguous: the gap closes, but rivals remain",
        "0.04510 ± 0.00061",
        "0.04391 to 0.04630",
        "-90 to 85 um, 60 to 71 degC, falling sweeps",
        "bushing_leakage of 0.001860 l/min/bar (chi-square +1.7)",
        "Repeat the leakage test at 210 bar",
        "leakage, ports connected",
        "cannot be seen by this record, because the free parameters swallow them",
        "discharge_coefficient takes it up: 0.4 % of it is left",
        "needs the column time",
        "differences of repeated sweeps",
        "Run 3 of every test (70 degC), 480 rows",
        "the first stage takes its own flow",
    ):
        assert expected in shown


def test_who_closed_the_gap_is_said():
    shown = text(shared_diagnosis())
    for expected in (
        "the named effects 4 % 0 % 2 %",
        "faults of the bench 95 % 91 % 93 %",
        "the widened noise 3 % 1 % 2 %",
        f"wrong_supply: {SUPPLY.sentence} (p < 1e-6, 93 % of the gap opens again without it).",
        "model.json holds the ideal valve",
    ):
        assert expected in shown
    assert "closed the gap" not in text(fake_diagnosis("named"))


def test_what_is_left_is_said():
    shown = text(fake_diagnosis("helped"))
    assert "A misfit beyond noise (lack-of-fit test, p < 1e-6), most in flow gain" in shown
    assert "a fitted curve, not a cause" in shown


def test_user_text_is_escaped():
    result = fake_diagnosis("named", notes=("a <b>note</b>",), headline="<i>1</i>")
    result = replace(result, record=replace(result.record, name="<script>alert(1)</script> & co"))
    shown = page(result, {"residual_map": SVG})
    tags = [tag for tag, _ in Tags(shown).opened]
    assert tags.count("script") == [tag for tag, _ in Tags(page(fake_diagnosis("named"))).opened].count("script")
    assert "i" not in tags
    assert "<b>note" not in shown
    assert "&lt;script&gt;" in shown


def test_a_fit_that_did_not_converge_shouts():
    result = fake_diagnosis("named")
    broken = replace(result, after=replace(result.after, converged=False, message="why"))
    assert 'role="alert">THE FINAL FIT DID NOT CONVERGE: why' in page(broken)
    assert 'role="alert"' not in page(result)
    # A model that misses may be stuck on a kink: what the diagnosis is for, and no failure of it.
    stuck = replace(result, before=replace(result.before, converged=False, message="why"))
    assert 'role="alert"' not in page(stuck)
