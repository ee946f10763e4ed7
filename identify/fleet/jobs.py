"""What is done with one record of a fleet, by a word: read it, fit it, diagnose it; or a function of one's own.

A job is `job(record, **options) -> Result`, as `identify.fit` is; None counts as "read, no more". It is imported where it runs.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from thermohyd.identify.bench.errors import BenchInputError, quoted, suggestion


JOBS = {
    "read": "thermohyd.identify.fleet.jobs:read_only",
    "fit": "thermohyd.identify.fitting.fit:fit",
    "diagnose": "thermohyd.identify.diagnosis.diagnose:diagnose",
}
Job = Callable[..., Any]


def read_only(record: object) -> None:
    """Nothing: the record has been read and checked, which is all that this job is for."""


def check_job(name: str) -> str:
    """The name, where it is a word of JOBS or "module:function". Raises BenchInputError."""
    if name not in JOBS and ":" not in name:
        raise BenchInputError(f"unknown job {quoted(name)}; {suggestion(name, JOBS)}")
    return name


def job_of(name: str) -> Job:
    """Raises ImportError or AttributeError where the program has no such function."""
    module, _, function = JOBS.get(name, name).partition(":")
    return getattr(import_module(module), function)
