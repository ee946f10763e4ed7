"""Every file that `sensitivity --out` writes, as bytes and text in memory: whole before the first one is written."""

import base64
from importlib.metadata import version

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from ..fit_json import json_text
from ..plot_style import png, style, svg
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
    with style():
        vectors = {name: svg(figure) for name, figure in figures.items()}
        files: dict[str, bytes | str] = {f"{name}.svg": drawing for name, drawing in vectors.items()}
        files |= {f"{name}.png": png(figure) for name, figure in figures.items()}
    files["sensitivity.json"] = json_text(sensitivity_json(result))
    files["report.html"] = sensitivity_page(result, vectors, version("thermohyd"))
    return files


def sensitivity_page(result: SensitivityResult, figures: dict[str, bytes], version: str) -> str:
    """`report.html`: one page without network access; every text is escaped by the template engine."""
    loader = PackageLoader("thermohyd.identify", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("sensitivity.html").render(
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
        figures={name: base64.b64encode(drawing).decode("ascii") for name, drawing in figures.items()},
    )
