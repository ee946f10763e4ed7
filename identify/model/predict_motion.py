"""Predict the rows of a record's dynamic tests from a model, with standard deviations from its covariance.

Light to import: what a model says of static and of dynamic tests apart, and the units of dynamic predictions.
"""

from dataclasses import replace

import numpy as np

from thermohyd.dynamics.integrate import FAILURES
from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.columns import ABSOLUTE_RATIO, reading_unit
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import KINDS
from thermohyd.identify.bench.test_record import DynamicTest, TestRecord
from thermohyd.identify.fitting.motion_readings import DynamicSimulator, Key, actuator_of, valve_of
from thermohyd.identify.fitting.motion_term_columns import predicted_with_terms
from thermohyd.identify.fitting.parameters import IN_MOTION, SEEN_IN_MOTION
from thermohyd.identify.fitting.sensed import Sensed, sensed, traced

from .model import Model, coefficient_names
from .typed_terms import TypedTerm


def as_read(slopes: dict[str, np.ndarray], model: Model, test: TestRecord, name: str) -> dict[str, np.ndarray]:
    """A channel's quantity (under "") and its derivatives, (rows,) each, as its sensor gives them.

    Raises BenchInputError where that has a gain or a zero which neither record nor model knows.
    """
    channel = next((c for c in test.channels if c.name == name), None)
    behind = None if channel is None else sensed(test, channel)
    if behind is None:
        return slopes
    values = {n: _sensor_value(n, behind, model, test) for n in behind.names}
    reading, factor, own = behind.readings(values, slopes[""])
    found = {n: factor * slope for n, slope in slopes.items()} | {"": reading}
    return found | {n: found.get(n, 0.0) + slope for n, slope in own.items()}


def _sensor_value(name: str, behind: Sensed, model: Model, test: TestRecord) -> float:
    if name in model.sensors:
        return model.sensors[name]
    sensor = behind.sensor
    if name == behind.gain and sensor.gain is not None:
        return sensor.gain
    if name != behind.gain and not sensor.free_zero:
        return sensor.zero
    what = "gain" if name == behind.gain else "zero"
    raise BenchInputError(
        f"nobody knows the {what} of the sensor of {sensor.column}, which [sensors] leaves free: give the model of a fit that "
        f"found it ({name}), or state it",
        file=test.path,
    )


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
    # The simulation follows a command's own signal, and the loop its own sensor.
    scales = traced(tests, record)
    for n in scales:
        if n not in model.sensors:
            raise BenchInputError(
                f"nobody knows {n}, which [sensors] leaves free and the command depends on: give the model of a fit that "
                "found it, or state it",
                file=record.folder,
            )
    amounts = tuple(n for n in covered if n in model.effects and _acts(n))
    held = {n: a for n, a in model.effects.items() if n not in amounts and a != 0.0}
    own = BenchRecord(record.folder, record.name, model.valve, model.oil, record.tests)
    valve = valve_of(own, model.parameters, held)
    actuator = actuator_of(machine, model.valve.rated_current, model.dynamics)
    simulator = DynamicSimulator(tests, valve, actuator, machine.heat, model.valve.polarity)
    names = (free or IN_MOTION[:1]) + scales  # a vector cannot be empty
    vector = [getattr(machine, n) if n not in model.dynamics and n in IN_MOTION else model.value(n) for n in names]
    at = np.array([*vector, *(model.effects[n] for n in amounts)])
    terms = tuple(term for term in model.learned if isinstance(term, TypedTerm) and term.moving)
    known = tuple(term for term in terms if term.covariance)
    of_terms: dict[Key, dict[str, np.ndarray]] = {}
    if terms:
        read, own = predicted_with_terms(simulator, names, amounts, at, terms)
        of_terms = {
            key: {
                name: slope
                for number, (term, slopes) in enumerate(zip(terms, by, strict=True))
                if term.covariance
                for name, slope in zip(coefficient_names(number, term), slopes, strict=True)
            }
            for key, by in own.items()
        }
    else:
        read = simulator.read(names, amounts, at)
    if read.failure:
        raise RuntimeError(FAILURES[read.failure])
    entries = (*names, *amounts)
    moving = replace(model, learned=known)
    matrix = None if model.covariance is None or not (covered or known) else moving.joint_covariance()
    covered = (
        *covered,
        *(name for n, term in enumerate(terms) if term.covariance for name in coefficient_names(n, term)),
    )
    found = {}
    for (name, channel), values in read.values.items():
        test = tests[name]
        if test.channels and channel not in [c.name for c in test.channels]:
            continue
        slopes_of = dict(zip(entries, read.slopes[name, channel], strict=True)) | of_terms.get((name, channel), {})
        of = as_read({"": values, **slopes_of}, model, test, channel)
        spread = np.full(len(values), np.nan)
        if matrix is not None:
            slopes = np.array([of.get(n, np.zeros(len(values))) for n in covered])
            spread = np.sqrt(np.maximum(np.einsum("ir,ij,jr->r", slopes, matrix, slopes), 0.0))
        found[name, channel] = of[""], spread
    return found


def _acts(name: str) -> bool:
    """Whether an effect takes part in motion: those of a sweep or of the static bench's own meters do not."""
    return effect_info(name).rowwise and not effect_info(name).on_readings


def signal_of_reading(test: TestRecord, channel: str) -> str:
    """The unit of the signal as which a record holds a reading; empty where it holds it in SI, or not at all."""
    return next((c.signal for c in test.channels if c.name == channel), "")


def unit_of(test: DynamicTest, channel: str) -> str:
    """The unit in which a prediction is written: that of the bench, of an amplitude ratio the SI one."""
    if channel != "amplitude_ratio":
        return reading_unit(channel, signal_of_reading(test, channel)).label
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
    learned = tuple(term for term in model.learned if not (isinstance(term, TypedTerm) and term.moving))
    if not moving and len(learned) == len(model.learned):
        return model
    keep = [i for i, n in enumerate(model.free) if n not in moving]
    matrix = None if model.covariance is None else model.covariance[np.ix_(keep, keep)]
    effects = {n: a for n, a in model.effects.items() if n not in moving}
    return replace(
        model, free=tuple(model.free[i] for i in keep), covariance=matrix, effects=effects, dynamics={}, learned=learned
    )
