"""Render one HTML page from a template of this package, with every figure inside it and no network access; here that of a fit."""

import base64
from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from thermohyd.identify.bench.provenance import file_rows, record_rows
from thermohyd.identify.fitting.result import FitResult

from . import fit_report as content, model_form_words, uncertainty_words


def page(template: str, figures: Mapping[str, bytes], **content: Any) -> str:
    """The page; `figures` maps a caption or a name to an SVG. Every text is escaped by the template engine."""
    loader = PackageLoader("thermohyd.identify", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    inside = {name: base64.b64encode(svg).decode("ascii") for name, svg in figures.items()}
    return environment.get_template(template).render(figures=inside, **content)


def html_report(
    result: FitResult, figures: dict[str, bytes], version: str, of_knowledge: Mapping[str, bytes] | None = None
) -> str:
    """The page for a fit; `figures` maps a caption to an SVG. Every text is escaped by the template engine.

    of_knowledge: pictures of what is known of each parameter, beside its row.
    """
    pictures = of_knowledge or {}
    return page(
        "report.html",
        {**figures, **pictures},
        data_figures=list(figures),
        knowledge_title=uncertainty_words.TITLE,
        knowledge=uncertainty_words.knowledge_rows(result),
        knowledge_sentences=uncertainty_words.knowledge_sentences(result),
        knowledge_figures=list(pictures),
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
        model_form_title=model_form_words.title(result),
        model_form=model_form_words.model_form_rows(result),
        model_form_sentences=model_form_words.model_form_sentences(result),
        correlations=content.correlations(result),
        threshold=content.CORRELATION_THRESHOLD,
        identifiability=content.identifiability(result),
        statistics=content.statistics(result),
        tests=content.test_rows(result),
        noise_sources=content.noise_sources(result),
        starts=content.multi_start(result),
    )
