"""The engine's own refits of a record, for the simpler rules that the diagnosis is compared with."""

from typing import Any


def problem_of(record: Any) -> Any:
    """The record's LibraryProblem, with the noise that the diagnosis uses."""
    raise NotImplementedError
