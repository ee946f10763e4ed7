"""Curves of a page as data: what a view holds of a channel's rows, nothing that ends its element, pictures squeezed but the same."""

import base64
import json
from dataclasses import replace
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers.fake_comparison import fake_comparison
from helpers.fake_diagnosis import KINDS, fake_diagnosis
from helpers.fake_fit import fake_channel, fake_fit
from helpers.report_page import check_view

from thermohyd.identify.comparison.shown_curves import comparison_views
from thermohyd.identify.report.channel_curves import fit_views
from thermohyd.identify.report.curves import MOST_POINTS, Axis, Draw, Layer, Series, View, every, views_json
from thermohyd.identify.report.diagnosis_curves import diagnosis_views
from thermohyd.identify.report.picture import address


def test_what_users_write_cannot_end_the_element():
    hostile = "</script><!-- & <script>"
    view = View(
        hostile, Axis(hostile), (Axis("y"),), (Layer(hostile, "line"),), (Series((), [1.0], (Draw(0, [2.0]),)),)
    )
    text = str(views_json([view]))
    assert not set("<>&") & set(text)
    (found,) = json.loads(text)
    assert (found["title"], found["x"]["label"], found["layers"][0]["name"]) == (hostile,) * 3


def test_what_is_not_finite_is_a_gap():
    draw = Draw(0, np.array([np.nan, np.inf, 1.23456789]))
    view = View("v", Axis("x"), (Axis("y"),), (Layer("l", "line"),), (Series((), [0.0, 1.0, 2.0], (draw,)),))
    (found,) = json.loads(str(views_json([view])))
    assert found["series"][0]["draw"][0]["y"] == [None, None, 1.2346]
    assert found["series"][0]["x"] == [0, 1, 2]


def test_every_row_of_a_channel_is_in_its_view():
    fit = fake_fit()
    for view, channel in zip(fit_views(fit), fit.channels, strict=True):
        x = np.concatenate([series.x for series in view.series])
        y = np.concatenate([series.draw[1].y for series in view.series])
        rows = np.lexsort((y, np.round(x, 6)))
        order = np.lexsort((channel.measured, np.round(channel.position * 1e6, 6)))
        np.testing.assert_allclose(x[rows], channel.position[order] * 1e6)
        np.testing.assert_allclose(y[rows], channel.measured[order] * channel.unit.factor)
        assert {condition.name: condition.values for condition in view.conditions}["temperature"] == (
            "20 °C",
            "40 °C",
            "70 °C",
        )
        assert not view.note


def test_many_rows_are_thinned_and_it_is_said():
    channel = fake_channel("leakage", "leakage_flow", 1e-7, 1, 900)
    (view,) = fit_views(fake_fit(channels=(channel,)))
    assert sum(len(series.x) for series in view.series) <= 1.1 * MOST_POINTS
    step = every(len(channel.measured))
    assert step > 1
    assert f"One reading in {step}" in view.note


def test_runs_of_the_same_conditions_are_a_choice():
    channel = fake_channel("leakage", "leakage_flow", 1e-7, 1, 12)
    (view,) = fit_views(fake_fit(channels=(replace(channel, run=np.arange(96) % 12 // 6),)))
    assert view.conditions[-1].values == ("run 0", "run 1")
    assert len(fit_views(fake_fit(channels=(channel,)))[0].conditions) == 3


@pytest.mark.parametrize("kind", KINDS)
def test_views_of_every_verdict_hold_together(kind):
    views = diagnosis_views(fake_diagnosis(kind, points=6))
    for view in (view for of_place in views.values() for view in of_place):
        for shown in json.loads(str(views_json([view]))):
            check_view(shown)
    layers = [layer.name for layer in views["tests"][0].layers]
    assert ("residual of the ideal valve" in layers) == (kind in ("named", "two", "ambiguous", "helped", "learned"))
    assert bool(views["variations"]) == (kind in ("unexplained", "helped", "learned"))


def test_a_comparison_puts_both_records_into_one_view():
    views = comparison_views(fake_comparison())
    (differences,) = views["differences"]
    assert differences.panels[0].names == ("clearance", "edge_radius")
    assert [view.conditions[0].values for view in views["tests"]] == [("before", "after")] * 3
    assert {series.at[0] for series in views["tests"][0].series} == {0, 1}
    for view in json.loads(str(views_json([*views["differences"], *views["tests"]]))):
        check_view(view)


def test_a_picture_is_squeezed_and_stays_the_same():
    svg = (
        b"<?xml version='1.0'?>\n<!-- </script> --><svg xmlns='http://www.w3.org/2000/svg'>\n <metadata>x</metadata>\n"
        b' <path d="M 1.23456 -0.00012 L 3 4" transform="scale(0.015625)" fill="#2f6fb0"/>\n</svg>'
    )
    text = str(address(svg))
    assert not set('<>&"#\n') & set(text)
    drawn = ElementTree.fromstring(unquote(text.removeprefix("data:image/svg+xml,")))
    (path,) = drawn
    assert path.attrib == {"d": "M 1.23 0 L 3 4", "transform": "scale(0.015625)", "fill": "#2f6fb0"}
    assert len(text) < len(base64.b64encode(svg))
