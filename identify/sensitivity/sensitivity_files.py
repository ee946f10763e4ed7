"""Every file that `sensitivity --out` writes, as bytes and text in memory: whole before the first one is written."""

from importlib.metadata import version

from matplotlib.figure import Figure

from ..fit_json import json_text
from ..page import page
from ..plot_style import drawn
from . import words
from .curve_plot import curve_figure
from .drift_plot import drift_figure
from .global_plot import along_figure, sobol_figure
from .information_plot import information_figure, next_test_figure
from .posterior_plot import posterior_figure
from .result import SensitivityResult
from .row_slopes import TESTS
from .sensitivity_json import sensitivity_json


def sensitivity_figures(result: SensitivityResult) -> dict[str, Figure]:
    """{file name without ending: figure}, in the order in which a report shows them."""
    figures = {"sobol": sobol_figure(result), "sobol_along": along_figure(result), "drift": drift_figure(result)}
    figures |= {test: curve_figure(result, test) for test in TESTS}
    figures["information"] = information_figure(result)
    figures["next_test"] = next_test_figure(result)
    if result.posterior is not None:
        figures["posterior"] = posterior_figure(result, result.posterior)
    return figures


def sensitivity_files(result: SensitivityResult) -> dict[str, bytes | str]:
    """{file name: content}: sensitivity.json, report.html, and a PNG and an SVG per figure."""
    figures = sensitivity_figures(result)
    vectors, files = drawn(figures)
    files["sensitivity.json"] = json_text(sensitivity_json(result))
    files["report.html"] = sensitivity_page(result, vectors, version("thermohyd"))
    return files


def sensitivity_page(result: SensitivityResult, figures: dict[str, bytes], version: str) -> str:
    """`report.html`: one page without network access; every text is escaped by the template engine."""
    return page(
        "sensitivity.html",
        figures,
        name=result.subject.name,
        conditions=words.conditions_in_words(result),
        oil=result.subject.model.oil.name,
        result=result,
        evaluations=f"{result.tolerances.sobol.evaluations:,}",
        interval=f"{words.largest_interval(result):.0f}",
        figure_names=list(words.SHORT.values()),
        ranking=words.ranking_rows(result),
        spread=words.spread_row(result),
        drift_columns=words.DRIFT_COLUMNS,
        drifts=words.drift_rows(result),
        actuator=words.actuator_sentence(result),
        next_test=words.next_test_sentences(result),
        information=words.information_sentences(result),
        of=result.information.of,
        noise=result.subject.noise.words(),
        posterior=words.posterior_sentences(result),
        tests=TESTS,
        version=version,
    )
