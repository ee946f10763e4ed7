"""Predict the rows of a record's dynamic tests from a model, with standard deviations from its covariance.

Light to import: what a model says of static and of dynamic tests apart, and the units of dynamic predictions.
"""

from dataclasses import replace

import numpy as np

from thermohyd.dynamics.integrate import FAILURES
from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.columns import ABSOLUTE_RATIO, column_unit
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord, DynamicTest
from thermohyd.identify.bench.shown_units import KINDS
from thermohyd.identify.fitting.motion_readings import DynamicSimulator, Key, actuator_of, valve_of
from thermohyd.identify.fitting.parameters import IN_MOTION, SEEN_IN_MOTION

from .model import Model


def predict_motion(model: Model, record: BenchRecord) -> dict[Key, tuple[np.ndarray, np.ndarray]]:
    """{(test, channel): (reading, standard deviation)} per row, SI; channels of the record, or all where it has none.

    The record's own [actuator] describes the machine, the model's numbers what was identified; without that table the
    model's actuator does. Raises BenchInputError where neither is there, RuntimeError where a run cannot be simulated.
    """
    tests = record.dynamic_tests
    assert record.actuator is not None
    machine = record.actuator if record.actuator_given or model.actuator is None else model.actuator
    covered = model.free if model.covariance is not None else ()
    # In the order of a fit's vector: the program that a fit of this record compiled serves here, too.
    free = tuple(
        n for n in (*IN_MOTION, *SEEN_IN_MOTION) if n in covered and (n in model.dynamics or n in model.parameters)
    )
    amounts = tuple(n for n in covered if n in model.effects and _acts(n))
    held = {n: a for n, a in model.effects.items() if n not in amounts and a != 0.0}
    own = BenchRecord(record.folder, record.name, model.valve, model.oil, record.tests)
    valve = valve_of(own, model.parameters, held)
    actuator = actuator_of(machine, model.valve.rated_current, model.dynamics)
    simulator = DynamicSimulator(tests, valve, actuator, machine.heat, model.valve.polarity)
    names = free or IN_MOTION[:1]  # a vector cannot be empty
    vector = [getattr(machine, n) if n not in model.dynamics and n in IN_MOTION else model.value(n) for n in names]
    read = simulator.read(names, amounts, np.array([*vector, *(model.effects[n] for n in amounts)]))
    if read.failure:
        raise RuntimeError(FAILURES[read.failure])
    order = (*free, *amounts)
    pick = [covered.index(n) for n in order]
    matrix = None if model.covariance is None or not order else model.covariance[np.ix_(pick, pick)]
    found = {}
    for (name, channel), values in read.values.items():
        test = tests[name]
        if test.channels and channel not in [c.name for c in test.channels]:
            continue
        slopes = read.slopes[name, channel]
        spread = np.full(len(values), np.nan)
        if matrix is not None:
            spread = np.sqrt(np.maximum(np.einsum("ir,ij,jr->r", slopes, matrix, slopes), 0.0))
        found[name, channel] = values, spread
    return found


def _acts(name: str) -> bool:
    """Whether an effect takes part in motion: those of a sweep or of the static bench's own meters do not."""
    return effect_info(name).rowwise and not effect_info(name).on_readings


def unit_of(test: DynamicTest, channel: str) -> str:
    """The unit in which a prediction is written: that of the bench, of an amplitude ratio the SI one."""
    if channel != "amplitude_ratio":
        return column_unit(channel).label
    if not test.absolute:
        return "1"
    kind = ABSOLUTE_RATIO[test.output, test.command_kind == "current"]
    return "1/s" if kind == "frequency" else KINDS[kind].si or KINDS[kind].label


def require_actuator(model: Model, record: BenchRecord) -> None:
    """Raise BenchInputError where nobody says which actuator a dynamic record is of."""
    if record.dynamic_tests and not record.actuator_given and model.actuator is None:
        raise BenchInputError(
            "has dynamic tests but no [actuator], and the model has none either; add [actuator]", file=record.folder
        )


def as_static(model: Model) -> Model:
    """The part of a model that static tests see: without what was identified from motion."""
    moving = {n for n in model.effects if effect_info(n).dynamic} | set(model.dynamics)
    if not moving:
        return model
    keep = [i for i, n in enumerate(model.free) if n not in moving]
    matrix = None if model.covariance is None else model.covariance[np.ix_(keep, keep)]
    effects = {n: a for n, a in model.effects.items() if n not in moving}
    return replace(model, free=tuple(model.free[i] for i in keep), covariance=matrix, effects=effects, dynamics={})
