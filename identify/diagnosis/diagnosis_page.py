"""`report.html` of a diagnosis: one page without network access, with every figure inside it."""

from dataclasses import dataclass

from .. import report_content
from ..display_units import reading_unit, significant
from ..page import page
from ..provenance import file_rows, record_rows
from . import diagnosis_content as content, diagnosis_sentences as words
from .result import DiagnosisResult


# Figures that have a place of their own on the page; the others belong to the tests.
PLACED = ("residual_map", "candidates", "exchange", "variations")


@dataclass(frozen=True)
class _NoiseRow:
    reading: str
    std: str
    source: str
    correlation: str
    correlation_source: str
    rows: str
    effective: str


def diagnosis_page(result: DiagnosisResult, figures: dict[str, bytes], version: str) -> str:
    """The page; `figures` maps the names of `diagnosis_figures` to SVG. Every text is escaped by the template engine."""
    evidence = [name for name in figures if name.startswith("evidence_")]
    return page(
        "diagnosis.html",
        figures,
        record=result.record,
        record_rows=record_rows(result.record),
        record_files=file_rows(result.record),
        result=result,
        version=version,
        verdict=content.verdict_words(result),
        shout=content.shout(result),
        facts=[words.gap(result)],
        where=content.where_rows(result, result.where),
        where_after=content.where_rows(result, result.where_after),
        effects=content.effect_rows(result),
        meanings=content.meanings(result),
        rivals=content.rival_sentences(result),
        next_test=result.next_test,
        shifts=content.shift_rows(result),
        parameters=report_content.parameter_rows(result.before),
        tests=[name for name in figures if name not in PLACED and name not in evidence],
        evidence=evidence,
        held_out=_sentence(words.held_out(result)),
        left_over=_sentence(words.left_over(result)),
        variations=words.variations(result),
        candidates=content.candidate_rows(result),
        silent=[s for s in (words.absorbed(result), words.impossible(result)) if s],
        noise=_noise(result),
    )


def _sentence(text: str) -> str:
    """With a capital: in the terminal the label before it begins the sentence."""
    return text[:1].upper() + text[1:]


def _noise(result: DiagnosisResult) -> list[_NoiseRow]:
    rows = []
    for found in result.noise:
        unit = reading_unit(found.channel)
        rows.append(
            _NoiseRow(
                reading=content.reading_words(found.test, found.channel),
                std=f"{significant(found.std * unit.factor, 2)} {unit.label}",
                source=found.source,
                correlation=f"{found.correlation:.2f}",
                correlation_source=found.correlation_source,
                rows=f"{found.rows:,}",
                effective=f"{found.effective_size:,.0f}",
            )
        )
    return rows
