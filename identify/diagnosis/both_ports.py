"""What reading the pressure of each port, and not only their difference, would tell of two rivals."""

import numpy as np

from thermohyd.effects.registry import EFFECTS, with_effects
from thermohyd.static_tests import blocked_port_readings

from ..parameters import identified_by_default
from ..static_model import base_valve, conditions_of, mean_over_nodes, row_weights
from .library_fit import LibraryFit, LibraryProblem
from .library_model import PARAMETERS
from .projection import Projection


BOTH_PORTS = "with the pressure of each port read"
TEST = "pressure_gain"
STEP = 1e-3  # of a parameter's natural step: finite differences, for a handful of rows' worth of evidence


def can_measure_ports(problem: LibraryProblem) -> bool:
    """Whether the record has a pressure-gain test that reads the difference only."""
    test = problem.tests.get(TEST)
    return test is not None and [c.name for c in test.channels] == ["load_pressure"]


def ports_apart(problem: LibraryProblem, true: LibraryFit, other: LibraryFit) -> float:
    """Chi-square by which `other`, refitted, would miss both ports' pressures of a valve that follows `true`."""
    std = np.tile(problem.noise.std[TEST, "load_pressure"], 2)
    made, claimed = _ports(problem, true.values, true), _ports(problem, other.values, other)
    columns = []
    for name in other.free:
        step = STEP * _scale(problem, name)
        columns.append((_ports(problem, {**other.values, name: other.values[name] + step}, other) - claimed) / step)
    known = problem.evaluate(other.values, other.effects)
    old = known.columns[:, [known.order.index(name) for name in other.free]]
    at = np.concatenate([old, np.stack(columns, axis=1) / std[:, None]])
    difference = np.concatenate([np.zeros(len(old)), (claimed - made) / std])
    if not (np.isfinite(at).all() and np.isfinite(difference).all()):
        return 0.0
    left = Projection.beside(at)(difference)
    return float(left @ left)


def _ports(problem: LibraryProblem, values: dict[str, float], fit: LibraryFit) -> np.ndarray:
    """p_A of every row, then p_B."""
    test = problem.tests[TEST]
    heat = "throttle_heating" in fit.effects
    valve = base_valve(problem.record, {name: values[name] for name in PARAMETERS if name in values}, heat=heat)
    valve = with_effects(valve, {name: values[name] for name in fit.effects if name != "flowmeter_lag"})
    readings, weight = blocked_port_readings(valve, conditions_of(test)), row_weights(test)
    ports = [readings[channel] for channel in ("pressure_a", "pressure_b")]
    ports = ports if weight is None else [mean_over_nodes(port, weight) for port in ports]
    return np.concatenate([np.asarray(port)[: test.rows] for port in ports])


def _scale(problem: LibraryProblem, name: str) -> float:
    return EFFECTS[name].scale if name in EFFECTS else identified_by_default(problem.record.valve)[name].scale
