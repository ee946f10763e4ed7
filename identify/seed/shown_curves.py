"""The seed paper's figures as curves to look into: over the opening, over temperature, what heat changes, and Eq. 6."""

import numpy as np

from thermohyd import seed_paper as paper
from thermohyd.identify.bench.shown_units import BAR, CELSIUS, CST, L_MIN
from thermohyd.identify.report.curves import Axis, Condition, Draw, Layer, Series, View

from .blocked_port_claims import PRESSURE_OPENINGS, heat_gap
from .curves import MODELS, SeedCurves
from .figures import OPENINGS, temperature_label
from .flow_claims import SMALL
from .study import SeedStudy


LAYERS = (Layer("HM: isothermal", "line"), Layer("THM: the oil keeps its heat", "line", "dash"))
WARM = Axis("oil temperature", "°C")


def seed_views(study: SeedStudy) -> list[View]:
    """In the order of the paper's figures, which both supply pressures have here."""
    c, drawn = study.curves, study.drawn
    gain = c.pressure_gain * c.stroke / paper.NOMINAL_PRESSURE
    flow_gain = c.flow_gain * c.stroke / paper.NOMINAL_FLOW
    return [
        _over_opening("Leakage against opening", c, drawn, Axis("leakage", "l/min", log=True), c.leakage * L_MIN),
        _over_temperature(
            "Leakage against temperature", c, OPENINGS, Axis("leakage", "l/min", log=True), c.leakage * L_MIN
        ),
        _over_temperature(
            "Pressure gain against temperature",
            c,
            (0.0, *PRESSURE_OPENINGS),
            Axis("K_PX, non-dimensional", log=True),
            gain,
        ),
        _over_opening("Flow against opening", c, drawn, Axis("flow", "l/min"), c.flow * L_MIN),
        _over_temperature(
            "Flow gain against temperature", c, (SMALL, 1.0), Axis("K_QX, non-dimensional", log=True), flow_gain
        ),
        _heat(c),
        _eq6(study),
    ]


def _supply(curves: SeedCurves) -> Condition:
    return Condition("supply", tuple(f"{p * BAR:.0f} bar" for p in curves.supply), (0,))


def _over_opening(title: str, c: SeedCurves, drawn: list[int], panel: Axis, values: np.ndarray) -> View:
    """values: (model, supply, temperature, opening)"""
    series = [
        Series((i, p), 100.0 * c.opening, tuple(Draw(m, values[m, p, at]) for m in range(len(MODELS))))
        for i, at in enumerate(drawn)
        for p in range(len(c.supply))
    ]
    warm = Condition("oil", tuple(temperature_label(c, at) for at in drawn))
    x = Axis("opening", "% of stroke")
    return View(title, x, (panel,), LAYERS, tuple(series), (warm, _supply(c)), colour=0, palette="warm")


def _over_temperature(title: str, c: SeedCurves, shares: tuple[float, ...], panel: Axis, values: np.ndarray) -> View:
    series = [
        Series(
            (i, p),
            c.temperature - CELSIUS,
            tuple(Draw(m, values[m, p, :, c.at_opening(share)]) for m in range(len(MODELS))),
        )
        for i, share in enumerate(shares)
        for p in range(len(c.supply))
    ]
    opened = Condition("opening", tuple(f"{100 * share:g} %" for share in shares))
    return View(title, WARM, (panel,), LAYERS, tuple(series), (opened, _supply(c)), colour=0)


def _heat(c: SeedCurves) -> View:
    quantities = (
        ("leakage", 0.0, "leakage at null"),
        ("pressure_gain", 0.01, "K_PX at 1 %"),
        ("flow_gain", SMALL, "K_QX at 1 %"),
    )
    series = [
        Series((i, p), c.temperature - CELSIUS, (Draw(0, 100.0 * heat_gap(c, name, share, p)),))
        for i, (name, share, _) in enumerate(quantities)
        for p in range(len(c.supply))
    ]
    of = Condition("quantity", tuple(words for _, _, words in quantities))
    supply = Condition("supply", tuple(f"{p * BAR:.0f} bar" for p in c.supply))
    panel = Axis("THM over HM", "%", rules=(5.0,), include=(0.0,))
    layers = (Layer("difference", "line"),)
    note = "The dotted level is the paper's 5 %."
    return View("What heat changes", WARM, (panel,), layers, tuple(series), (of, supply), colour=0, note=note)


def _eq6(study: SeedStudy) -> View:
    macro = study.macro["HM"]
    x = CST * np.array([fit.viscosity for fit in macro.fits])
    share = lambda values: 100.0 * np.array(values) / macro.stroke
    draws = (
        Draw(0, share([fit.worst for fit in macro.fits])),
        Draw(1, share([fit.smooth_worst for fit in macro.fits])),
        Draw(2, share([fit.worst for fit in study.two_terms])),
    )
    layers = (
        Layer("each temperature alone", "line", colour=0), Layer("smooth laws", "line", "dash", colour=1),
        Layer("a second tanh term, alone", "line", "dot", colour=2),
    )  # fmt: skip
    panel = Axis("largest error of the opening", "% of stroke", include=(0.0,))
    return View(
        "Eq. 6: its error", Axis("kinematic viscosity", "cSt", "log"), (panel,), layers, (Series((), x, draws),)
    )
