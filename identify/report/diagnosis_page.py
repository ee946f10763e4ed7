"""`report.html` of a diagnosis, one page without network access with every figure inside it, and all files of `diagnose --out`.

The files are bytes and text in memory: whole before the first one is written.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from thermohyd.identify.bench.provenance import record_rows
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.diagnosis.result import DiagnosisResult

from . import diagnosis_words as words, fit_report as report_content, model_form_words, uncertainty_words
from .diagnosis_curves import diagnosis_views
from .diagnosis_figures import diagnosis_figures
from .diagnosis_json import diagnosis_json
from .fit_json import json_text, knowledge_files
from .next_steps import after_diagnosis
from .origin import origin
from .page import page
from .style import drawn
from .term_words import term_lines, term_rows


# Figures that have a place of their own on the page; the others belong to the tests.
PLACED = ("residual_map", "candidates", "exchange", "variations", "terms")


@dataclass(frozen=True)
class _NoiseRow:
    reading: str
    std: str
    source: str
    correlation: str
    correlation_source: str
    rows: str
    effective: str


def diagnosis_page(
    result: DiagnosisResult, figures: dict[str, bytes], version: str, of_knowledge: Mapping[str, bytes] | None = None
) -> str:
    """The page; `figures` maps the names of `diagnosis_figures` to SVG. Every text is escaped by the template engine.

    of_knowledge: pictures of what is known of each parameter, beside its row.
    """
    evidence = [name for name in figures if name.startswith("evidence_")]
    return page(
        "diagnosis.html",
        {**figures, **(of_knowledge or {})},
        views=diagnosis_views(result),
        origin=origin("diagnose", [result.record]),
        record=result.record,
        record_rows=record_rows(result.record),
        result=result,
        version=version,
        verdict=words.verdict_words(result),
        shout=words.shout(result),
        sentences=words.meaning_lines(result),
        facts=list(
            filter(None, [words.gap(result), words.handed_over(result), *report_content.prior_sentences(result.after)])
        ),
        faults=words.fault_lines(result),
        credit=words.credit_rows(result),
        where=words.where_rows(result, result.where),
        where_after=words.where_rows(result, result.where_after),
        effects=words.effect_rows(result),
        meanings=[*words.meanings(result), *filter(None, [words.proof(result)])],
        rivals=[*words.rival_sentences(result), *words.alike_sentences(result)],
        next_steps=after_diagnosis(result),
        next_test=result.next_test,
        shifts=words.shift_rows(result),
        parameters=report_content.parameter_rows(result.before),
        model_form_title=model_form_words.title(result.after),
        model_form=model_form_words.model_form_rows(result.after),
        model_form_sentences=model_form_words.model_form_sentences(result.after),
        **uncertainty_words.on_a_page(result.after, of_knowledge or {}),
        tests=[name for name in figures if name not in PLACED and name not in evidence],
        evidence=evidence,
        held_out=_sentence(words.held_out(result)),
        left_over=_sentence(words.left_over(result)),
        discrepancy=words.discrepancy(result),
        variations=words.variations(result),
        terms=term_rows(result.terms),
        term_lines=term_lines(result.terms),
        candidates=words.candidate_rows(result),
        silent=[s for s in (words.absorbed(result), words.impossible(result)) if s],
        noise=_noise(result),
    )


def _sentence(text: str) -> str:
    """With a capital: in the terminal the label before it begins the sentence."""
    return text[:1].upper() + text[1:]


def _noise(result: DiagnosisResult) -> list[_NoiseRow]:
    rows = []
    for found in result.noise:
        unit = result.record.unit_of(found.test, found.channel)
        rows.append(
            _NoiseRow(
                reading=words.reading_words(found.test, found.channel),
                std=f"{significant(found.std * unit.factor, 2)} {unit.label}",
                source=found.source
                if found.parts is None
                else f"{report_content.parts_words(found.parts, unit)}; {found.source}",
                correlation=f"{found.correlation:.2f}",
                correlation_source=found.correlation_source,
                rows=f"{found.rows:,}",
                effective=f"{found.effective_size:,.0f}",
            )
        )
    return rows


def diagnosis_files(result: DiagnosisResult, model_content: dict[str, Any] | None = None) -> dict[str, bytes | str]:
    """{file name: content}: diagnosis.json, model.json where its content is given, report.html, a PNG and an SVG per figure."""
    figures = diagnosis_figures(result)
    vectors, files = drawn(figures)
    files["diagnosis.json"] = json_text(diagnosis_json(result))
    if model_content is not None:
        files["model.json"] = json_text(model_content)
    known_vectors, known_files = knowledge_files(result.after)
    files |= known_files
    files["report.html"] = diagnosis_page(result, vectors, version("thermohyd"), known_vectors)
    return files
