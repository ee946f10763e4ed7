"""What a record lacks: tests, repeated sweeps, conditions, columns. Each with what that costs and what to do."""

from collections.abc import Mapping

import numpy as np

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fitting.library import library_for, motion_library

from .result import CheckedTest, Missing


SAME_TEMPERATURE, SAME_PRESSURE = 5.0, 0.1  # K; share of the largest supply pressure
MOST_NAMES = 4
# What each static test alone tells well, of a valve with all edges alike.
_TELLS = {
    "leakage": "how the leakage falls as the edges overlap tells radial clearance from edge radius",
    "pressure_gain": "the slope at null tells the underlap, and the crossing the null bias",
    "flow_gain": "the flow through wide openings tells the discharge coefficient (a load_flow test does too)",
}


def what_is_missing(record: BenchRecord, tests: Mapping[str, CheckedTest]) -> tuple[Missing, ...]:
    """The most costly first."""
    found = [*_tests(record), *_noise(tests), *_conditions(record)]
    return tuple([*found, *_effects(record)])


def _tests(record: BenchRecord) -> list[Missing]:
    there = set(record.static_tests)
    if not there:
        return []
    lacking = [name for name in _TELLS if name not in there and not (name == "flow_gain" and "load_flow" in there)]
    return [
        Missing("test", f"No {name} test: {_TELLS[name]}. Add [tests.{name}], or hold in [start] what you know.")
        for name in lacking
    ]


def _noise(tests: Mapping[str, CheckedTest]) -> list[Missing]:
    unknown = [f"{name}, {noise.channel}" for name, test in tests.items() for noise in test.noise if not noise.known]
    if not unknown:
        return []
    where = sorted({entry.split(",")[0] for entry in unknown})
    return [
        Missing(
            "noise",
            f"Nobody states the noise of {'; '.join(unknown)}, and no sweep repeats another: it is taken from what the fit "
            "leaves, so chi-square cannot say whether the model is right. Run each sweep twice (a column run tells them apart), "
            f'or write noise = "..." in {", ".join(f"[tests.{name}]" for name in where)}.',
        )
    ]


def _conditions(record: BenchRecord) -> list[Missing]:
    static = list(record.static_tests.values())
    if not static:
        return []
    temperature = np.concatenate([test.temperature for test in static])
    supply = np.concatenate([test.supply_pressure for test in static])
    one = []
    if np.ptp(temperature) < SAME_TEMPERATURE:
        one.append(
            "one temperature: an oil of another viscosity, a wrong temperature and the transition number look alike"
        )
    if np.ptp(supply) < SAME_PRESSURE * supply.max():
        one.append("one supply pressure: losses in passages, in the supply line and in the return line look alike")
    return [
        Missing(
            "condition",
            f"All sweeps at {words}. A second one, for one of the tests, separates them.",
        )
        for words in one
    ]


def _effects(record: BenchRecord) -> list[Missing]:
    """Effects of the library that a diagnosis could not look for, by reason."""
    reasons: dict[str, list[str]] = {}
    if record.static_tests:
        for name, why in library_for(record.static_tests.values()).impossible.items():
            reasons.setdefault(why, []).append(name)
    if record.dynamic_tests and record.actuator is not None:
        for name, why in motion_library(record.dynamic_tests, record.actuator.heat).impossible.items():
            reasons.setdefault(why, []).append(name)
    found = []
    for why, names in reasons.items():
        shown = ", ".join(names[:MOST_NAMES]) + (
            f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        )
        found.append(Missing("effects", f"A diagnosis cannot look for {shown}: {why}."))
    return found
