"""Small benches diagnosed with a short library: what takes long is compiled once, and every case is computed once."""

from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np
from reference.valve import Rows

from helpers import small_bench
from helpers.records import STROKE
from helpers.small_bench import small_record
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.diagnosis import case as case_module
from thermohyd.identify.diagnosis.case import Case, open_case
from thermohyd.identify.diagnosis.diagnose import Stage, diagnose_stage
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.library import Library


# No coupled effect and no heat: one program serves every refit.
LIBRARY = (
    "unequal_underlap", "viscosity_shift", "temperature_offset", "pilot_leakage", "flowmeter_offset", "flowmeter_lag",
    "position_scale", "hysteresis", "position_lag",
)  # fmt: skip
BIAS, DRIFT, MIDDLE = 1.5e-6, 5e-8, 303.15  # m, m/K, K


def wandering_null(rows: Rows) -> Any:
    """A null bias that follows the temperature: nothing in the library does that."""
    return BIAS + DRIFT * (rows.temperature - MIDDLE)


WAVE, HEIGHT = 110e-6, 2e-6  # m


def wound_record() -> BenchRecord:
    """Positions of a transducer whose winding waves, evenly over the stroke: nothing in the library does that, and no smooth curve."""
    null = lambda rows: BIAS - HEIGHT * np.sin(2.0 * np.pi * rows.spool_position / WAVE)
    with patch.object(small_bench, "cycle", lambda reach: reach * STROKE * small_bench.there_and_back()):
        return small_record(valve={"null_bias": null}, seed=9)


CASES: dict[str, dict[str, Any]] = {
    "nothing": {},
    "correlated": {"phi": 0.7, "declared": False, "seed": 3},
    "pilot": {"effects": {"pilot_leakage": 1e-9}, "seed": 1},
    "two": {"effects": {"hysteresis": 1e-6, "flowmeter_offset": 2e-7}, "seed": 2},
    "rivals": {"effects": {"viscosity_shift": 0.1}, "seed": 4},
    "noisy positions": {"position_noise": 0.1e-6, "declared": False, "seed": 6},
    "stated beside noisy positions": {"position_noise": 0.2e-6, "seed": 7},
    "mirrored": {"effects": {"unequal_underlap": 4e-6}, "seed": 8},  # the same valve as -4 um, the underlap 4 um larger
    "too much": {"effects": {"pilot_leakage": 4e-8}, "seed": 1},  # eight times the largest usual amount
    "outside": {"valve": {"null_bias": wandering_null}, "seed": 5},
}


def opened(record: BenchRecord, names: tuple[str, ...] = LIBRARY) -> Case:
    with patch.object(case_module, "library_for", lambda tests: Library(names, {})):
        return open_case(record)


@cache
def small_case(name: str) -> Case:
    return opened(small_record(**CASES[name]))


@cache
def small_stage(name: str, learn: bool = False) -> Stage:
    return diagnose_stage(small_case(name), learn=learn)


def small_diagnosis(name: str, learn: bool = False) -> DiagnosisResult:
    return small_stage(name, learn).result
