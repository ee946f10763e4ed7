"""Plan tests before any measurement: which effects they will show from which amount on, what they will confuse, which runs to add."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.diagnosis.case import LEVEL_OF_ALL_ROWS
from thermohyd.identify.diagnosis.next_test import cost_of
from thermohyd.identify.fitting.uncertainty import covariance_of
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import load_model
from thermohyd.numerics import require_float64

from . import words
from .added_runs import added_runs
from .planned_problem import Prospect, prospect_of
from .result import Addition, PlannedEffect, PlannedParameter, PlannedReading, PlanResult
from .visible import POWER, View, amount_told_apart, confused_with, groups, view_of


MOST_ADDED = 8  # runs that are tried beside the planned ones: each is a table of all columns


def plan(
    record: BenchRecord, *, model: Model | str | Path | None = None, progress: Callable[[str], None] | None = None
) -> PlanResult:
    """What the static tests of a record will show, before they are run: their readings, if there are any, are not used.

    model: the valve to expect, or the path of its model.json; else the record's [start], or the nominal valve. Noise is that
    which the record states, else a thousandth of each channel's largest reading.

    Raises BenchInputError where there is no static test or nothing is free, RuntimeError in single precision.
    """
    require_float64("plan")
    began = time.perf_counter()
    say = progress or (lambda _: None)
    say("the planned readings")
    prospect = prospect_of(record, load_model(model) if isinstance(model, str | Path) else model)
    view = view_of(prospect, say)
    added = [
        Addition(run.words, run.rows, run.seconds, run.shows, run.separates, run.per_hour)
        for run in added_runs(prospect, view, say)
    ]
    effects = tuple(_effects(prospect, view))
    result = PlanResult(
        record=record,
        headline="",
        sentences=(),
        effects=effects,
        parameters=tuple(_parameters(prospect)),
        readings=tuple(_readings(prospect)),
        order=tuple(sight.name for sight in view.sights),
        correlation=view.correlation,
        groups=groups(view, [effect.name for effect in effects if effect.seen]),
        added=tuple(added[:MOST_ADDED]),
        level=LEVEL_OF_ALL_ROWS,
        critical=view.critical,
        power=POWER,
        reading_seconds=cost_of(prospect.problem.tests.values())[1],
        seconds=0.0,
        notes=prospect.notes,
    )
    result = replace(result, headline=words.headline(result), sentences=words.sentences(result))
    return replace(result, seconds=time.perf_counter() - began)


def _effects(prospect: Prospect, view: View) -> list[PlannedEffect]:
    """In the order of the library, those that cannot be seen with the reason."""
    found, sights = [], {sight.name: sight for sight in view.sights}
    for name in (*prospect.problem.library.names, *prospect.problem.library.impossible):
        info = effect_info(name)
        if name not in sights:
            found.append(
                PlannedEffect(name, info.unit, None, info.typical, 0.0, None, (), 0.0, info.sentence, view.blind[name])
            )
            continue
        sight, why = sights[name], ""
        alone = None
        if sight.visible:
            apart = [amount_told_apart(view, name, other) for other in sights if other != name]
            most = max([sight.amount, *apart])
            alone = most if np.isfinite(most) else None
        else:
            why = "not even in five times its largest usual amount"
        found.append(
            PlannedEffect(
                name, info.unit, sight.amount if sight.visible else None, info.typical, sight.kept, alone,
                confused_with(view, name), sight.strength_of_usual, info.sentence, why,
            )
        )  # fmt: skip
    return found


def _parameters(prospect: Prospect) -> list[PlannedParameter]:
    problem, fit = prospect.problem, prospect.fit
    names = problem.free_parameters
    known = covariance_of(prospect.nuisance, names, np.zeros(len(names), int), [], slice(0, len(fit.residual)))
    found = []
    for i, name in enumerate(names):
        plan, why = problem.plans[name], known.why.get(i, "")
        size, unit = (1.0, plan.info.unit) if plan.relative is None else (plan.relative.size, plan.relative.unit)
        std = None if why else float(np.sqrt(known.matrix[i, i])) / size
        found.append(PlannedParameter(name, unit, fit.values[name] / size, std, why))
    return found


def _readings(prospect: Prospect) -> list[PlannedReading]:
    std = prospect.problem.noise.std
    return [
        PlannedReading(*key, len(std[key]), float(np.max(std[key])), source) for key, source in prospect.sources.items()
    ]
