"""A diagnosis as curves to look into: each test beside the plain and the final model, every effect's evidence, and what would have
to vary with what."""

import math

import numpy as np

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import display_unit
from thermohyd.identify.diagnosis.result import DiagnosisResult, Term, Variation

from .channel_curves import BAND, fit_views
from .curves import Axis, Draw, Layer, Series, View
from .diagnosis_figures import added_words, comparable, scaled_axes
from .diagnosis_words import candidate_rows, percent


def diagnosis_views(result: DiagnosisResult) -> dict[str, list[View]]:
    """{place on the page: views}"""
    final = added_words(result)
    plain = result.before if comparable(result) else None
    tests = fit_views(result.after, plain, (final if plain else result.plain_model, result.plain_model))
    views = {"tests": tests, "candidates": _candidates(result)}
    views["terms"] = [_term(found) for found in result.terms]
    views["variations"] = [_variation(found) for found in result.variations]
    return views


GROUPS = ("named", "rival", "other", "cannot be seen")


def _candidates(result: DiagnosisResult) -> list[View]:
    """|z| of each effect alone beside the plain model, the largest first."""
    shown = sorted(
        (c for c in result.candidates if math.isfinite(c.z)), key=lambda c: (c.state != "testable", -abs(c.z))
    )
    if not shown:
        return []
    named = {effect.name for effect in result.effects}
    rivals = {rival.name for effect in result.effects for rival in effect.alternatives}
    of = lambda c: 0 if c.name in named else 3 if c.state != "testable" else 1 if c.name in rivals else 2
    rows = {row.name: row for row in candidate_rows(result)}
    series = []
    for group in range(len(GROUPS)):
        places = [place for place, c in enumerate(shown) if of(c) == group]
        if places:
            x = [abs(shown[place].z) for place in places]
            series.append(Series((), x, (Draw(group, places, words=[_evidence(rows[shown[p].name]) for p in places]),)))
    level = result.critical_level
    if level is not None and math.isfinite(level):
        ends = [-0.5, len(shown) - 0.5]
        series.append(Series((), [level, level], (Draw(len(GROUPS), ends, words=[""] * 2),)))
    layers = tuple(
        Layer(name, "bar", colour=colour, faint=faint)
        for name, colour, faint in zip(GROUPS, (0, 1, 0, 6), (False, False, True, True), strict=True)
    )
    largest = max(abs(c.z) for c in shown)
    return [
        View(
            "Evidence for each effect",
            Axis(
                "evidence |z| in units of the noise, each alone",
                scale="root" if largest > 40.0 else "linear",
                include=(0.0,),
            ),
            (Axis("effect", names=tuple(c.name for c in shown)),),
            (*layers, Layer("must pass this", "line", "dash", colour=-1)),
            tuple(series),
        )
    ]


def _evidence(row) -> str:
    parts = [f"z = {row.z}" if row.z else "", f"p {row.p}" if row.p else "", row.estimate]
    parts += [f"alone closes {row.closed}" if row.closed else "", f"seen from {row.least} on" if row.least else ""]
    return ", ".join(part for part in parts if part) or row.why or row.state


def _term(found: Term) -> View:
    (x_unit, x_size), (unit, size) = scaled_axes(found)
    closes = f", closes {percent(max(found.gap_closed, 0.0))}" if math.isfinite(found.gap_closed) else ""
    x = Axis(found.variable.replace("_", " "), x_unit)
    y = Axis("shift", unit, rules=(0.0,))
    title = f"{found.place.replace('_', ' ')}: {found.law}{closes}"
    return _curve(title, x, y, found.variable_values * x_size, found.curve * size, found.band * size)


def _variation(found: Variation) -> View:
    unit = column_unit(found.variable)
    shown = display_unit(found.unit)
    label, size = ("%", 100.0) if found.unit in ("1", "dimensionless", "") else (shown.label, shown.factor)
    order = np.argsort(found.variable_values)
    closes = f", closes {percent(found.gap_closed)}" if math.isfinite(found.gap_closed) else ""
    x = Axis(found.variable.replace("_", " "), unit.label)
    y = Axis(f"change of {found.quantity.replace('_', ' ')}", label, rules=(0.0,))
    title = f"{found.quantity.replace('_', ' ')} with {found.variable.replace('_', ' ')}{closes}"
    return _curve(
        title, x, y, unit.of(found.variable_values[order]), found.curve[order] * size, found.band[order] * size
    )


def _curve(title: str, x: Axis, y: Axis, at: np.ndarray, curve: np.ndarray, std: np.ndarray) -> View:
    """A fitted curve with its 95 % band."""
    layers = (Layer("fitted curve", "line", colour=0), Layer(BAND.removesuffix(" of the model"), "band", colour=0))
    draws = (Draw(1, curve - 1.96 * std, y2=curve + 1.96 * std), Draw(0, curve))
    return View(title, x, (y,), layers, (Series((), at, draws),), note="A fitted curve, not a cause.")
