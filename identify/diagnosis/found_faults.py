"""Put the faults of the bench that a final model holds into figures and words; they stay out of the valve's parameters."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.columns import column_unit, reading_unit
from thermohyd.identify.bench.shown_units import KINDS, DisplayUnit, beside
from thermohyd.identify.bench.test_record import Fault
from thermohyd.identify.fitting.bench_faults import BenchFault, is_fault
from thermohyd.identify.fitting.result import FitResult, ParameterEstimate

from .final_model import FinalModel
from .result import Alternative
from .rivals import Rival, of_another_test


def with_faults_apart(result: FitResult, faults: Mapping[str, BenchFault]) -> FitResult:
    """The result with what was fitted of the bench among `faults` instead of the parameters, and in words of its own.

    Covariances of what stays are as they are: the faults' uncertainty is in them.
    """
    if not any(map(is_fault, result.free)):
        return result
    kept = [i for i, name in enumerate(result.free) if not is_fault(name)]
    square = np.ix_(kept, kept)
    found = tuple(_fault(faults[name], estimate) for name, estimate in result.parameters.items() if is_fault(name))
    words = result.identifiability
    for name in result.free:
        if is_fault(name):
            sentences = tuple(s.replace(name, f"{faults[name].kind} of {where(faults[name])}") for s in words.sentences)
            words = replace(words, sentences=sentences)
    return replace(
        result,
        parameters={name: p for name, p in result.parameters.items() if not is_fault(name)},
        free=tuple(result.free[i] for i in kept),
        covariance=result.covariance[square],
        correlation=result.correlation[square],
        identifiability=words,
        faults=(*result.faults, *found),
    )


def with_evidence(result: FitResult, model: FinalModel, faults: Mapping[str, BenchFault]) -> FitResult:
    """The result with the p-value and the rivals of each fault that the model holds."""
    names = {(f.kind, f.test, f.channel, f.place): name for name, f in faults.items() if name in model.fit.faults}
    found = []
    for fault in result.faults:
        name = names.get((fault.name, fault.test, fault.channel, fault.run))
        if name is not None and not fault.rows:
            alike = [(r.name, alternative(r, faults)) for r in model.rivals[name].alike]
            rivals = tuple(a.words if a.name == fault.name else a.name for _, a in alike)
            closed = model.gap_closed(model.rivals[name].without)
            fault = replace(fault, p_value=model.p_values[name], alternatives=rivals, gap_closed=closed)
            elsewhere = " or ".join(a.where for other, a in alike if of_another_test(faults, other, name))
            if elsewhere:
                words = f"{fault.sentence}, or {elsewhere} as much the other way: these data cannot say which"
                fault = replace(fault, sentence=words)
        found.append(fault)
    return replace(result, faults=tuple(found))


def alternative(rival: Rival, faults: Mapping[str, BenchFault]) -> Alternative:
    """A rival of a named effect: another effect, or a fault of the bench by its kind and place."""
    value = rival.fit.values[rival.name]
    if not is_fault(rival.name):
        return Alternative(rival.name, value, effect_info(rival.name).unit, rival.chi2_more)
    fault = faults[rival.name]
    return Alternative(fault.kind, value * fault.size, unit_of(fault).si or "1", rival.chi2_more, where(fault))


def where(fault: BenchFault) -> str:
    """Of which test, reading, run or condition, in words."""
    test, channel = fault.test.replace("_", " "), fault.channel.replace("_", " ")
    parts = [part for part in (test, channel if channel and channel != test else "") if part]
    if not fault.place:
        return ", ".join(parts)
    return ", ".join([*parts, fault.place]) if parts else f"all tests at {fault.place}"


def unit_of(fault: BenchFault) -> DisplayUnit:
    """The bench unit of an amount times `size`."""
    if fault.channel:
        return reading_unit(fault.channel)
    if fault.info.moves == "spool_position":
        return KINDS["length"]
    return DisplayUnit("K", 1.0) if fault.info.moves == "temperature" else column_unit(fault.info.moves)


def _fault(fault: BenchFault, estimate: ParameterEstimate) -> Fault:
    std = None if estimate.std is None else estimate.std * fault.size
    return found(fault, estimate.value * fault.size, std)


def found(fault: BenchFault, value: float, std: float | None = None) -> Fault:
    """A fault of this amount (SI), in words."""
    unit = unit_of(fault)
    shown_std = None if std is None else std * unit.factor
    size = beside(abs(value) * unit.factor, shown_std)
    size = size if shown_std is None else f"{size} +- {beside(shown_std, shown_std)}"
    much = f"{size} {unit.label}"
    high = value > 0.0
    sentence = {
        "position_zero": f"positions read {much} too {'high' if high else 'low'} beside the other tests and runs",
        "reading_zero": f"readings are {much} too {'high' if high else 'low'} throughout, as a zero that is off makes them",
        "reading_drift": f"the reading's zero {'rises' if high else 'falls'} by {much} from the first row to the last",
        "wrong_temperature": f"the thermometer, or its label, reads {much} too {'high' if high else 'low'}",
        "wrong_supply": f"the supply gauge, or its label, reads {much} too {'high' if high else 'low'}",
    }[fault.kind]
    return Fault(
        fault.kind, fault.test, fault.channel, value, unit.si or "1", (), f"{where(fault)}: {sentence}", False, fault.place, std
    )  # fmt: skip
