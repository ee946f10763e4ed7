"""`report.html`: the report as one page without network access, with the figures inside it."""

import base64

from jinja2 import Environment, PackageLoader, StrictUndefined

from . import report_content as content
from .fit_result import FitResult


def html_report(result: FitResult, figures: dict[str, bytes], version: str) -> str:
    """The page for a fit; `figures` maps a caption to an SVG. Every text is escaped by the template engine."""
    loader = PackageLoader("thermohyd.identify", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("report.html").render(
        record=result.record,
        result=result,
        version=version,
        model=content.model_words(result.record),
        shout=content.shout(result),
        verdict=content.verdict(result),
        parameters=content.parameter_rows(result),
        remarks=content.parameter_remarks(result),
        correlations=content.correlations(result),
        threshold=content.CORRELATION_THRESHOLD,
        identifiability=content.identifiability(result),
        statistics=content.statistics(result),
        tests=content.test_rows(result),
        noise_sources=content.noise_sources(result),
        starts=content.multi_start(result),
        figures={caption: base64.b64encode(svg).decode("ascii") for caption, svg in figures.items()},
    )
