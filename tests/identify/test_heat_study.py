"""Pictures of heat between the models: what is drawn is what was computed."""

import numpy as np
from helpers.pictures import is_drawn

from thermohyd.identify.heat_study import EtaIdentifiability, heat_study_figure, identifiability_figure
from thermohyd.identify.report.style import png
from thermohyd.seed_paper import seed_valve
from thermohyd.wall_tests import heat_study


def test_heat_study_figure():
    study = heat_study(
        seed_valve(),
        wall_conductance=np.array([0.01, 1.0]),
        temperature=np.array([253.15, 333.15]),
        supply_pressure=70e5,
    )
    figure = heat_study_figure(study)
    leakage = figure.axes[1]
    curves = [np.asarray(line.get_ydata()) for line in leakage.lines]
    expected = 100.0 * (np.asarray(study.between.leakage_flow) / np.asarray(study.hm.leakage_flow) - 1.0)
    np.testing.assert_allclose(curves[0], expected[:, 0])
    assert is_drawn(png(figure))


def test_identifiability_figure_leaves_out_what_is_infinite():
    held = np.full((3, 2, 3), 0.1)  # tests, supply pressures, temperatures
    free = np.where(np.arange(3)[:, None, None] == 1, np.inf, 0.2)
    found = EtaIdentifiability(
        tests=("leakage", "pressure_gain", "flow_gain"),
        supply_pressure=np.array([70e5, 210e5]),
        temperature=np.array([250.0, 280.0, 310.0]),
        position=np.zeros(1),
        eta=0.5,
        noise=held,
        slope=held[..., None],
        held=held,
        free=free + 0.0 * held,
        all_tests=held[0],
        all_temperatures=held[:, :, 0],
    )
    figure = identifiability_figure(found)
    assert [len(axes.lines) for axes in figure.axes] == [3, 3, 3, 5, 5, 5]
    assert is_drawn(png(figure))
