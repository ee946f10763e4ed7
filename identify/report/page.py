"""Render one HTML page from a template of this package, with every figure inside it and no network access; here that of a fit."""

import base64
import hashlib
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from thermohyd.identify.bench.provenance import record_rows
from thermohyd.identify.fitting.result import FitResult

from . import fit_report as content, model_form_words, uncertainty_words
from .channel_curves import fit_views
from .curves import View, palette_css, views_json
from .next_steps import after_fit
from .origin import FILES, Origin, origin
from .picture import address


SCRIPTS = ("page_tools.js", "curves.js")


def page(
    template: str,
    figures: Mapping[str, bytes],
    *,
    views: Mapping[str, Iterable[View]] | None = None,
    origin: Origin | None = None,
    **content: Any,
) -> str:
    """The page; `figures` maps a caption or a name to an SVG. Every text is escaped by the template engine.

    views: {name: curves to look into}, which stand where the template says, in the place of the pictures there where a
    browser runs the page's own script. It runs no other: the page names the script's hash, and forbids all it does not name.
    """
    loader = PackageLoader("thermohyd.identify", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    inside = {name: address(svg) for name, svg in figures.items()}
    shown = {name: list(of_name) for name, of_name in (views or {}).items()}
    given = {name: views_json(of_name) for name, of_name in shown.items() if of_name}
    script = _script()
    return environment.get_template(template).render(
        figures=inside,
        views=given,
        origin=origin,
        origin_files=FILES,
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
        palettes={"light": Markup(palette_css(False)), "dark": Markup(palette_css(True))},
        **content,
    )


@cache
def _script() -> str:
    """The page's script: both files within one block."""
    templates = files("thermohyd.identify").joinpath("templates")
    parts = [templates.joinpath(name).read_text(encoding="utf-8") for name in SCRIPTS]
    return "(() => {\n" + "\n".join(parts) + "})();\n"


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
        views={"tests": fit_views(result)},
        origin=origin("fit", [result.record]),
        data_figures=list(figures),
        **uncertainty_words.on_a_page(result, pictures),
        record=result.record,
        record_rows=record_rows(result.record),
        result=result,
        version=version,
        model=content.model_words(result.record),
        shout=content.shout(result),
        verdict=content.verdict(result),
        next_steps=after_fit(result),
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
