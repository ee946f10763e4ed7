"""The whole diagnosis of one record: fit, find where, name, confirm on rows held out, say what remains."""

import time
from dataclasses import replace

from thermohyd.precision import require_float64

from ..record import BenchRecord
from .case import Case, Progress, open_case
from .choice import choose
from .conclusion import conclude
from .final_model import final_model
from .result import DiagnosisResult


def diagnose(record: BenchRecord, *, learn: bool = False, progress: Progress | None = None) -> DiagnosisResult:
    """Find where a record disagrees with the ideal valve, name the missing effects, add them and show the gap close.

    learn: add the leading smooth variation to the model where no effect explains the rest (marked as empirical).
    Raises what `fit` raises: BenchInputError where the record determines nothing, RuntimeError in single precision.
    Each step can be called alone: `open_case`, `choose`, `final_model`, `conclude`.
    """
    require_float64("diagnose")
    began = time.perf_counter()
    say = progress or (lambda _: None)
    conclusion = lambda case: diagnose_case(case, learn=learn, say=say)
    if record.dynamic is None:
        result = conclusion(open_case(record, say))
    else:
        from .motion_diagnosis import diagnose_motion  # a static record does not wait for the solvers of motion

        static = conclusion(open_case(replace(record, dynamic=None), say)) if record.tests else None
        result = diagnose_motion(record, static, conclusion, say)
    return replace(result, seconds=time.perf_counter() - began)


def diagnose_case(case: Case, *, learn: bool = False, say: Progress = lambda _: None) -> DiagnosisResult:
    """What follows `open_case`; `seconds` of the result is left at 0."""
    case, found, split = choose(case, say)
    model = final_model(case, found, split, say)
    return conclude(case, found, split, model, learn=learn, say=say)
