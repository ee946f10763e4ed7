"""Every file that `diagnose --out` writes, as bytes and text in memory: whole before the first one is written."""

from importlib.metadata import version
from typing import Any

from ..fit_json import json_text
from ..plot_style import drawn
from .diagnosis_json import diagnosis_json
from .diagnosis_page import diagnosis_page
from .diagnosis_plots import diagnosis_figures
from .result import DiagnosisResult


def diagnosis_files(result: DiagnosisResult, model_content: dict[str, Any] | None = None) -> dict[str, bytes | str]:
    """{file name: content}: diagnosis.json, model.json where its content is given, report.html, a PNG and an SVG per figure."""
    figures = diagnosis_figures(result)
    vectors, files = drawn(figures)
    files["diagnosis.json"] = json_text(diagnosis_json(result))
    if model_content is not None:
        files["model.json"] = json_text(model_content)
    files["report.html"] = diagnosis_page(result, vectors, version("thermohyd"))
    return files
