"""Print several fits or diagnoses in a terminal, one line or column for each record, and what the command must own up to at its end."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from thermohyd.identify.bench.shown_units import beside, significant
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.result import FitResult, ParameterEstimate
from thermohyd.identify.report.diagnosis_report import COLOURS
from thermohyd.identify.report.diagnosis_words import changed, excess, percent, reading_words
from thermohyd.identify.report.fit_report import chi2_band
from thermohyd.identify.report.terminal import table

from .several_records import Outcome, confession


CELL = 20  # characters of "-12.3456 +/- 0.0012"


def print_summary_of_fits(results: Mapping[str, FitResult], console: Console) -> None:
    """Print the parameters of several fits side by side, in the order given; user text is never read as markup.

    A parameter per row, a record per column, so that any number of parameters fits; records that do not fit beside each
    other follow below.
    """
    if not results:
        return
    widest = max(len(name) for result in results.values() for name in [*result.parameters, "reduced chi-square"])
    each = max(CELL, *(len(record) + 2 for record in results))
    count = max(1, (console.width - widest - 8) // each)
    records = list(results)
    for first in range(0, len(records), count):
        console.print(_table({name: results[name] for name in records[first : first + count]}))


def _table(results: Mapping[str, FitResult]) -> Table:
    rows = []
    for name in dict.fromkeys(name for result in results.values() for name in result.parameters):
        estimates = [result.parameters.get(name) for result in results.values()]
        unit = next(estimate.shown.label for estimate in estimates if estimate is not None)
        rows.append((name, unit, *[_cell(estimate) for estimate in estimates]))
    rows.append(("reduced chi-square", "-", *[_chi2(result) for result in results.values()]))
    return table(("parameter", "unit", *[f">~{record}" for record in results]), rows, gap=2)


def _cell(estimate: ParameterEstimate | None) -> Text:
    if estimate is None:
        return Text("")
    factor = estimate.shown.factor
    std = None if estimate.std is None else estimate.std * factor
    value = beside(estimate.value * factor, std)
    if estimate.fixed:
        return Text(f"{value} fixed", style="dim")
    if std is None:
        return Text(f"{value} {'AT BOUND' if estimate.at_bound else 'NO ERROR'}", style="bold red")
    return Text(f"{value} +/- {beside(std, std)}")


def _chi2(result: FitResult) -> Text:
    words = significant(result.reduced_chi2, 3)
    if not result.converged:
        return Text(f"{words} NOT CONVERGED", style="bold red")
    return Text(words, style="yellow" if result.reduced_chi2 > chi2_band(result.degrees_of_freedom)[1] else "")


def json_of_several(outcome: Outcome[FitResult] | Outcome[DiagnosisResult]) -> dict[str, Any]:
    """Several results by the name of the record's folder, and why the others failed."""
    return {
        "records": [{"folder": name, **result.to_dict()} for name, result in outcome.results.items()],
        "failed": [{"folder": name, "reason": reason} for name, reason in outcome.failed.items()],
    }


def unsettled(outcome: Outcome[FitResult]) -> str:
    """What a `fit` has to confess, in one sentence; empty where all went well."""
    return confession(
        outcome,
        (
            (name, f"the fit did not converge: {result.message}")
            for name, result in outcome.results.items()
            if not result.converged
        ),
    )


def print_summary_of_many(results: Mapping[str, DiagnosisResult], console: Console) -> None:
    """Print the verdicts of several diagnoses, one line each, in the order given; user text is never read as markup."""
    if not results:
        return
    rows = []
    for name, result in results.items():
        gap = excess(result.gap_before) + (f" -> {excess(result.gap_after)}" if changed(result) else "")
        verdict = Text(result.verdict, style=COLOURS[result.verdict])
        rows.append((name, verdict, _added(result), _worst(result), gap, _held_out(result)))
    console.print(table(("~record", "~verdict", "~effects", "~misses most", ">~red. chi2", ">~held out"), rows))


def _added(result: DiagnosisResult) -> str:
    """Names of what was added, each with the rivals that the data cannot tell from it, and faults of the bench."""
    words = [" or ".join([e.name, *(rival.words for rival in e.alternatives)]) for e in result.effects]
    words += [f"learned {v.quantity}({v.variable})" for v in result.variations if v.learned]
    words += [f"{fault.name} (bench)" for fault in result.after.faults if not fault.rows]
    return " + ".join(words) or "none"


def _worst(result: DiagnosisResult) -> str:
    if not result.where:
        return ""
    worst = result.where[0]
    return f"{reading_words(worst.test, worst.channel)} {percent(worst.share)}"


def _held_out(result: DiagnosisResult) -> str:
    if result.held_out is None or not changed(result):
        return ""
    return f"{percent(result.held_out.gap_closed)} closed"


def unsettled_diagnoses(outcome: Outcome[DiagnosisResult]) -> str:
    """What a `diagnose` has to confess, in one sentence; empty where all went well."""
    return confession(
        outcome,
        (
            (name, f"the fit did not converge: {result.after.message}")
            for name, result in outcome.results.items()
            if not result.after.converged
        ),
    )
