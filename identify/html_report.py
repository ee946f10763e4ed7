"""`report.html`: the report as one page without network access, with the figures inside it."""

from . import report_content as content
from .fit_result import FitResult
from .page import page
from .provenance import file_rows, record_rows


def html_report(result: FitResult, figures: dict[str, bytes], version: str) -> str:
    """The page for a fit; `figures` maps a caption to an SVG. Every text is escaped by the template engine."""
    return page(
        "report.html",
        figures,
        record=result.record,
        record_rows=record_rows(result.record),
        record_files=file_rows(result.record),
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
    )
