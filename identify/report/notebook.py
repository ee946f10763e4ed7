"""Show a fit or a diagnosis in a notebook: the sentences that count and one or two tables, in bench units."""

from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.result import FitResult

from . import diagnosis_words, fit_report
from .page import page


PARAMETERS = ("parameter", "value", "std err", "unit", "95 % interval", "status")
EFFECTS = ("missing effect", "value", "std err", "unit", "95 % interval", "rivals")


def fit_html(result: FitResult) -> str:
    """Verdict and parameters of a fit. Every text is escaped by the template engine."""
    chi2 = dict(fit_report.statistics(result))["reduced chi-square"]
    sentences = [*fit_report.verdict(result), f"Reduced chi-square {chi2}."]
    return _html(f"Fit of {result.record.name}", fit_report.shout(result), sentences, [_parameters(result)])


def diagnosis_html(result: DiagnosisResult) -> str:
    """Headline, named effects and parameters of a diagnosis. Every text is escaped by the template engine."""
    found = diagnosis_words.effect_rows(result)
    rows = [(r.name, r.value, r.std, r.unit, r.interval, r.rivals) for r in found]
    tables = [(EFFECTS, rows)] if rows else []
    sentences = [result.headline, *result.sentences]
    title = f"Diagnosis of {result.record.name}: {result.verdict}"
    return _html(title, diagnosis_words.shout(result), sentences, [*tables, _parameters(result.after)])


Rows = list[tuple[str, ...]]


def _parameters(result: FitResult) -> tuple[tuple[str, ...], Rows]:
    rows = fit_report.parameter_rows(result)
    return PARAMETERS, [(r.name, r.value, r.std, r.unit, r.interval, r.status) for r in rows]


def _html(title: str, alarm: str, sentences: list[str], tables: list[tuple[tuple[str, ...], Rows]]) -> str:
    return page("notebook.html", {}, title=title, alarm=alarm, sentences=sentences, tables=tables)
