"""The final model of a diagnosis as the content of a `model.json`: effects and learned terms included."""

from typing import Any

from ..model_file import model_json
from .result import DiagnosisResult


def model_content(result: DiagnosisResult) -> dict[str, Any]:
    """Everything that `simulate` needs to predict with the final model."""
    return model_json(result.after, result.learned)
