"""What a `diagnose` of one or several records has to confess at its end."""

from ..several_records import Outcome, confession
from .result import DiagnosisResult


def unsettled(outcome: Outcome[DiagnosisResult]) -> str:
    """In one sentence; empty where all went well."""
    return confession(
        outcome,
        (
            (name, f"the fit did not converge: {result.after.message}")
            for name, result in outcome.results.items()
            if not result.after.converged
        ),
    )
