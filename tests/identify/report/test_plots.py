"""Figures of a fit: complete, small, reproducible, and without matplotlib's global state."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from helpers.fake_fit import fake_channel, fake_fit
from helpers.pictures import is_drawn

from thermohyd.identify.report import style as plot_style
from thermohyd.identify.report.fit_figures import parameter_figure, test_figures as draw_tests


@pytest.fixture(scope="module")
def figures():
    return draw_tests(fake_fit())


def test_one_figure_per_test(figures):
    assert list(figures) == ["leakage", "pressure_gain", "flow_gain"]


def test_axes_carry_units(figures):
    data, _, residuals, _ = figures["flow_gain"].axes
    assert data.get_ylabel() == "flow [l/min]"
    assert residuals.get_xlabel() == "spool position [um]"
    assert residuals.get_ylabel() == "residual / noise"


def test_every_point_is_drawn(figures):
    data = figures["flow_gain"].axes[0]
    drawn = sum(len(np.atleast_1d(line.get_xdata())) for line in data.lines if line.get_linestyle() == "None")
    assert drawn == 480


def test_legend_names_conditions(figures):
    words = {text.get_text() for legend in figures["leakage"].legends for text in legend.get_texts()}
    assert {"20 degC", "40 degC", "70 degC", "70 bar", "140 bar", "filled: position rising"} <= words


def test_png_and_svg(figures):
    with plot_style.style():
        assert is_drawn(plot_style.png(figures["leakage"]))
        drawing = plot_style.svg(figures["leakage"])
    assert ElementTree.fromstring(drawing).tag.endswith("svg")
    assert len(drawing) < 1_000_000


def test_same_data_same_svg():
    def draw() -> bytes:
        figure = parameter_figure(fake_fit())
        with plot_style.style():
            return plot_style.svg(figure)

    assert draw() == draw()


def test_both_ports_side_by_side():
    channels = tuple(fake_channel("pressure_gain", port, 1e4, 5) for port in ("pressure_a", "pressure_b"))
    (figure,) = draw_tests(fake_fit(channels=channels)).values()
    assert [axes.get_ylabel() for axes in figure.axes[:2]] == ["pressure A [bar]", "pressure B [bar]"]


def test_a_large_log_stays_small():
    channel = fake_channel("flow_gain", "flow", 1e-6, 7, points=4000)
    (figure,) = draw_tests(fake_fit(channels=(channel,))).values()
    with plot_style.style():
        assert len(plot_style.svg(figure)) < 2_000_000


def test_hardly_any_points():
    channel = fake_channel("leakage", "leakage_flow", 1e-6, 7, points=2)
    arrays = {name: value[:1] for name, value in vars(channel).items() if isinstance(value, np.ndarray)}
    for chosen in (channel, replace(channel, **arrays)):
        (figure,) = draw_tests(fake_fit(channels=(chosen,))).values()
        with plot_style.style():
            assert plot_style.png(figure)


def test_group_sorts_drifting_temperatures():
    index, means = plot_style.group(np.array([20.0, 40.4, 20.6, 39.8, 70.0]), closeness=4.0)
    assert index.tolist() == [0, 1, 0, 1, 2]
    assert means == pytest.approx([20.3, 40.1, 70.0])
    many, _ = plot_style.group(np.linspace(0.0, 100.0, 21), closeness=1.0)
    assert many.max() < plot_style.MOST_GROUPS


def test_no_pyplot_and_no_global_style():
    code = (
        "import sys, matplotlib; before = matplotlib.rcParams.copy()\n"
        "import thermohyd.identify.report.fit_figures\n"
        "assert matplotlib.rcParams.copy() == before\n"
        "assert 'matplotlib.pyplot' not in sys.modules and 'jax' not in sys.modules"
    )
    subprocess.run([sys.executable, "-P", "-c", code], check=True)


def test_a_matplotlibrc_of_the_working_folder_starts_no_latex(monkeypatch):
    monkeypatch.setitem(mpl.rcParams, "text.usetex", True)
    with plot_style.style():
        assert not mpl.rcParams["text.usetex"]
