"""A sensitivity study as curves to look into: the tests with what moves them, the shares of each figure, drift with its causes."""

import numpy as np

from thermohyd.identify.bench.columns import unit_of_test
from thermohyd.identify.bench.shown_units import CELSIUS, figure_unit
from thermohyd.identify.report.curves import Axis, Condition, Draw, Layer, Series, View

from .curves import TESTS
from .drift import CAUSES
from .factors import FACTORS
from .figures import DRAWN, TITLES, worth_showing
from .result import SensitivityResult
from .words import OF_DRIFT, SHORT


HUES = 7  # of the palette; factors beyond them share a hue and are dashed
PLACES = (-100.0, -50.0, -20.0, -5.0, 0.0, 5.0, 20.0, 50.0, 100.0)


def sensitivity_views(result: SensitivityResult) -> dict[str, list[View]]:
    """{place on the page: views}"""
    return {
        "tests": [_test(result, test) for test in TESTS],
        "sobol": [_shares(result, name) for name in SHORT],
        "drift": [_drift(result, name) for name in DRAWN if name in result.drifts],
    }


def _test(result: SensitivityResult, test: str) -> View:
    """The curve, and d ln y/d ln theta along it; a temperature at a time, unless the reader wants more."""
    c, s = result.curves, result.subject
    unit, normalised = unit_of_test(test), c.normalised(test)
    shown = worth_showing(normalised)
    series = []
    for place, temperature in enumerate(s.temperatures):
        rows = c.rows_at(temperature, s.supply_pressure)
        draws = [Draw(0, c.value[test][rows] * unit.factor)]
        draws += [Draw(1 + k, normalised[i, rows], 1) for k, i in enumerate(shown)]
        series.append(Series((place,), 100.0 * c.position[rows] / s.model.valve.stroke, tuple(draws)))
    at = int(np.argmin(np.abs(np.array(s.temperatures) - s.temperature)))
    own = Condition("temperature", tuple(f"{round(t - CELSIUS)} °C" for t in s.temperatures), (at,))
    relative = "the reading" if test == "leakage" else "the largest reading"
    names = [c.factors[i] for i in shown]
    return View(
        TITLES[test],
        Axis("position", "% of stroke", "root", ticks=PLACES),
        (
            Axis(
                TITLES[test].split(" (")[0].lower(),
                unit.label,
                "log" if test == "leakage" else "linear",
                log=test == "leakage",
                tall=0.7,
            ),
            Axis(f"sensitivity, relative to {relative}, per relative change", rules=(0.0,)),
        ),
        (
            Layer("the curve", "line", colour=-1),
            *(_layer(f.name, "" if f.relative else " (per tolerance)") for f in names),
        ),
        tuple(series),
        (own,),
        note="The position is stretched about null. One temperature is shown at first; switch others on to compare.",
    )


def _layer(name: str, more: str) -> Layer:
    place = FACTORS.index(name)
    return Layer(name + more, "line", "line" if place < HUES else "dash", colour=place)


def _shares(result: SensitivityResult, name: str) -> View:
    """First-order and total Sobol index of every factor on one figure, the most important factor of all first."""
    sobol, order = result.tolerances.sobol, result.ranking()
    o = sobol.outputs.index(name)
    total, first, half = (100.0 * values[o, order] for values in (sobol.total, sobol.first, sobol.total_ci))
    rows = list(range(len(order)))
    words = [
        f"total {t:.1f} %, first order {f:.1f} %, 95 %: ± {h:.1f}" for t, f, h in zip(total, first, half, strict=True)
    ]
    silent = [""] * len(rows)
    draws = (
        Series((), total, (Draw(0, rows, words=words),)),
        Series((), np.clip(first, 0.0, total), (Draw(1, rows, words=words),)),
        Series((), np.maximum(total - half, 0.0), (Draw(2, rows, x2=total + half, words=silent),)),
    )
    output = result.outputs[o]
    return View(
        f"{SHORT[name]}: {output.meaning}",
        Axis("share of the variance over the tolerances", "%", include=(0.0, 100.0)),
        (Axis("factor", names=tuple(result.factors[i].name for i in order)),),
        (
            Layer("total, interactions included", "bar", colour=0, faint=True),
            Layer("alone (first order)", "bar", colour=0),
            Layer("95 % interval of the total", "interval", colour=-1),
        ),
        draws,
    )


def _drift(result: SensitivityResult, name: str) -> View:
    drift = result.drifts[name]
    unit = figure_unit(drift.unit)
    draws = [Draw(0, 100.0 * drift.relative)]
    draws += [Draw(1 + k, 100.0 * part / drift.value) for k, part in enumerate(drift.parts)]
    draws.append(Draw(1 + len(CAUSES), drift.value * unit.factor, 1))
    layers = (
        Layer("whole drift", "line", colour=-1),
        *(Layer(cause, "line", "dash", colour=k) for k, cause in enumerate(CAUSES)),
        Layer("value", "line", colour=-1),
    )
    return View(
        OF_DRIFT[name],
        Axis("temperature", "°C"),
        (Axis("drift", "%/K", rules=(0.0,)), Axis(OF_DRIFT[name], unit.label, include=(0.0,), tall=0.6)),
        layers,
        (Series((), drift.temperature - CELSIUS, tuple(draws)),),
        note="The causes add up to the whole drift.",
    )
