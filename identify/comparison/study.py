"""Compare two records: diagnose both, put one model into both, fit them together, and say which entries differ beyond chance."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from thermohyd.effects.library import effect_info, find_effect
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.sensors import EACH_RUN, Sensor
from thermohyd.identify.diagnosis.screening import POWER
from thermohyd.identify.fitting.bench_faults import is_fault
from thermohyd.identify.fitting.parameters import ParameterPlan
from thermohyd.identify.fitting.relative import effect_plans
from thermohyd.identify.fitting.sensed import gain_name, zero_name
from thermohyd.numerics import require_float64

from . import words
from .both_models import Diagnosed, Swap, diagnosed, of_the_bench, rivals_in_both, same_oil, with_one_model
from .differences import (
    Estimates,
    LinearDifference,
    difference,
    equal_amounts,
    estimates_of,
    if_equal,
    largest_of,
    scores,
    shared_value,
)
from .instead import explanations, instead_of
from .joint_fit import joint_fit
from .result import ComparisonResult, Difference, Kind, SharedEntry, Side


LEVEL = 0.01  # probability of calling anything different where nothing is
UNEQUAL = 0.05  # probability of refusing to take anything of the bench for one in both records where all of it is
WITHIN = 2.0  # ratio of two priors of what may be one instrument


def compare(
    first: BenchRecord, second: BenchRecord, *, same_bench: bool = True, progress: Callable[[str], None] | None = None
) -> ComparisonResult:
    """Which parameters and effects differ between two records, second minus first, with the error of the difference.

    The records are of one valve (before and after an overhaul) or of two valves of a type. Each is diagnosed; effects that either
    asks for stand in both models; both are fitted together. same_bench: both were measured with the same instruments and oil,
    whose gains, zeros and amounts are then one in both as far as the data agree; what is not known of them leaves the
    differences alone.

    Raises BenchInputError where the records have different laws of an edge, or one of them determines nothing; RuntimeError in
    single precision.
    """
    require_float64("compare")
    began = time.perf_counter()
    say = progress or (lambda _: None)
    laws = (first.valve.edge_law, second.valve.edge_law)
    if laws[0] != laws[1]:
        raise BenchInputError(
            f'has edge_law = "{laws[1]}" where the first record has "{laws[0]}": their parameters are not the same '
            "quantities; give both the same law in [valve]",
            file=second.folder,
        )
    names = words.names_of(first, second)
    a = diagnosed(names[0], first, _said(say, names[0]))
    b = diagnosed(names[1], second, _said(say, names[1]))
    a, b = with_one_model(a, b, say)
    say("fitting both records together")
    model = fitted_model(a, b, same_bench)
    swaps = rivals_in_both(a, b, say)
    others = [(swap, fitted_model(swap.a, swap.b, same_bench)) for swap in swaps]
    result = in_figures(a, b, model, others, same_bench, say)
    return replace(result, seconds=time.perf_counter() - began)


def _said(say: Callable[[str], None], name: str) -> Callable[[str], None]:
    return lambda sentence: say(f"{name}: {sentence}")


@dataclass(frozen=True)
class Model:
    """One model of both records: its estimates, what they share and how probable that is, what might have been shared and is not."""

    found: Estimates
    shared: dict[str, float]
    refused: dict[str, float]
    differences: dict[str, LinearDifference | str]


def fitted_model(a: Diagnosed, b: Diagnosed, same_bench: bool) -> Model:
    """Both records fitted together with the effects that they have; what is of the bench is shared unless the data refuse it."""
    candidates = shareable(a, b) if same_bench else frozenset[str]()
    apart = estimates_of(joint_fit(a.part, b.part, frozenset()))
    p_values = {name: equal_amounts(apart, name, a.name, b.name) for name in candidates}
    shared = frozenset(name for name, p in p_values.items() if p >= UNEQUAL / len(p_values))
    found = estimates_of(joint_fit(a.part, b.part, shared)) if shared else apart
    both = {name for record, name in found.fit.free if record == a.name} & {
        name for record, name in found.fit.free if record == b.name
    }
    compared = [name for _, name in found.fit.free if name in both and not is_fault(name) and not each_run(name, a)]
    differences = {name: difference(found, name, a.name, b.name) for name in dict.fromkeys(compared)}
    keep = lambda chosen: {name: p for name, p in sorted(p_values.items()) if chosen(name)}
    return Model(found, keep(shared.__contains__), keep(lambda name: name not in shared), differences)


def shareable(a: Diagnosed, b: Diagnosed) -> frozenset[str]:
    """Names of what the bench may have in both: gains and zeros of the same instruments, amounts of its oil and instruments."""
    own = [_sensors(d) for d in (a, b)]
    found = {name for name in own[0] if name in own[1] and _one_instrument(name, own[0][name], own[1][name], a, b)}
    free = {name for name in a.fit.free if name in b.fit.free}
    oil = same_oil(a.record, b.record)
    for name in free:
        if name in a.problem.library.names and of_the_bench(name) and (oil or "oil" not in effect_info(name).stages):
            found.add(name)
    return frozenset(found & free)


def _sensors(d: Diagnosed) -> dict[str, Sensor]:
    """{parameter: the instrument whose gain or zero it is}, zeros of single runs left out."""
    channels = [c.sensor for test in d.problem.tests.values() for c in test.channels if c.sensor is not None]
    found = {}
    for sensor in (*d.record.sensors.values(), *channels):
        found |= {name: sensor for name in (gain_name(sensor), zero_name(sensor)) if name}
    return found


def each_run(name: str, d: Diagnosed) -> bool:
    """Whether it is the zero of a single run: nothing to compare."""
    return name in d.problem.plans and any(
        s.free_zero == EACH_RUN and name.startswith(f"{s.column}_zero_") for s in d.record.sensors.values()
    )


def _one_instrument(name: str, first: Sensor, second: Sensor, a: Diagnosed, b: Diagnosed) -> bool:
    plans = [d.problem.plans.get(name) for d in (a, b)]
    if plans[0] is None or plans[1] is None:
        return False
    priors = [plan.prior for plan in plans if plan is not None]
    if (first.gain, first.signal) != (second.gain, second.signal) or (priors[0] is None) != (priors[1] is None):
        return False
    if priors[0] is None or priors[1] is None:
        return True
    return max(priors[0].std, priors[1].std) <= WITHIN * min(priors[0].std, priors[1].std)


def in_figures(
    a: Diagnosed,
    b: Diagnosed,
    model: Model,
    others: list[tuple[Swap, Model]],
    same_bench: bool,
    say: Callable[[str], None] = lambda _: None,
) -> ComparisonResult:
    """The table of differences, and what it says."""
    known = {name: d for name, d in model.differences.items() if not isinstance(d, str)}
    std = {name: _over_rivals(d, others) for name, d in known.items()}
    law = largest_of([*known.values()])
    critical = law.critical(LEVEL)
    z = scores([*known.values()], std)
    rows = []
    for name in _in_order(a, b):
        plans = [_plan(name, d) for d in (a, b)]
        own = model.differences.get(name, "")
        row = _bare_row(name, plans, a, b, model)
        if row is None:
            continue
        if not isinstance(own, str) and not _one_unit(plans):
            own = "one record states what the other one's value is relative to, so they have no common unit"
        if isinstance(own, str):
            rows.append(_in_its_unit(replace(row, why=own or row.why), plans[0]))
            continue
        wide, reach = std[name], own.reach
        p, least = law.p_value(z[name]), (critical + float(ndtri(POWER))) * wide
        state = "differs" if p < LEVEL else "cannot tell" if least > _yardstick(name, plans) else "same"
        row = replace(
            row,
            state=state,
            difference=own.value,
            std=wide,
            ci95=(own.value - reach * wide, own.value + reach * wide),
            std_apart=own.std_apart,
            p_value=p,
            score=float(np.copysign(z[name], own.value)),
            least=least,
            freedom=own.freedom,
            why="too little is known of it: see what would show" if state == "cannot tell" else "",
            alternatives=tuple(swap.rival for swap, _ in others if swap.instead_of == name),
        )
        rows.append(_in_its_unit(row, plans[0]))
    told = [row for row in rows if row.std is not None]
    differing = [row.name for row in told if row.state == "differs"]
    rest = if_equal([*known.values()], [name for name in known if name not in differing])
    if differing and rest.p_value >= LEVEL:
        size = {name: _size(_plan(name, a)) for name in differing}
        rows = [
            replace(
                row,
                alone=rest.others[row.name][0] / size[row.name],
                alone_std=rest.others[row.name][1] / size[row.name],
            )
            if row.name in differing
            else row
            for row in rows
        ]
    rows = [_with_alternatives(row, a, b, model, same_bench, say) for row in rows]
    one_of = explanations([*known.values()], differing, LEVEL, say)
    open_ = {name for explanation in one_of for name in explanation.names}
    rows = [
        replace(row, state="cannot tell", why="it trades off against others of which one differs")
        if row.name in open_
        else row
        for row in rows
    ]
    undecided = not told or any(d.diagnosis.verdict == "unexplained" for d in (a, b))
    fit = model.found.fit
    result = ComparisonResult(
        names=(a.name, b.name),
        records=(a.record, b.record),
        diagnoses=(a.diagnosis, b.diagnosis),
        verdict="different" if differing else "undecided" if undecided or rest.p_value < LEVEL else "same",
        headline="",
        sentences=(),
        rows=tuple(rows),
        shared=tuple(_shared(name, p, model, a) for name, p in model.shared.items()),
        effects=tuple(dict.fromkeys((*a.fit.physics, *b.fit.physics))),
        level=LEVEL,
        critical=critical,
        same_p=rest.p_value,
        one_of=one_of,
        reduced_chi2=(a.scale, b.scale),
        same_bench=same_bench,
        converged=fit.converged,
        message=fit.message,
        seconds=0.0,
        notes=words.notes(a, b, model.refused),
        warnings=words.warnings(a, b, fit.converged, fit.message),
    )
    return replace(result, headline=words.headline(result), sentences=words.sentences(result))


def _with_alternatives(
    row: Difference, a: Diagnosed, b: Diagnosed, model: Model, same_bench: bool, say: Callable[[str], None]
) -> Difference:
    """A parameter that differs, with the effects that would explain its difference."""
    if row.state != "differs" or row.kind != "parameter":
        return row
    say(f"what else would explain the difference of {row.name}")
    other = instead_of(row.name, a, b, model.found.fit, frozenset(model.shared), same_bench)
    return replace(row, alternatives=other)


def _over_rivals(own: LinearDifference, others: list[tuple[Swap, Model]]) -> float:
    """Standard error over the model and its rivals, each weighed by its likelihood (docs/diagnosis.md section 10.2)."""
    total, square = 1.0, own.std**2
    for swap, model in others:
        there = model.differences.get(own.name)
        if there is None or isinstance(there, str):
            continue
        weight = float(np.exp(-0.5 * max(swap.chi2_more, 0.0)))
        total += weight
        square += weight * (there.std**2 + (there.value - own.value) ** 2)
    return max(float(np.sqrt(square / total)), own.std)


def _in_order(a: Diagnosed, b: Diagnosed) -> tuple[str, ...]:
    """Every entry that either record has, parameters first; shared ones are left out of the rows later."""
    plans = [n for d in (a, b) for n, plan in d.problem.plans.items() if plan.shown and not each_run(n, d)]
    return tuple(dict.fromkeys((*plans, *a.fit.physics, *b.fit.physics)))


def _plan(name: str, d: Diagnosed) -> ParameterPlan | None:
    if name in d.problem.plans:
        return d.problem.plans[name]
    return effect_plans((name,), d.record)[name] if find_effect(name) is not None else None


def _size(plan: ParameterPlan | None) -> float:
    return 1.0 if plan is None or plan.relative is None else plan.relative.size


def _yardstick(name: str, plans: list[ParameterPlan | None]) -> float:
    """The difference that one would want to see: an effect's largest usual amount, a parameter's natural step."""
    if find_effect(name) is not None:
        return effect_info(name).typical[1]
    return max(plan.info.scale for plan in plans if plan is not None)


def _bare_row(
    name: str, plans: list[ParameterPlan | None], a: Diagnosed, b: Diagnosed, model: Model
) -> Difference | None:
    """What both records say of an entry, before any difference; None where it is shared, or held in both."""
    if name in model.shared:
        return None
    free = [name in d.fit.free for d in (a, b)]
    if not any(free):
        return None
    kind: Kind = (
        "effect"
        if find_effect(name) is not None
        else "instrument"
        if name in _sensors(a) | _sensors(b)
        else "parameter"
    )
    plan = next(plan for plan in plans if plan is not None)
    sides = []
    for d, own, is_free in zip((a, b), plans, free, strict=True):
        entry = (d.name, name)
        if is_free:
            found = model.found
            pressed = bool(found.fit.active[found.place(entry)])
            sides.append(Side(found.fit.values[entry], found.std(entry), pressed))
        else:
            held = own is not None and name in d.problem.parameters and own.fixed
            sides.append(Side(own.start, None) if held and own is not None else None)
    why = ""
    for d, is_free, side in zip((a, b), free, sides, strict=True):
        if not is_free:
            why = f"{d.name} holds it fixed" if side is not None else f"{d.name} cannot speak of it"
    meaning = plan.info.meaning if kind != "effect" else effect_info(name).sentence
    return Difference(name, kind, plan.info.unit, sides[0], sides[1], "cannot tell", why=why, meaning=meaning)


def _one_unit(plans: list[ParameterPlan | None]) -> bool:
    relative = [None if plan is None else plan.relative for plan in plans]
    return relative[0] == relative[1]


def _in_its_unit(row: Difference, plan: ParameterPlan | None) -> Difference:
    """In strokes and the like where no record states a scale (docs/bench_format.md section 2.7)."""
    if plan is None or plan.relative is None:
        return row
    size = plan.relative.size
    of = lambda value: None if value is None else value / size
    side = lambda own: None if own is None else Side(own.value / size, of(own.std), own.at_bound)
    numbers = {key: of(getattr(row, key)) for key in ("difference", "std", "std_apart", "least")}
    ends = None if row.ci95 is None else (row.ci95[0] / size, row.ci95[1] / size)
    return replace(row, **numbers, ci95=ends, first=side(row.first), second=side(row.second), unit=plan.relative.unit)


def _shared(name: str, p: float, model: Model, a: Diagnosed) -> SharedEntry:
    value, std = shared_value(model.found, name)
    plan = _plan(name, a)
    assert plan is not None
    size = _size(plan)
    prior = None if plan.prior is None else plan.prior.std / size
    meaning = effect_info(name).sentence if find_effect(name) is not None else plan.info.meaning
    unit = plan.info.unit if plan.relative is None else plan.relative.unit
    return SharedEntry(name, unit, value / size, None if std is None else std / size, prior, p, meaning)
