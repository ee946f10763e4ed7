"""Pictures of an actuator's performance: what is drawn is what was computed."""

import numpy as np
import pytest
from helpers.pictures import is_drawn

from thermohyd.actuator import seed_actuator
from thermohyd.actuator_performance import performance
from thermohyd.control_loop import loop_margins
from thermohyd.identify.servo.performance_figures import PANELS, bode_figure, performance_figure, performance_plots
from thermohyd.seed_paper import seed_valve


WARM = [253.15, 293.15, 333.15]


def test_bode_marks_its_margins():
    figure = bode_figure(seed_valve(), seed_actuator(), temperatures=WARM, supply_pressure=70e5)
    found = performance(seed_valve(), seed_actuator(), temperature=np.array(WARM), supply_pressure=70e5)
    margins = loop_margins(found, seed_actuator())
    gain, phase, _ = figure.axes
    marks = [line for line in gain.lines if line.get_marker() == "o"]
    for line, expected in zip(marks, margins.gain_margin, strict=True):
        assert np.asarray(line.get_ydata())[0] == pytest.approx(-20.0 * np.log10(expected), rel=1e-9)
    # Each mark lies on its curve.
    for axes in (gain, phase):
        drawn = [
            (line.get_marker() == "o", np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
            for line in axes.lines
        ]
        curves, dots = ([(x, y) for marked, x, y in drawn if marked == dot and len(x) != 2] for dot in (False, True))
        for (x, y), (at, height) in zip(curves, dots, strict=True):
            assert height[0] == pytest.approx(np.interp(np.log(at[0]), np.log(x), y), abs=0.5)


def test_panels_and_pngs():
    figure = performance_figure(seed_valve(), seed_actuator(), temperatures=WARM, supply_pressures=[70e5, 210e5])
    assert [axes.get_title(loc="left") for axes in figure.axes] == [panel.title for panel in PANELS]
    found = performance_plots(seed_valve(), seed_actuator(), temperatures=WARM, supply_pressures=[70e5, 210e5])
    assert set(found) == {"bode", "performance"}
    assert all(is_drawn(picture) for picture in found.values())
