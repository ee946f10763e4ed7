"""What a model predicts at the rows of a record's dynamic tests, with standard deviations from its covariance."""

import numpy as np

from thermohyd.dynamics.integrate import FAILURES
from thermohyd.effects.registry import effect_info

from ..model import Model
from ..parameters import IN_MOTION
from ..record import BenchRecord
from .machine import actuator_of, valve_of
from .simulator import DynamicSimulator, Key


def predict_motion(model: Model, record: BenchRecord) -> dict[Key, tuple[np.ndarray, np.ndarray]]:
    """{(test, channel): (reading, standard deviation)} per row, SI; channels of the record, or all where it has none.

    The record's own [actuator] describes the machine, the model's numbers what was identified; without that table the
    model's actuator does. Raises BenchInputError where neither is there, RuntimeError where a run cannot be simulated.
    """
    data = record.dynamic
    assert data is not None
    machine = data.actuator if data.given or model.actuator is None else model.actuator
    covered = model.free if model.covariance is not None else ()
    free = tuple(n for n in covered if (n in model.dynamics or n in model.parameters) and n != "heat_retention")
    amounts = tuple(n for n in covered if n in model.effects and _acts(n))
    held = {n: a for n, a in model.effects.items() if n not in amounts and a != 0.0}
    own = BenchRecord(record.folder, record.name, model.valve, model.oil, record.tests)
    valve = valve_of(own, model.parameters, held)
    actuator = actuator_of(machine, model.valve.rated_current, model.dynamics)
    simulator = DynamicSimulator(data.tests, valve, actuator, machine.heat, model.valve.polarity)
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
        test = data.tests[name]
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
    return effect_info(name).effect.rowwise and "readings" not in effect_info(name).stages
