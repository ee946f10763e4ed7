"""A servo study as curves to look into: steps, the loop's figures against temperature, and the Bode diagram."""

import numpy as np

from thermohyd.identify.bench.shown_units import BAR, decibel
from thermohyd.identify.report.curves import Axis, Condition, Draw, Layer, Series, View, every

from .figures import FIRST, HERTZ, PANELS, phase, shown_pulsations
from .study import MODELS, ServoStudy


NAMES = {"THM": "THM: the oil keeps its heat", "HM": "HM: isothermal"}
STEP_PANELS = (
    Axis("piston position", "% of the step", rules=(90.0,)),
    Axis("spool position", "% of stroke", tall=0.7),
    Axis("pressure in chamber A", "bar", tall=0.7),
    Axis("warmest chamber over the oil supplied", "K", tall=0.5),
)
ROWS = 500  # of a step response
BODE_ROWS = 400


def servo_views(study: ServoStudy) -> dict[str, list[View]]:
    """{place on the page: views}"""
    return {"step": [_steps(study)], "trend": _trends(study), "bode": [_bode(study)]}


def _temperatures(study: ServoStudy) -> Condition:
    return Condition("oil temperature", tuple(f"{round(celsius)} °C" for celsius in study.celsius))


def _steps(study: ServoStudy) -> View:
    s, series = study.subject, []
    for layer, model in enumerate(MODELS):
        sweep = study.steps[model]
        r = sweep.readings
        piston, spool = np.asarray(r.piston_position), np.asarray(r.spool_position)
        warm = np.maximum(np.asarray(r.temperature_a), np.asarray(r.temperature_b)) - sweep.temperature[:, None]
        curves = (
            100.0 * (piston - piston[:, :1]) / s.step, 100.0 * spool / s.model.valve.stroke, BAR * np.asarray(r.pressure_a), warm,
        )  # fmt: skip
        for i in range(len(study.celsius)):
            rows = np.flatnonzero(np.asarray(r.time[i]) >= FIRST)
            rows = rows[:: every(len(rows), ROWS)]
            draws = [Draw(layer, curve[i][rows], panel) for panel, curve in enumerate(curves)]
            series.append(Series((i,), np.asarray(r.time[i])[rows], tuple(draws if model == "THM" else draws[:3])))
    return View(
        "Step responses",
        Axis("time from the step", "s", "log"),
        STEP_PANELS,
        (Layer(NAMES["THM"], "line"), Layer(NAMES["HM"], "line", "dash")),
        tuple(series),
        (_temperatures(study),),
        colour=0,
        palette="warm",
    )


def _trends(study: ServoStudy) -> list[View]:
    layers = (
        Layer(NAMES["THM"], "line", colour=0), Layer(NAMES["HM"], "line", "dash", colour=1),
        Layer("linear formula at null, THM", "points", colour=2, hollow=True), Layer("motions of any size, THM", "line", "dot", colour=3),
    )  # fmt: skip
    views = []
    for panel in PANELS:
        draws = [Draw(layer, panel.values(study, model)) for layer, model in enumerate(MODELS)]
        used = [0, 1]
        for layer, more in ((2, panel.formula), (3, panel.large)):
            if more is not None:
                draws.append(Draw(len(used), more(study, "THM")))
                used.append(layer)
        label, unit = panel.title.rstrip("]").split(" [")
        rules = () if panel.limit is None else (panel.limit,)
        axis = Axis(label, unit, "log" if panel.logarithmic else "linear", rules=rules, log=panel.logarithmic)
        series = (Series((), study.celsius, tuple(draws)),)
        views.append(View(label, Axis("oil temperature", "°C"), (axis,), tuple(layers[i] for i in used), series))
    return views


def _bode(study: ServoStudy) -> View:
    loop = study.loops["THM"]
    rows = np.flatnonzero(shown_pulsations(study))
    rows = rows[:: every(len(rows), BODE_ROWS)]
    opened = np.asarray(loop.opened)
    angle = phase(opened)
    # An unstable loop has no response to show.
    closed = np.where(loop.stable[:, None], np.abs(loop.closed), np.nan)
    series = [
        Series(
            (i,),
            loop.pulsation[rows] * HERTZ,
            (
                Draw(0, decibel(np.abs(opened[i, rows]))),
                Draw(0, angle[i, rows], 1),
                Draw(1, np.asarray(decibel(closed[i, rows])), 2),
            ),
        )
        for i in range(len(study.celsius))
    ]
    return View(
        "Position loop, linearised at rest",
        Axis("frequency", "Hz", "log"),
        (
            Axis("magnitude of the open loop", "dB", rules=(0.0,), tall=0.8),
            Axis("phase of the open loop", "°", rules=(-180.0,), ticks=(-450, -360, -270, -180, -90), tall=0.7),
            Axis("magnitude of the closed loop", "dB", rules=(0.0,), tall=0.8),
        ),
        (Layer("open loop, THM", "line"), Layer("closed loop, THM", "line")),
        tuple(series),
        (_temperatures(study),),
        colour=0,
        palette="warm",
    )
