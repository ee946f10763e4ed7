"""Every file that `fit --out` writes, as bytes and text in memory: whole before the first one is written."""

from importlib.metadata import version

from .fit_json import fit_json, json_text
from .fit_result import FitResult
from .html_report import html_report
from .model_file import model_json
from .parameter_plot import parameter_figure
from .plot_style import drawn
from .plots import test_figures


def fit_files(result: FitResult) -> dict[str, bytes | str]:
    """{file name: content}: fit.json, model.json, report.html, and a PNG and an SVG per test and for the parameters."""
    figures = {**test_figures(result)}
    if result.free:
        figures["parameters"] = parameter_figure(result)
    vectors, files = drawn(figures)
    files["fit.json"] = json_text(fit_json(result))
    files["model.json"] = json_text(model_json(result))
    files["report.html"] = html_report(result, vectors, version("thermohyd"))
    return files
